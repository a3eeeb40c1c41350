"""Friction of joints in the Python backend: the row of an actuator, and what MuJoCo's callbacks return for it."""

from collections.abc import Iterator

import mujoco

from klute_sim.laws.joint import BristleFriction, bristle_level
from klute_sim.plant.joint_friction import (
    FRICTION_LAYOUT_ID,
    FRICTION_ROW_SIZE,
    N_FRICTION_STATES,
    compute_friction_force,
    compute_stretch_rate,
    limit_stiffness,
    unpack_friction,
)


def get_friction_row(model: mujoco.MjModel, actuator: int) -> tuple[float, ...] | None:
    """Return the row of the joint friction on ``actuator``; None without one."""
    if (
        model.nuser_actuator >= FRICTION_ROW_SIZE
        and model.actuator_user[actuator, 0] == FRICTION_LAYOUT_ID
        and model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_USER
        and model.actuator_actnum[actuator] == N_FRICTION_STATES
    ):
        return tuple(model.actuator_user[actuator, :FRICTION_ROW_SIZE].tolist())
    return None


def get_inverse_inertia(model: mujoco.MjModel, actuator: int) -> float:
    """Return the inverse inertia [1/(kg m2)] of the joint of ``actuator`` while all others are free."""
    joint = model.actuator_trnid[actuator, 0]
    return float(model.dof_invweight0[model.jnt_dofadr[joint]])


def find_friction_rate(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float | None:
    """Return the rate of the state of the friction on ``actuator``; None without a friction."""
    row = get_friction_row(model, actuator)
    if row is None:
        return None
    stretch = float(data.act[model.actuator_actadr[actuator]])
    velocity = float(data.actuator_velocity[model.actuator_outadr[actuator]])
    return compute_stretch_rate(row, stretch, velocity, get_inverse_inertia(model, actuator), model.opt.timestep)


def find_friction_force(model: mujoco.MjModel, data: mujoco.MjData, actuator: int) -> float | None:
    """Return the force of the friction on ``actuator``; None without a friction."""
    row = get_friction_row(model, actuator)
    if row is None:
        return None
    state = model.actuator_actadr[actuator]
    velocity = float(data.actuator_velocity[model.actuator_outadr[actuator]])
    stretch, rate = float(data.act[state]), float(data.act_dot[state])
    inverse_inertia = get_inverse_inertia(model, actuator)
    return compute_friction_force(row, stretch, rate, velocity, inverse_inertia, model.opt.timestep)


def list_frictions(model: mujoco.MjModel, joint: int) -> list[BristleFriction]:
    """Return the frictions of bristles on a ``joint``."""
    return [friction for actuator, friction in _iterate_frictions(model) if model.actuator_trnid[actuator, 0] == joint]


def load_friction(model: mujoco.MjModel, data: mujoco.MjData, joint: int, share: float) -> None:
    """Stretch the bristles on a resting ``joint`` so that each holds a ``share`` (-1 to 1) of its level.

    A positive share balances a positive moment of all other forces.
    """
    for actuator, friction in _iterate_frictions(model):
        if model.actuator_trnid[actuator, 0] == joint:
            stiffness = limit_stiffness(friction, get_inverse_inertia(model, actuator), model.opt.timestep)
            data.act[model.actuator_actadr[actuator]] = share * bristle_level(friction, 0.0) / stiffness


def _iterate_frictions(model: mujoco.MjModel) -> Iterator[tuple[int, BristleFriction]]:
    """Yield each actuator with a friction, and the friction."""
    for actuator in range(model.nactuator):
        row = get_friction_row(model, actuator)
        if row is not None:
            yield actuator, unpack_friction(row)


def release_friction(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Relax all frictions of joints."""
    for actuator, _ in _iterate_frictions(model):
        data.act[model.actuator_actadr[actuator]] = 0.0
