"""Noise of single trials, by the differences between their samples: a loose connector, and trials without repeats."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.stats import norm

from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.noise.autocorrelation import MAX_INTERVAL_RATIO
from klute_sim.diagnosis.noise.repeats import Residuals, group_repeats
from klute_sim.types import Array

MIN_NOISE_RATIO = 1.5
"""Ratio of a trial's noise to that of its repeats above which the trial has a noise of its own (assumed)."""
MIN_DIFFERENCES = 30
"""Number of differences between samples from which on the noise of a single trial is estimated (assumed)."""
CORRELATION_LIMIT_S = 0.05
"""Time [s] over which the noise of instruments is uncorrelated, and a misfit hardly bends (assumed)."""


def estimate_noise_ratios(experiments: Sequence[Experiment], residuals: Residuals) -> list[dict[str, float]]:
    """Return for each experiment: channel -> ratio of its noise to that of its other repeats, at least 1.

    The noise of a single trial shows in the differences between successive residuals, in which the misfit cancels.
    Their median is robust against single jumps. Differences of correlated noise grow with the sampling interval, so
    repeats at other rates do not count. Ratios below :data:`MIN_NOISE_RATIO` are 1.
    """
    deviations = [{channel: _estimate_deviation(values) for channel, values in row.items()} for row in residuals]
    ratios: list[dict[str, float]] = [{} for _ in experiments]
    for members in group_repeats(experiments).values():
        for index in members:
            for channel, deviation in deviations[index].items():
                interval = experiments[index].measured[channel].sampling_interval
                others = [
                    deviations[k][channel]
                    for k in members
                    if k != index and channel in deviations[k] and _is_equal_rate(experiments[k], channel, interval)
                ]
                reference = float(np.median([value for value in others if value > 0.0] or [0.0]))
                ratio = deviation / reference if reference > 0.0 else 1.0
                ratios[index][channel] = ratio if ratio > MIN_NOISE_RATIO else 1.0
    return ratios


def estimate_fast_noise(experiments: Sequence[Experiment], residuals: Residuals) -> dict[str, float]:
    """Return channel -> standard deviation [SI] of what changes in its residuals within :data:`CORRELATION_LIMIT_S`.

    It is that of noise which is uncorrelated over this time, with the median of the second differences over it. Their
    standard deviation is ``sqrt(6)`` times that of the noise (Gasser, Sroka & Jennen-Steinmetz 1986, Biometrika
    73:625). A misfit that changes slowly cancels in them. Channels that are sampled more slowly, or show fewer than
    :data:`MIN_DIFFERENCES` differences, are left out.
    """
    differences: dict[str, list[Array]] = {}
    for e, row in zip(experiments, residuals, strict=True):
        for channel, values in row.items():
            lag = math.floor(CORRELATION_LIMIT_S / e.measured[channel].sampling_interval * (1.0 + 1e-9))
            if 1 <= lag < len(values) // 2:
                second = values[2 * lag :] - 2.0 * values[lag:-lag] + values[: -2 * lag]
                differences.setdefault(channel, []).append(np.abs(second))
    return {
        channel: float(np.median(pooled) / (norm.ppf(0.75) * np.sqrt(6.0)))
        for channel, parts in differences.items()
        if len(pooled := np.concatenate(parts)) >= MIN_DIFFERENCES and np.median(pooled) > 0.0
    }


def _is_equal_rate(experiment: Experiment, channel: str, interval: float) -> bool:
    ratio = experiment.measured[channel].sampling_interval / interval
    return 1.0 / MAX_INTERVAL_RATIO < ratio < MAX_INTERVAL_RATIO


def _estimate_deviation(residual: Array) -> float:
    differences = np.diff(residual)
    return float(np.median(np.abs(differences))) if len(differences) >= MIN_DIFFERENCES else 0.0


def describe_noisy_trials(experiments: Sequence[Experiment], ratios: Sequence[Mapping[str, float]]) -> list[str]:
    """Return a sentence for each trial that is noisier than its repeats and therefore counts less."""
    return [
        f"'{channel}' of trial '{e.name}' is {ratio:.1f} times as noisy as in its repeats, so it counts less."
        for e, row in zip(experiments, ratios, strict=True)
        for channel, ratio in row.items()
        if ratio > 1.0
    ]
