"""Evaluation of a policy against the hand-tuned profile in the same environment with the same random numbers."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.envs.ankle_gait_vector import AnkleGaitVectorEnv
from klute_sim.envs.tasks.reward import REWARD_TERMS

EVALUATION_SEED_OFFSET = 10**12
"""Offset between the seeds of training, which count its steps, and those of evaluation."""


def run_episodes(
    policy: Callable[[NDArray[np.float32]], NDArray[np.float32]], options: Mapping[str, Any], n_episodes: int, seed: int
) -> dict[str, list[float]]:
    """Return the return, steps, air [g] and sum of each reward term of ``n_episodes`` episodes of ``policy``."""
    envs = AnkleGaitVectorEnv(n_episodes, **options)
    observation, _ = envs.reset(seed=seed + EVALUATION_SEED_OFFSET)
    names = ("return", "steps", "air_g", *REWARD_TERMS)
    sums = {name: np.zeros(n_episodes) for name in names}
    active = np.ones(n_episodes, dtype=np.bool_)
    while active.any():
        observation, reward, terminated, truncated, info = envs.step(policy(observation))
        for name, value in {**info, "return": reward, "steps": np.ones(n_episodes)}.items():
            if name in sums:
                sums[name][active] += value[active]
        active &= ~(terminated | truncated)  # episodes that have ended are stepped, too, but not counted
    envs.close()
    return {name: values.tolist() for name, values in sums.items()}


def compare_with_profile(
    policy: Callable[[NDArray[np.float32]], NDArray[np.float32]], options: Mapping[str, Any], n_episodes: int, seed: int
) -> dict[str, Any]:
    """Compare ``policy`` with the hand-tuned profile over ``n_episodes`` episodes."""
    policy_totals = run_episodes(policy, options, n_episodes, seed)
    # A residual of zero is the profile at the estimated phase.
    residual_options = {**options, "action": "residual"}
    profile_totals = run_episodes(
        lambda observation: np.zeros((n_episodes, 1), dtype=np.float32), residual_options, n_episodes, seed
    )
    gain = np.array(policy_totals["return"]) - np.array(profile_totals["return"])
    return {
        "episodes": n_episodes,
        "policy": _mean_totals(policy_totals),
        "profile": _mean_totals(profile_totals),
        "gain": float(gain.mean()),
        "gain_standard_error": float(gain.std(ddof=1) / np.sqrt(n_episodes)),
        "n_better_episodes": int((gain > 0.0).sum()),
    }


def _mean_totals(sums: Mapping[str, list[float]]) -> dict[str, float]:
    return {name: float(np.mean(values)) for name, values in sums.items()}
