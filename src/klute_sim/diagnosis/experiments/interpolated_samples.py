"""Channels of an instrument that is slower than the log, whose samples between its readings were interpolated.

Resampling a record to the rate of the log joins its readings by straight lines. The samples between them add nothing,
have less noise, and cut the corners of jumps. A channel that is held between its readings is described in
:mod:`~klute_sim.diagnosis.experiments.held_samples`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.types import Array

MAX_SAMPLES_PER_READING = 50
"""Largest number of samples from one reading to the next that is looked for (assumed)."""
MIN_READINGS = 20
"""Fewest readings that show that the samples between them were interpolated (assumed)."""
MIN_CHANGE_RATIO = 3.0
"""Median change of the slope at readings, over the largest one between them (assumed)."""
MAX_ROUNDING_STEPS = 4.0
"""Largest change of the slope between readings, times the sampling interval, in steps of the log (assumed: twice that
of three rounded samples)."""
ROUNDING_QUANTILE = 0.99
"""Fraction of the samples between readings that have to be on straight lines (assumed)."""
MIN_LINE_FRACTION = 0.45
"""Fraction of all samples below which no readings are looked for: every second one is on a line, or more."""


def drop_interpolated_samples(trial: Trial) -> Trial:
    """Return ``trial`` with the readings only of the measured channels whose other samples were interpolated.

    A prescribed channel may follow straight lines in truth.
    """
    return replace(trial, measured={name: _select_readings(series) for name, series in trial.measured.items()})


def describe_interpolated_samples(trials: Sequence[Trial]) -> list[str]:
    """Return a sentence about the channels with interpolated samples in one of ``trials``; none without any."""
    periods: dict[str, float] = {}
    for trial in trials:
        for name, series in trial.measured.items():
            readings = _find_readings(series)
            if readings is not None:
                periods[name] = max(periods.get(name, 0.0), readings.step * series.sampling_interval)
    if not periods:
        return []
    names = ", ".join(f"'{name}' (every {1e3 * period:.3g} ms)" for name, period in periods.items())
    return [f"The log interpolates linearly between the readings of these channels, and only those count: {names}."]


def _select_readings(series: TimeSeries) -> TimeSeries:
    readings = _find_readings(series)
    return series if readings is None else TimeSeries(series.time[readings], series.value[readings])


def _find_readings(series: TimeSeries) -> slice | None:
    """Return which samples of ``series`` are readings; None if all are.

    The slope changes at readings only, which are equally many samples apart.
    """
    if not np.isfinite(series.value).all():
        return None
    changes = np.abs(np.diff(np.diff(series.value) / np.diff(series.time))) * series.sampling_interval
    max_change = MAX_ROUNDING_STEPS * _find_resolution(series.value)
    if np.quantile(changes, MIN_LINE_FRACTION) > max_change:
        return None
    # Every divisor of the true number of samples per reading agrees with the readings, too.
    for step in range(min(MAX_SAMPLES_PER_READING, len(changes) // MIN_READINGS), 1, -1):
        rows = changes[: len(changes) // step * step].reshape(-1, step)
        medians = np.median(rows, axis=0)
        first = int(np.argmax(medians))
        between = float(np.quantile(np.delete(rows, first, axis=1), ROUNDING_QUANTILE))
        if between <= max_change and medians[first] > max(MIN_CHANGE_RATIO * between, max_change):
            return slice((first + 1) % step, None, step)
    return None


def _find_resolution(values: Array) -> float:
    """Return the smallest difference between two different ``values``, or what floating-point numbers resolve."""
    differences = np.diff(np.unique(values))
    return max(float(differences.min(initial=np.inf)), float(np.spacing(np.abs(values).max())))
