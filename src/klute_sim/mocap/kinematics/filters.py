"""Zero-lag low-pass filters, gaps (empty cells and missing rows) and resampling to uniform times."""

from itertools import pairwise

import numpy as np
from scipy.signal import butter, sosfiltfilt

from klute_sim.errors import InputError
from klute_sim.mask_runs import find_runs
from klute_sim.types import Array

N_PASSES = 2
"""Number of filter passes: forward and backward."""
PASS_ORDER = 2
"""Order of one pass; both passes form a fourth-order filter without lag."""
CUTOFF_CORRECTION = (2.0 ** (1.0 / N_PASSES) - 1.0) ** (1.0 / (2 * PASS_ORDER))
"""Ratio of the two-pass cutoff to the cutoff of one pass, 0.802 (Winter, Biomechanics and Motor Control of Human
Movement, 2.2)."""
MIN_FILTERED_SAMPLES = 3 * (2 * PASS_ORDER + 1)
"""Number of samples by which the filter extends a signal at both ends, so that a part must have more."""
MAX_GAP_TIME = 0.2
"""Longest gap [s] that is filled by linear interpolation (assumed)."""
MAX_CLOCK_JITTER = 0.2
"""Largest deviation from uniform times, in sampling intervals, that counts as rounding."""
MAX_INTERVAL_RATIO = 1.5
"""Largest ratio of an interval between samples to the median one; in a longer one samples are missing (assumed)."""
MAX_INSERTED_SAMPLES = 100_000
"""Largest number of samples that are inserted in one interval, which bounds memory after a wrong time stamp."""
MIN_TIME_STEP, MAX_TIME_STEP = 1e-5, 0.1
"""Accepted sampling intervals [s]."""


def describe_filter(cutoff: float) -> str:
    """Return a description of the filter with ``cutoff`` [Hz]."""
    return f"Butterworth, zero lag, order {N_PASSES * PASS_ORDER}, {cutoff:g} Hz" if cutoff > 0.0 else "none"


def low_pass(samples: Array, rate: float, cutoff: float) -> Array:
    """Return ``samples`` (n, ...) at ``rate`` [Hz], low-pass filtered along the first axis at ``cutoff`` [Hz].

    A cutoff of 0 returns the samples unchanged. NaN remain, and the parts between them are filtered separately, except
    those of up to :data:`MIN_FILTERED_SAMPLES`. Raises InputError if the cutoff is too high for the rate.
    """
    if cutoff <= 0.0:
        return samples
    if cutoff / CUTOFF_CORRECTION >= 0.5 * rate:
        max_cutoff = 0.5 * rate * CUTOFF_CORRECTION
        raise InputError(
            f"cutoff is {cutoff:g} Hz; allowed at a sampling rate of {rate:g} Hz are 0 (no filter) and values below "
            f"{max_cutoff:.3g}"
        )
    sections = butter(PASS_ORDER, cutoff / CUTOFF_CORRECTION, fs=rate, output="sos")
    result = np.array(samples, dtype=np.float64)
    for column in result.reshape(len(result), -1).T:
        for start, stop in find_runs(np.isfinite(column)):
            if stop - start > MIN_FILTERED_SAMPLES:
                column[start:stop] = sosfiltfilt(sections, column[start:stop])
    return result


def insert_missing_samples(time: Array, samples: Array) -> tuple[Array, Array]:
    """Return ``time`` [s] and ``samples`` (n, ...) with NaN at regular times where samples are missing."""
    intervals = np.diff(time)
    typical = float(np.median(intervals))
    is_long = intervals > MAX_INTERVAL_RATIO * typical
    counts = np.where(is_long, np.minimum(np.round(intervals / typical) - 1.0, MAX_INSERTED_SAMPLES), 0.0).astype(int)
    steps = [np.arange(1, count + 1) / (count + 1) for count in counts[is_long]]
    before = np.repeat(np.arange(len(intervals)), counts)
    added = time[before] + intervals[before] * np.concatenate([np.zeros(0), *steps])
    return np.insert(time, before + 1, added), np.insert(np.asarray(samples, dtype=np.float64), before + 1, np.nan, 0)


def fill_gaps(samples: Array, time: Array) -> Array:
    """Return ``samples`` (n, ...) at ``time`` [s] with gaps of up to :data:`MAX_GAP_TIME` interpolated linearly."""
    result = np.array(samples, dtype=np.float64)
    for column in result.reshape(len(result), -1).T:
        known = np.flatnonzero(np.isfinite(column))
        for before, after in pairwise(known):
            if after - before > 1 and time[after] - time[before] <= MAX_GAP_TIME:
                inner = slice(before + 1, after)
                column[inner] = np.interp(time[inner], time[[before, after]], column[[before, after]])
    return result


def make_uniform_time(time: Array, source_name: str) -> Array:
    """Return uniform times [s] of the same span and length as ``time``; raise InputError for implausible rates."""
    uniform_time = np.linspace(time[0], time[-1], len(time))
    time_step = uniform_time[1] - uniform_time[0]
    if not MIN_TIME_STEP <= time_step <= MAX_TIME_STEP:
        raise InputError(f"{source_name} has a sample every {time_step:g} s; allowed are 0.00001 to 0.1 s")
    return uniform_time


def resample_uniform(uniform_time: Array, time: Array, samples: Array) -> Array:
    """Return ``samples`` (n, ...) at ``uniform_time``; unchanged if ``time`` deviates from it by rounding only."""
    if np.abs(time - uniform_time).max() <= MAX_CLOCK_JITTER * (uniform_time[1] - uniform_time[0]):
        return samples
    columns = samples.reshape(len(samples), -1).T
    resampled = np.stack([np.interp(uniform_time, time, column) for column in columns], axis=1)
    return np.asarray(resampled.reshape(samples.shape), dtype=np.float64)
