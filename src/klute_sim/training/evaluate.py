"""Evaluation of a policy against the baseline of its environment, with the same random numbers."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from klute_sim.errors import InputError
from klute_sim.training.environments import Act, TrainingEnvironment

EVALUATION_SEED_OFFSET = 10**12
"""Offset between the seeds of training, which count its steps, and those of evaluation."""


def run_episodes(
    environment: TrainingEnvironment, policy: Act, options: Mapping[str, Any], n_episodes: int, seed: int
) -> dict[str, list[float]]:
    """Return the return, steps, all totals and all errors of ``n_episodes`` episodes of ``policy``.

    The errors of the ``environment`` are root mean squares over an episode, named ``rms_`` and their entry of ``info``.
    """
    envs = environment.make_envs(n_episodes, **options)
    observation, _ = envs.reset(seed=seed + EVALUATION_SEED_OFFSET)
    names = ("return", "steps", *environment.totals)
    sums = {name: np.zeros(n_episodes) for name in names}
    squares = {name: np.zeros(n_episodes) for name in environment.errors}
    active = np.ones(n_episodes, dtype=np.bool_)
    while active.any():
        observation, reward, terminated, truncated, info = envs.step(policy(observation))
        for name, value in {**info, "return": reward, "steps": np.ones(n_episodes)}.items():
            if name in sums:
                sums[name][active] += value[active]
            if name in squares:
                squares[name][active] += value[active] ** 2
        active &= ~(terminated | truncated)  # episodes that have ended are stepped, too, but not counted
    envs.close()
    rms = {f"rms_{name}": np.sqrt(values / sums["steps"]) for name, values in squares.items()}
    return {name: values.tolist() for name, values in {**sums, **rms}.items()}


def check_baseline(environment: TrainingEnvironment, options: Mapping[str, Any]) -> None:
    """Raise InputError when the ``environment`` with ``options`` does not take the actions of its baseline."""
    try:
        environment.make_envs(1, **{**options, **environment.baseline_options}).close()
    except InputError as error:
        raise InputError(
            f"the policy could not be compared with its baseline, the {environment.baseline}: {error}"
        ) from None


def compare_with_baseline(
    environment: TrainingEnvironment, policy: Act, options: Mapping[str, Any], n_episodes: int, seed: int
) -> dict[str, Any]:
    """Compare ``policy`` with the baseline of the ``environment`` over ``n_episodes`` episodes."""
    policy_totals = run_episodes(environment, policy, options, n_episodes, seed)
    baseline_options = {**options, **environment.baseline_options}
    baseline_totals = run_episodes(environment, environment.make_baseline(), baseline_options, n_episodes, seed)
    gain = np.array(policy_totals["return"]) - np.array(baseline_totals["return"])
    return {
        "episodes": n_episodes,
        "baseline_name": environment.baseline,
        "policy": _mean_totals(policy_totals),
        "baseline": _mean_totals(baseline_totals),
        "gain": float(gain.mean()),
        "gain_standard_error": float(gain.std(ddof=1) / np.sqrt(n_episodes)),
        "n_better_episodes": int((gain > 0.0).sum()),
    }


def _mean_totals(sums: Mapping[str, list[float]]) -> dict[str, float]:
    return {name: float(np.mean(values)) for name, values in sums.items()}
