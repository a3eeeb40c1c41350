"""A policy against the hand-tuned profile: the same environment, the same draws."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.envs.ankle_gait_vector import AnkleGaitVectorEnv
from klute_sim.envs.tasks.reward import REWARD_TERMS

EVALUATION_SEED_OFFSET = 10**12
"""Between the seeds of training, which count its steps, and of evaluation."""


def run_episodes(
    policy: Callable[[NDArray[np.float32]], NDArray[np.float32]], options: Mapping[str, Any], n_episodes: int, seed: int
) -> dict[str, list[float]]:
    """Of ``count`` episodes under ``policy``: return, steps, air [g] and the sum of each term of the reward."""
    envs = AnkleGaitVectorEnv(n_episodes, **options)
    observed, _ = envs.reset(seed=seed + EVALUATION_SEED_OFFSET)
    names = ("return", "steps", "air_g", *REWARD_TERMS)
    sums = {name: np.zeros(n_episodes) for name in names}
    live = np.ones(n_episodes, dtype=np.bool_)
    while live.any():
        observed, reward, terminated, truncated, told = envs.step(policy(observed))
        for name, value in {**told, "return": reward, "steps": np.ones(n_episodes)}.items():
            if name in sums:
                sums[name][live] += value[live]
        live &= ~(terminated | truncated)  # those that have ended walk on, and nobody looks
    envs.close()
    return {name: values.tolist() for name, values in sums.items()}


def compare_with_profile(
    policy: Callable[[NDArray[np.float32]], NDArray[np.float32]], options: Mapping[str, Any], n_episodes: int, seed: int
) -> dict[str, Any]:
    """What :func:`episodes` finds of ``policy`` and of the hand-tuned profile, and in how many the policy is better."""
    ours = run_episodes(policy, options, n_episodes, seed)
    # The profile at the estimated phase is a residual of nothing.
    still = {**options, "action": "residual"}
    theirs = run_episodes(lambda observed: np.zeros((n_episodes, 1), dtype=np.float32), still, n_episodes, seed)
    gain = np.array(ours["return"]) - np.array(theirs["return"])
    return {
        "episodes": n_episodes,
        "policy": _mean_totals(ours),
        "profile": _mean_totals(theirs),
        "gain": float(gain.mean()),
        "gain_standard_error": float(gain.std(ddof=1) / np.sqrt(n_episodes)),
        "better_in": int((gain > 0.0).sum()),
    }


def _mean_totals(sums: Mapping[str, list[float]]) -> dict[str, float]:
    return {name: float(np.mean(values)) for name, values in sums.items()}
