"""The state in which a mechanism rests under its first inputs: the start of a simulation."""

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.laws.joint import bristle_level
from klute_sim.plant import callbacks
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.python_friction import list_frictions, load_friction, release_friction
from klute_sim.types import Array

MAX_NEWTON_STEPS = 40
"""Largest number of Newton steps."""
MAX_NEWTON_MOTION = 0.1
"""Largest motion of a joint in one Newton step [m or rad]."""
POSITION_PERTURBATION = 1e-6
"""Change of a joint [m or rad] that measures how its acceleration depends on its position."""
MAX_RESIDUAL_RATIO = 0.3
"""Acceleration after a step, over that before, above which the dependence on the positions is measured again
(assumed)."""
REST_TOLERANCE = 1e-9
"""Newton step of every joint [m or rad] below which the mechanism rests."""
RELAXATION_TIME = 0.02
"""Time [s] that joints move between two stops of a relaxation (assumed)."""
MAX_RELAXATIONS = 200
"""Largest number of relaxations; a mechanism that does not rest begins where they end."""
RELAXATION_TOLERANCE = 1e-7
"""Change of every joint in one relaxation [m or rad] below which the mechanism rests."""


def move_to_rest(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    devices: Mapping[str, DeviceActuator],
    pressures: Mapping[str, float],
    controls: ArrayLike,
    held_joints: Collection[str],
    known_joints: Collection[str] = (),
) -> None:
    """Move ``data`` to its equilibrium under constant ``pressures`` [Pa] and ``controls``.

    ``devices`` and ``pressures`` are by name of the device; ``held_joints`` stay where they are. Newton's method, with
    secant updates (Broyden, Math. Comput. 19:577, 1965), seeks positions without acceleration. Where it finds none, or
    a joint has several degrees of freedom, all joints start from rest again and again until they no longer move
    (dynamic relaxation with kinetic damping; Day, 1965).

    Where a joint rubs, every position near the equilibrium is one, and which of them depends on the past. One of
    ``known_joints`` stays where it is if its dry friction can hold it there; otherwise it slides towards the
    equilibrium until its friction does. Other joints rest as if they had no dry friction.
    """
    data.ctrl[:] = controls
    start = data.qpos.copy()
    release_friction(model, data)
    frictions = {name: _compute_holding_moment(model, name) for name in known_joints if name not in held_joints}
    frictions = {name: friction for name, friction in frictions.items() if friction > 0.0}
    with _without_friction_loss(model):
        moments = _solve_with_friction(model, data, devices, pressures, held_joints, frictions)
        if moments is None:
            data.qpos[:] = start
            _relax(model, data, devices, pressures)
            for name in held_joints:
                data.joint(name).qpos[0] = start[model.joint(name).qposadr[0]]
    data.qvel[:] = 0.0
    release_friction(model, data)
    for name, moment in (moments or {}).items():
        load_friction(model, data, model.joint(name).id, moment / frictions[name])
    _set_devices_to_equilibrium(model, data, devices, pressures)
    data.time = 0.0


def _compute_holding_moment(model: mujoco.MjModel, joint: str) -> float:
    """Return the dry friction [N m or N] of a ``joint`` at rest, with that of its bristles."""
    index = model.joint(joint).id
    dof = int(model.jnt_dofadr[index])
    return float(model.dof_frictionloss[dof]) + sum(bristle_level(f, 0.0) for f in list_frictions(model, index))


def _solve_with_friction(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    devices: Mapping[str, DeviceActuator],
    pressures: Mapping[str, float],
    held_joints: Collection[str],
    frictions: Mapping[str, float],
) -> dict[str, float] | None:
    """Move the joints to an equilibrium in which ``frictions`` (joint -> N m) hold some where they are.

    Returns joint -> moment of all other forces, which its friction balances; None without a stable equilibrium.
    """
    dofs = {name: int(model.joint(name).dofadr[0]) for name in frictions}
    moments: dict[str, float] = {}
    slide_moments: dict[str, float] = {}  # of the joints that their friction does not hold
    while True:
        for name, moment in slide_moments.items():
            data.qfrc_applied[dofs[name]] = -moment
        held = {*held_joints, *(frictions.keys() - slide_moments.keys())}
        is_at_rest = _solve_newton(model, data, devices, pressures, held)
        if is_at_rest and len(held) > len(held_joints):
            data.qvel[:] = 0.0
            _set_devices_to_equilibrium(model, data, devices, pressures)
            mujoco.mj_forward(model, data)
            moments = {name: float(data.qfrc_smooth[dof] + data.qfrc_constraint[dof]) for name, dof in dofs.items()}
        data.qfrc_applied[list(dofs.values())] = 0.0
        if not is_at_rest:
            return None
        moments |= slide_moments
        excessive = {n: m for n, m in moments.items() if n not in slide_moments and abs(m) > frictions[n]}
        if not excessive:
            return moments
        slide_moments |= {name: math.copysign(frictions[name], moment) for name, moment in excessive.items()}


def _solve_newton(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    devices: Mapping[str, DeviceActuator],
    pressures: Mapping[str, float],
    held_joints: Collection[str],
) -> bool:
    """Move the free joints to positions without acceleration; return whether a stable equilibrium was reached."""
    scalar = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
    if any(int(kind) not in scalar for kind in model.jnt_type):
        return False
    free = [index for index in range(model.njnt) if model.joint(index).name not in held_joints]
    positions, dofs = model.jnt_qposadr[free], model.jnt_dofadr[free]

    def accelerate(joint_positions: Array) -> Array:
        data.qpos[positions] = joint_positions
        data.qvel[:] = 0.0
        _set_devices_to_equilibrium(model, data, devices, pressures)
        mujoco.mj_forward(model, data)
        return np.array(data.qacc[dofs])

    def differentiate(joint_positions: Array, acceleration: Array) -> Array:
        perturbations = POSITION_PERTURBATION * np.eye(len(free))
        changes = [accelerate(joint_positions + dx) - acceleration for dx in perturbations]
        return np.column_stack(changes) / POSITION_PERTURBATION

    if not len(free):
        return True
    x = np.array(data.qpos[positions])
    acceleration = accelerate(x)
    jacobian = differentiate(x, acceleration)
    for _ in range(MAX_NEWTON_STEPS):
        if not np.isfinite(jacobian).all() or np.linalg.eigvals(jacobian).real.max() >= 0.0:
            return False  # no stable equilibrium is near
        step = np.linalg.solve(jacobian, -acceleration)
        motion = np.clip(step, -MAX_NEWTON_MOTION, MAX_NEWTON_MOTION)
        x = x + motion
        if np.max(np.abs(step)) < REST_TOLERANCE:
            data.qpos[positions] = x
            return True
        before, acceleration = acceleration, accelerate(x)
        if np.linalg.norm(acceleration) > MAX_RESIDUAL_RATIO * np.linalg.norm(before):
            jacobian = differentiate(x, acceleration)
        else:
            change = acceleration - before - jacobian @ motion
            jacobian = jacobian + np.outer(change, motion) / float(motion @ motion)
    return False


def _relax(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    devices: Mapping[str, DeviceActuator],
    pressures: Mapping[str, float],
) -> None:
    n_steps = max(1, round(RELAXATION_TIME / model.opt.timestep))
    for _ in range(MAX_RELAXATIONS):
        _set_devices_to_equilibrium(model, data, devices, pressures)
        release_friction(model, data)
        before = data.qpos.copy()
        data.qvel[:] = 0.0
        callbacks.step_model(model, data, n_steps)
        if not len(before) or np.max(np.abs(data.qpos - before)) < RELAXATION_TOLERANCE:
            return


@contextmanager
def _without_friction_loss(model: mujoco.MjModel) -> Iterator[None]:
    flags = int(model.opt.disableflags)
    model.opt.disableflags = flags | int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS)
    try:
        yield
    finally:
        model.opt.disableflags = flags


def _set_devices_to_equilibrium(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    devices: Mapping[str, DeviceActuator],
    pressures: Mapping[str, float],
) -> None:
    """Set every device to its equilibrium at the length of its tendon in ``data`` and its pressure [Pa]."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_tendon(model, data)
    for name, actuator in devices.items():
        tendon = model.actuator_trnid[actuator.id, 0]
        length = float(data.ten_length[tendon])
        near = actuator.get_state(data).length
        actuator.set_state(data, compute_equilibrium_state(actuator.parameters, length, pressures[name], near))
