"""Channels of an instrument that is slower than the log, which holds each reading until the next one arrives.

The steps of such a channel are neither motion nor noise. Its readings are the samples at which it is updated.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.diagnosis.experiments.interpolation import shows_updates

COMMAND_PREFIX = "pressure_command"
"""Beginning of the names of commands, which a controller may hold: their steps act."""


def drop_held_samples(trial: Trial) -> Trial:
    """Return ``trial`` with the readings only of the channels whose samples the log holds; commands stay."""
    return replace(
        trial,
        prescribed={name: _drop_held_samples(name, series) for name, series in trial.prescribed.items()},
        measured={name: _drop_held_samples(name, series) for name, series in trial.measured.items()},
    )


def describe_held_samples(trials: Sequence[Trial]) -> list[str]:
    """Return a sentence about the channels whose samples the log holds in one of ``trials``; none without any."""
    periods: dict[str, float] = {}
    for trial in trials:
        for name, series in (*trial.prescribed.items(), *trial.measured.items()):
            n_held = _count_held_samples(name, series)
            if n_held > 1:
                periods[name] = max(periods.get(name, 0.0), n_held * series.sampling_interval)
    if not periods:
        return []
    names = ", ".join(f"'{name}' (for {1e3 * period:.3g} ms)" for name, period in periods.items())
    return [f"The log repeats each reading of these channels until the next one, and only new ones count: {names}."]


def _count_held_samples(name: str, series: TimeSeries) -> int:
    """Return for how many samples the log usually holds a reading; 1 for a channel with a reading in each sample."""
    if name.startswith(COMMAND_PREFIX) or not np.isfinite(series.value).all() or not shows_updates(series):
        return 1
    return round(float(np.median(np.diff(np.flatnonzero(np.diff(series.value))))))


def _drop_held_samples(name: str, series: TimeSeries) -> TimeSeries:
    """Return the readings of ``series``: its changes, and where two in a row are equal, those between them."""
    n_held = _count_held_samples(name, series)
    if n_held == 1:
        return series
    starts = np.r_[0, np.flatnonzero(np.diff(series.value)) + 1]
    ends = np.r_[starts[1:], len(series.value)]
    # A reading may come a sample early or late.
    readings = [
        np.arange(start, max(start + 1, end - n_held // 2), n_held) for start, end in zip(starts, ends, strict=True)
    ]
    indices = np.concatenate(readings)
    return TimeSeries(series.time[indices], series.value[indices])
