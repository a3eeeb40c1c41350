"""Zero-lag low-pass filters, and what is done about gaps and uneven clocks before them."""

from itertools import pairwise

import numpy as np
from scipy.signal import butter, sosfiltfilt

from klute_sim.errors import InputError
from klute_sim.recording.recording import Array

N_PASSES = 2
PASS_ORDER = 2
"""Of one pass; both ways, the filter is of fourth order and without lag."""
CUTOFF_CORRECTION = (2.0 ** (1.0 / N_PASSES) - 1.0) ** (1.0 / (2 * PASS_ORDER))
"""0.802: what the cut-off of one pass is divided by, so that both passes together have it (Winter, Biomechanics and
Motor Control of Human Movement, 2.2)."""
MAX_GAP = 0.2
"""Longest gap [s] that is bridged by a straight line (assumed)."""
MAX_CLOCK_JITTER = 0.2
"""Largest departure of a sample from an even clock, in sampling intervals, that is taken for rounding."""


def describe_filter(cutoff: float) -> str:
    """The filter in words."""
    return f"Butterworth, zero lag, order {N_PASSES * PASS_ORDER}, {cutoff:g} Hz" if cutoff > 0.0 else "none"


def low_pass(samples: Array, rate: float, cutoff: float) -> Array:
    """``samples`` (along the first axis, at ``rate`` [Hz]) without what is faster than ``cutoff`` [Hz]; 0: as they are.

    Leading and trailing NaN stay; raises InputError for a cut-off that the rate does not allow.
    """
    if cutoff <= 0.0:
        return samples
    if cutoff / CUTOFF_CORRECTION >= 0.5 * rate:
        most = 0.5 * rate * CUTOFF_CORRECTION
        raise InputError(
            f"cut-off is {cutoff:g} Hz; allowed at {rate:g} Hz of sampling are 0 (none) and below {most:.3g}"
        )
    sections = butter(PASS_ORDER, cutoff / CUTOFF_CORRECTION, fs=rate, output="sos")
    result = np.array(samples, dtype=np.float64)
    for column in result.reshape(len(result), -1).T:
        known = np.flatnonzero(np.isfinite(column))
        if len(known) > 3 * (2 * PASS_ORDER + 1):
            inside = slice(known[0], known[-1] + 1)
            if np.isfinite(column[inside]).all():
                column[inside] = sosfiltfilt(sections, column[inside])
    return result


def fill_gaps(samples: Array, time: Array) -> Array:
    """``samples`` (along the first axis) with gaps of up to :data:`LONGEST_GAP` filled by straight lines."""
    result = np.array(samples, dtype=np.float64)
    for column in result.reshape(len(result), -1).T:
        known = np.flatnonzero(np.isfinite(column))
        for before, after in pairwise(known):
            if after - before > 1 and time[after] - time[before] <= MAX_GAP:
                inner = slice(before + 1, after)
                column[inner] = np.interp(time[inner], time[[before, after]], column[[before, after]])
    return result


def make_uniform_time(time: Array, source_name: str) -> Array:
    """An even clock of as many samples as ``time`` [s]; raises InputError for rates that no laboratory has."""
    clock = np.linspace(time[0], time[-1], len(time))
    step = clock[1] - clock[0]
    if not 1e-5 <= step <= 0.1:
        raise InputError(f"{source_name} has a sample every {step:g} s; allowed are 0.00001 to 0.1 s")
    return clock


def resample_uniform(uniform_time: Array, time: Array, samples: Array) -> Array:
    """``samples`` (along the first axis, at ``time``) at the even ``clock``; as they are where ``time`` rounds it."""
    if np.abs(time - uniform_time).max() <= MAX_CLOCK_JITTER * (uniform_time[1] - uniform_time[0]):
        return samples
    columns = samples.reshape(len(samples), -1).T
    moved = np.stack([np.interp(uniform_time, time, column) for column in columns], axis=1)
    return np.asarray(moved.reshape(samples.shape), dtype=np.float64)
