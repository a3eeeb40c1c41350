"""Environments in which a policy can be trained, and the baseline of each of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.envs.ankle_gait_vector import AnkleGaitVectorEnv
from klute_sim.envs.ankle_walk_vector import AnkleWalkVectorEnv
from klute_sim.envs.antagonist_joint_vector import AntagonistJointVectorEnv
from klute_sim.envs.base.vector import DeviceVectorEnv
from klute_sim.envs.joint_pid import PidController
from klute_sim.envs.tasks import joint_task
from klute_sim.envs.tasks import reward as gait_reward
from klute_sim.envs.tasks.walk import reward as walk_reward

Act = Callable[[NDArray[np.float32]], NDArray[np.float32]]
"""Policy: actions (n, actions) for observations (n, observations)."""
PROSTHESIS_SCALE = (0.2, 2.0, 0.5, 3.0, 1.0, 3.0, 1.0, 1.0)
"""Typical magnitudes of :data:`klute_sim.envs.tasks.instruments.OBSERVATIONS` in walking, in their units (assumed)."""
JOINT_SCALE = (0.3, 2.0, 0.3, 2.0, 2.0, 2.0)
"""Typical magnitudes of :data:`klute_sim.envs.tasks.joint_task.OBSERVATIONS`, in their units (assumed)."""


def keep_base(observations: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return actions (n, 1) of zero for ``observations`` (n, 8): a residual that leaves the base as it is."""
    return np.zeros((len(observations), 1), dtype=np.float32)


@dataclass(frozen=True, kw_only=True)
class TrainingEnvironment:
    """An environment, what its policy gets, and the controller that it is compared with."""

    id: str
    """Name in the registry of Gymnasium."""
    make_envs: Callable[..., DeviceVectorEnv]
    """Constructor of its vector form."""
    config_file: str
    """Shipped configuration."""
    observation_scale: tuple[float, ...]
    """Scale of each observation, by which it is divided before the network."""
    totals: tuple[str, ...]
    """Entries of ``info`` that the evaluation sums over an episode."""
    errors: tuple[str, ...] = ()
    """Entries of ``info`` of which the evaluation takes the root mean square over an episode."""
    baseline: str
    """What the baseline is."""
    make_baseline: Callable[[], Act]
    """Constructor of the baseline at the start of an episode."""
    baseline_options: Mapping[str, Any] = field(default_factory=dict)
    """Keywords of the environment that the baseline needs."""


TRAINING_ENVIRONMENTS = {
    "gait": TrainingEnvironment(
        id="klute_sim/AnkleGait-v2",
        make_envs=AnkleGaitVectorEnv,
        config_file="gait.toml",
        observation_scale=PROSTHESIS_SCALE,
        totals=("air_g", *gait_reward.REWARD_TERMS),
        baseline="hand-tuned profile",
        make_baseline=lambda: keep_base,
        baseline_options={"action": "residual"},
    ),
    "walk": TrainingEnvironment(
        id="klute_sim/AnkleWalk-v0",
        make_envs=AnkleWalkVectorEnv,
        config_file="walk.toml",
        observation_scale=PROSTHESIS_SCALE,
        totals=walk_reward.REWARD_TERMS,
        baseline="base controller",
        make_baseline=lambda: keep_base,
        baseline_options={"action": "residual"},
    ),
    "joint": TrainingEnvironment(
        id="klute_sim/AntagonistJoint-v0",
        make_envs=AntagonistJointVectorEnv,
        config_file="joint.toml",
        observation_scale=JOINT_SCALE,
        totals=joint_task.REWARD_TERMS,
        errors=("angle_error_deg",),
        baseline="PID controller",
        make_baseline=lambda: PidController().act,
    ),
}
"""Environments by the names of ``--env``."""
