"""Learn to walk without a learning library: the cross-entropy method, one simulation per candidate.

A candidate is a line through the observations, and changes the hand-tuned profile by at most a bar. Every generation
walks all candidates at once, keeps the best and draws the next ones around them.

    python examples/cross_entropy.py                  # about two minutes on two cores
    python examples/cross_entropy.py --generations 5
"""

import argparse
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import klute_sim  # noqa: F401  (registers the environments)

Array = NDArray[np.float64]

SCALE = np.array([0.2, 2.0, 0.5, 3.0, 1.0, 3.0, 1.0, 1.0])
"""Usual sizes of the observations."""
KEPT = 0.2
"""Share of the candidates that the next ones are drawn around."""


def returns(envs: gymnasium.vector.VectorEnv[Any, Any, Any], candidates: Array, seed: int) -> Array:
    """Of an episode of each candidate (n, 9): a weight for each observation, and a constant."""
    observed, _ = envs.reset(seed=seed)
    total, live = np.zeros(len(candidates)), np.ones(len(candidates), dtype=bool)
    while live.any():
        lines = np.sum(candidates[:, :-1] * observed / SCALE, axis=1) + candidates[:, -1]
        observed, reward, terminated, truncated, _ = envs.step(np.tanh(lines)[:, None].astype(np.float32))
        total += np.where(live, reward, 0.0)
        live &= ~(terminated | truncated)
    return total


def main() -> None:
    """Learn, and say how it goes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--generations", type=int, default=30)
    parser.add_argument("--candidates", type=int, default=32)
    parser.add_argument("--strides", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    random, count = np.random.default_rng(chosen.seed), chosen.candidates
    options = {"action": "residual", "residual_bar": 1.0, "strides": chosen.strides}
    envs = gymnasium.make_vec("klute_sim/AnkleGait-v1", count, "vector_entry_point", **options)
    print(f"hand-tuned profile: {returns(envs, np.zeros((count, 9)), chosen.seed).mean():.1f}")
    middle, spread = np.zeros(9), np.full(9, 0.5)
    for generation in range(1, chosen.generations + 1):
        candidates = middle + spread * random.standard_normal((count, 9))
        found = returns(envs, candidates, chosen.seed + generation)
        best = candidates[np.argsort(found)[-max(2, round(KEPT * count)) :]]
        middle, spread = best.mean(axis=0), best.std(axis=0) + 0.02
        print(f"generation {generation}: mean {found.mean():.1f}, best {found.max():.1f}")
    print(f"learned: {returns(envs, np.tile(middle, (count, 1)), chosen.seed).mean():.1f}")


if __name__ == "__main__":
    main()
