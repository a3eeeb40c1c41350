"""Prescribed channels that were recorded in few steps, as a length with a resolution of 0.1 mm.

The steps are neither motion nor noise: a muscle with dry friction that follows them sticks and slips. Each sample says
only that the motion is within half a step of it. The motion is taken to be the smoothest curve that is: the one with
the smallest third differences (Whittaker, Proc. Edinb. Math. Soc. 41:63, 1923), where samples that it misses by more
than half a step weigh more until it does not. The steps of a command may be those of its log or those of a converter,
which do act (:mod:`klute_sim.diagnosis.trial_preparation`).
"""

from collections.abc import Sequence
from dataclasses import replace
from math import comb

import numpy as np
from scipy.linalg import solveh_banded

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.diagnosis.experiments.denoise import MAX_INTERVAL_VARIATION
from klute_sim.diagnosis.experiments.held_samples import COMMAND_PREFIX
from klute_sim.types import Array

MAX_LEVELS = 2000
"""Largest number of steps in the range of a motion; finer ones are lost in the noise of a load cell (assumed)."""
MIN_CHANGES = 20
"""Fewest changes that show steps, and fewest changes of their size (assumed)."""
MAX_MULTIPLE = 4
"""Largest number of steps that the smallest change of a fast motion may be (assumed)."""
STEP_TOLERANCE = 0.02
"""Largest deviation of a value from a whole number of steps, in steps (assumed)."""
STEP_NOISE = 12.0**-0.5
"""Standard deviation of the rounding error, in steps."""
MAX_JUMP = 6.0
"""Largest third difference that counts as noise, in steps; larger ones are quick motions (assumed)."""
MAX_NOISE = 0.6
"""Largest white noise, in steps; more hides the steps, and is averaged like any noise (assumed)."""
NOISE_SIGMAS = 2.5
"""Standard deviations of the noise before rounding that are added to half a step (assumed)."""
CUTOFF_HZ = 12.0
"""Frequency above which the curve follows the samples only where it must [Hz] (assumed: motions of a bench are slower).
Of 500 Hz and steps of 0.1 mm, an error of 0.05 steps remains."""
N_REWEIGHTINGS = 40
"""Largest number of times that the weights grow."""
MISSED_OVERSHOOT, MAX_MISSED_FRACTION = 1.5, 0.01
"""Deviation of the curve over the permitted one before any weight grows, and largest fraction of samples with a larger
one (assumed: it was 0.001 in motions of up to 1.2 Hz, and 0.1 where a machine reversed quickly)."""
MAX_OVERSHOOT, MAX_WEIGHT_RATIO = 1.05, 4.0
"""Largest deviation of the curve over the permitted one, and largest ratio by which a weight grows at a time."""
N_DIFFERENCES = 3
"""Order of the differences."""


def smooth_quantized_inputs(trial: Trial, *, with_commands: bool = False) -> Trial:
    """Return ``trial`` with smooth motions in place of those in few steps; ``with_commands`` also smooth commands."""
    return replace(
        trial,
        prescribed={
            name: series if name.startswith(COMMAND_PREFIX) and not with_commands else _smooth(series) or series
            for name, series in trial.prescribed.items()
        },
    )


def has_quantized_commands(trials: Sequence[Trial]) -> bool:
    """Return whether a command of ``trials`` changes in few steps."""
    return any(
        name.startswith(COMMAND_PREFIX) and _smooth(series) is not None
        for trial in trials
        for name, series in trial.prescribed.items()
    )


def describe_quantized_inputs(trials: Sequence[Trial], *, with_commands: bool = False) -> list[str]:
    """Return a sentence about the channels of ``trials`` that were made smooth; none without any."""
    levels: dict[str, int] = {}
    for trial in trials:
        for name, series in trial.prescribed.items():
            if name.startswith(COMMAND_PREFIX) and not with_commands:
                continue
            step = _find_step(series)
            if step is not None and _smooth(series) is not None:
                levels[name] = max(levels.get(name, 0), round(float(np.ptp(series.value)) / step))
    if not levels:
        return []
    names = ", ".join(f"'{name}' ({count} steps in its range)" for name, count in levels.items())
    return [f"These inputs were recorded in few steps and are taken to be smooth: {names}."]


def _smooth(series: TimeSeries) -> TimeSeries | None:
    """Return the smooth ``series``; None where it does not change in few steps, or moves too quickly."""
    step = _find_step(series)
    if step is None:
        return None
    noise = _estimate_noise(series.value, step)
    half_width = step * (0.5 + NOISE_SIGMAS * float(np.sqrt(max(0.0, noise**2 - STEP_NOISE**2))))
    smoothness = (2.0 * np.pi * CUTOFF_HZ * series.sampling_interval) ** (-2 * N_DIFFERENCES)
    curve = find_smoothest_curve(series.value, half_width, smoothness)
    return None if curve is None else series._replace(value=curve)


def _find_step(series: TimeSeries) -> float | None:
    """Return the step of a channel [SI]; None where it does not change in few steps."""
    value, intervals = series.value, np.diff(series.time)
    if not np.isfinite(value).all() or len(value) <= 2 * N_DIFFERENCES:
        return None
    changes = np.diff(value)
    span = float(np.ptp(value))
    changes = np.abs(changes[np.abs(changes) > span / (10.0 * MAX_LEVELS)])
    if len(changes) < MIN_CHANGES or np.ptp(intervals) > MAX_INTERVAL_VARIATION * intervals.mean():
        return None
    for divisor in range(1, MAX_MULTIPLE + 1):
        step = float(changes.min()) / divisor
        step = float(changes.sum() / np.round(changes / step).sum())
        levels = (value - value[0]) / step
        if span / step <= MAX_LEVELS and np.abs(levels - np.round(levels)).max() <= STEP_TOLERANCE:
            # Ramps at one speed change by the same amount in every sample, whatever the resolution is.
            sizes = np.abs(np.diff(np.round(levels)))
            varies = np.count_nonzero(np.diff(sizes)) >= MIN_CHANGES
            return step if varies and _estimate_noise(value, step) <= MAX_NOISE else None
    return None


def _estimate_noise(value: Array, step: float) -> float:
    """Return the standard deviation of the white noise in ``value`` (n,) with its rounding error, in steps.

    A median, which :func:`~klute_sim.diagnosis.experiments.denoise.estimate_white_noise` takes, would itself be a whole
    number of steps.
    """
    third = np.minimum(np.abs(np.diff(value, N_DIFFERENCES)) / step, MAX_JUMP)
    return float(np.sqrt(np.mean(third**2) / comb(2 * N_DIFFERENCES, N_DIFFERENCES)))


def find_smoothest_curve(values: Array, half_width: float, smoothness: float) -> Array | None:
    """Return the smoothest curve within ``half_width`` of ``values`` (n,): (n,), equally spaced, in the same unit.

    ``smoothness`` is the weight of the squared third differences. None where a curve without regard to ``half_width``
    misses too many ``values``: a quick motion is not smooth.
    """
    n = len(values)
    penalty = smoothness * _compute_gram_matrix(n)
    weights, curve = np.ones(n), values
    for index in range(N_REWEIGHTINGS):
        matrix = penalty.copy()
        matrix[0] += weights
        curve = solveh_banded(matrix, weights * values, lower=True)
        overshoot = np.abs(curve - values) / half_width
        if index == 0 and np.mean(overshoot > MISSED_OVERSHOOT) > MAX_MISSED_FRACTION:
            return None
        if overshoot.max() <= MAX_OVERSHOOT:
            break
        weights *= np.clip(overshoot, 1.0, MAX_WEIGHT_RATIO) ** 2
    return np.asarray(np.clip(curve, values - MAX_OVERSHOOT * half_width, values + MAX_OVERSHOOT * half_width))


def _compute_gram_matrix(n: int) -> Array:
    """Return ``D' D`` for the matrix D of third differences of n values, as its lower diagonals (4, n)."""
    coefficients = np.array([1.0])
    for _ in range(N_DIFFERENCES):
        coefficients = np.convolve(coefficients, [1.0, -1.0])
    diagonals = np.zeros((N_DIFFERENCES + 1, n))
    for first in range(N_DIFFERENCES + 1):
        for second in range(first, N_DIFFERENCES + 1):
            diagonals[second - first, first : first + n - N_DIFFERENCES] += coefficients[first] * coefficients[second]
    return diagonals
