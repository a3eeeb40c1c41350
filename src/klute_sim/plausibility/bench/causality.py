"""Which of two channels is the cause: it changes first, and more abruptly."""

import numpy as np

from klute_sim.plausibility.bench.trial import RecordedTrial
from klute_sim.plausibility.samples import compute_correlation
from klute_sim.types import Array

MAX_SAMPLES = 2000
"""Maximum number of samples that are compared."""
MAX_LAG_SAMPLES = 200
"""Maximum lag that is tried."""
MIN_CORRELATION = 0.9
"""Smallest correlation of two channels of which one causes the other, after the lag."""
MAX_REMAINDER = 0.6
"""Largest ratio of what the correlation lacks to 1 after the lag to what it lacks before."""
MIN_SHARPNESS_RATIO = 1.5
"""Smallest ratio of the largest jumps: a regulator smooths its command (assumed)."""


def leads(trial: RecordedTrial, first: str, second: str) -> bool:
    """Return whether channel ``first`` changes before ``second`` and jumps where ``second`` does not."""
    if first not in trial.channels or second not in trial.channels:
        return False
    a, b = (trial.channels[name] for name in (first, second))
    start, end = max(a.time[0], b.time[0]), min(a.time[-1], b.time[-1])
    interval = max(float(np.median(np.diff(a.time))), float(np.median(np.diff(b.time))))
    n_samples = min(int((end - start) / interval), MAX_SAMPLES)
    if n_samples < 4 * 5:
        return False
    time = start + interval * np.arange(n_samples)
    values = []
    for channel in (a, b):
        is_finite = np.isfinite(channel.samples.value)
        values.append(_remove_spikes(np.interp(time, channel.time[is_finite], channel.samples.value[is_finite])))
    jumps = [float(np.abs(np.diff(value)).max()) for value in values]
    if jumps[0] < MIN_SHARPNESS_RATIO * jumps[1]:
        return False
    lags = range(-min(MAX_LAG_SAMPLES, n_samples // 4), min(MAX_LAG_SAMPLES, n_samples // 4) + 1)
    correlations = [_correlate_with_lag(values[0], values[1], lag) for lag in lags]
    best = int(np.argmax(correlations))
    remainder, remainder_at_zero = 1.0 - correlations[best], 1.0 - correlations[lags.index(0)]
    return lags[best] > 0 and correlations[best] > MIN_CORRELATION and remainder < MAX_REMAINDER * remainder_at_zero


def _correlate_with_lag(first: Array, second: Array, lag: int) -> float:
    """Return the correlation of ``first`` with ``second`` read ``lag`` samples later."""
    if lag >= 0:
        return compute_correlation(first[: len(first) - lag], second[lag:])
    return compute_correlation(first[-lag:], second[:lag])


def _remove_spikes(values: Array) -> Array:
    """Return the running medians of three of ``values``."""
    return np.median(np.stack([values[:-2], values[1:-1], values[2:]]), axis=0)
