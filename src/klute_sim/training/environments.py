"""Environments in which a policy can be trained, and what each of them compares it with."""

from collections.abc import Callable
from dataclasses import dataclass

from klute_sim.envs.ankle_gait_vector import AnkleGaitVectorEnv
from klute_sim.envs.ankle_walk_vector import AnkleWalkVectorEnv
from klute_sim.envs.base.vector import DeviceVectorEnv
from klute_sim.envs.tasks import reward as gait_reward
from klute_sim.envs.tasks.walk import reward as walk_reward


@dataclass(frozen=True)
class TrainingEnvironment:
    """An environment whose observations are :data:`klute_sim.envs.tasks.instruments.OBSERVATIONS`."""

    id: str
    """Name in the registry of Gymnasium."""
    make_envs: Callable[..., DeviceVectorEnv]
    """Constructor of its vector form."""
    config_file: str
    """Shipped configuration."""
    totals: tuple[str, ...]
    """Entries of ``info`` that the evaluation sums over an episode."""
    baseline: str
    """What a residual of zero is."""


TRAINING_ENVIRONMENTS = {
    "gait": TrainingEnvironment(
        "klute_sim/AnkleGait-v2",
        AnkleGaitVectorEnv,
        "gait.toml",
        ("air_g", *gait_reward.REWARD_TERMS),
        "hand-tuned profile",
    ),
    "walk": TrainingEnvironment(
        "klute_sim/AnkleWalk-v0",
        AnkleWalkVectorEnv,
        "walk.toml",
        walk_reward.REWARD_TERMS,
        "base controller",
    ),
}
"""Environments by the names of ``--env``."""
