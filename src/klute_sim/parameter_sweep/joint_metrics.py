"""Metrics of the controlled joint in one condition, over several episodes."""

import numpy as np

from klute_sim.envs.antagonist_joint_vector import AntagonistJointVectorEnv
from klute_sim.envs.tasks.joint_task import TENDONS
from klute_sim.errors import SimulationError
from klute_sim.parameter_sweep.joint_plan import JointCase

ERROR_COLUMN, CHANGE_COLUMN = "angle_error_rms [deg]", "action_change_rms [1]"
"""Columns that the tuning objective reads."""
JOINT_METRIC_COLUMNS = (
    *(ERROR_COLUMN, "angle_error_max [deg]", "reward [1]", CHANGE_COLUMN),
    *(f"force_{tendon}_mean [N]" for tendon in TENDONS),
)
"""All metrics of a case, in the order of the table."""


def compute_joint_metrics(case: JointCase) -> dict[str, float | bool | None]:
    """Simulate the episodes of ``case`` with the PID controller and return the metrics over all of them.

    Raises SimulationError when a simulation diverges.
    """
    options, controller = case.build_options(), case.build_controller()
    envs = AntagonistJointVectorEnv(
        case.episodes,
        device=case.device,
        duration=options.duration,
        time_step=options.time_step,
        load=options.load,
        n_jobs=1,  # cases run in parallel
    )
    errors, rewards, actions, forces = [], [], [], []
    try:
        observations, _ = envs.reset(seed=case.seed)
        for _ in range(options.actions_per_episode):
            actions.append(controller.act(observations))
            observations, reward, terminated, _, info = envs.step(actions[-1])
            if terminated.any():
                raise SimulationError("the joint diverges under these gains; lower them, or use a shorter time step")
            errors.append(info["angle_error_deg"])
            rewards.append(reward)
            forces.append([info[f"force_{tendon}_n"] for tendon in TENDONS])
    finally:
        envs.close()
    values = (
        np.sqrt(np.mean(np.square(errors))),
        np.max(np.abs(errors)),
        np.mean(rewards),
        np.sqrt(np.mean(np.square(np.diff(actions, axis=0)))) if len(actions) > 1 else 0.0,
        *np.mean(forces, axis=(0, 2)),
    )
    return {column: float(value) for column, value in zip(JOINT_METRIC_COLUMNS, values, strict=True)}
