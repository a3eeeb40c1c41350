"""Train a policy without a learning library: the cross-entropy method with one simulation per candidate.

A candidate is a linear function of the observations that changes the hand-tuned profile by at most 1 bar. Each
generation simulates all candidates at once, selects the best, and samples the next candidates around them.

    python examples/cross_entropy.py                  # about a minute on two cores
    python examples/cross_entropy.py --generations 5
"""

import argparse
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import klute_sim  # noqa: F401  (registers the environments)

Array = NDArray[np.float64]

OBSERVATION_SCALE = np.array([0.2, 2.0, 0.5, 3.0, 1.0, 3.0, 1.0, 1.0])
"""Typical magnitudes of the observations."""
CONDITIONS = {
    "device": {"muscle.c10_kpa": 0.1, "tendon.stiffness_1_n_per_mm": 0.2},
    "effects": {"pressure_lag": {"time_constant_s": (0.0, 0.05)}},
}
"""Rubber, tendon and pressure lag that each episode draws, so that a gain is not that of one condition."""
ELITE_FRACTION = 0.2
"""Fraction of the candidates around which the next ones are sampled."""


def compute_returns(envs: gymnasium.vector.VectorEnv[Any, Any, Any], candidates: Array, seed: int) -> Array:
    """Return the total reward of an episode of each candidate (n, 9): a weight for each observation, and a constant."""
    observations, _ = envs.reset(seed=seed)
    total, active = np.zeros(len(candidates)), np.ones(len(candidates), dtype=bool)
    while active.any():
        linear_outputs = np.sum(candidates[:, :-1] * observations / OBSERVATION_SCALE, axis=1) + candidates[:, -1]
        observations, reward, terminated, truncated, _ = envs.step(np.tanh(linear_outputs)[:, None].astype(np.float32))
        total += np.where(active, reward, 0.0)
        active &= ~(terminated | truncated)
    return total


def main() -> None:
    """Train and print the progress."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--generations", type=int, default=30)
    parser.add_argument("--candidates", type=int, default=32)
    parser.add_argument("--strides", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng, n_candidates = np.random.default_rng(arguments.seed), arguments.candidates
    options: dict[str, Any] = {"action": "residual", "residual_bar": 1.0, "strides": arguments.strides}
    options["domain_randomization"] = CONDITIONS
    envs = gymnasium.make_vec("klute_sim/AnkleGait-v2", n_candidates, "vector_entry_point", **options)
    profile = compute_returns(envs, np.zeros((n_candidates, 9)), arguments.seed)
    print(f"hand-tuned profile: {profile.mean():.1f}")
    mean, deviation = np.zeros(9), np.full(9, 0.5)
    for generation in range(1, arguments.generations + 1):
        candidates = mean + deviation * rng.standard_normal((n_candidates, 9))
        totals = compute_returns(envs, candidates, arguments.seed + generation)
        elite = candidates[np.argsort(totals)[-max(2, round(ELITE_FRACTION * n_candidates)) :]]
        mean, deviation = elite.mean(axis=0), elite.std(axis=0) + 0.02
        print(f"generation {generation}: mean {totals.mean():.1f}, best {totals.max():.1f}")
    learned = compute_returns(envs, np.tile(mean, (n_candidates, 1)), arguments.seed)
    gain = learned - profile  # on the same episodes
    error = gain.std(ddof=1) / np.sqrt(n_candidates)
    print(f"learned: {learned.mean():.1f}, a gain of {gain.mean():.1f} +- {error:.1f} (standard error)")


if __name__ == "__main__":
    main()
