"""Noise of single trials: one loose connector makes one repeat several times as noisy as the others."""

from collections.abc import Mapping, Sequence

import numpy as np

from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.noise.autocorrelation import MAX_INTERVAL_RATIO
from klute_sim.diagnosis.noise.repeats import Residuals, group_repeats
from klute_sim.types import Array

MIN_NOISE_RATIO = 1.5
"""Ratio of a trial's noise to that of its repeats above which the trial has a noise of its own (assumed)."""
MIN_DIFFERENCES = 30
"""Number of differences between samples from which on the noise of a single trial is estimated (assumed)."""


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
