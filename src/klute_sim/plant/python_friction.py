"""Friction of joints in the Python backend: the row of an actuator, and what MuJoCo's callbacks return for it."""

import mujoco

from klute_sim.plant.joint_friction import (
    FRICTION_LAYOUT_ID,
    FRICTION_ROW_SIZE,
    N_FRICTION_STATES,
    compute_friction_force,
    compute_stretch_rate,
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


def release_friction(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Relax all frictions of joints."""
    for actuator in range(model.nactuator):
        if get_friction_row(model, actuator) is not None:
            data.act[model.actuator_actadr[actuator]] = 0.0
