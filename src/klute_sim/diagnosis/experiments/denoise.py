"""Noise removal from prescribed channels, where it changes nothing but noise.

Dry friction is history-dependent: noise on the prescribed length adds reversals and erodes the hysteresis loop, so
inputs are denoised. Input noise biases the output; it does not average out. A hold becomes a constant.

Each sample becomes the value there of a parabola, fitted to the widest window that the data allow by the rule of
intersecting confidence intervals (Goldenshluger and Nemirovski, Math. Methods Statist. 6:135, 1997): windows grow while
their value agrees with those of all narrower windows. In a hold or a steady ramp the window is wide; at a corner the
sample stays as it is.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_filter

from klute_sim.mask_runs import find_runs
from klute_sim.types import Array, Mask

NORMAL_MEDIAN = 0.6745
"""Median of the size of a normally distributed number, in standard deviations."""
MAX_COARSE_STEPS, MAX_DISPLAY_STEPS = 2.0, 8.0
"""Largest median of third differences of a coarse display, and largest size that counts as noise, in its steps
(assumed)."""
WINDOW_SIZES = (5, 9, 17, 33)
"""Odd numbers of samples, to which parabolas are fitted (Savitzky and Golay, 1964)."""
HOLD_WINDOW = 17
"""Number of samples whose slope tells a hold from a motion, and smallest length of a hold (assumed)."""
END_WINDOW = 5
"""Number of samples whose mean tells where a hold begins and ends (assumed)."""
MAX_SLOPE_SIGMAS = 4.0
"""Largest slope in a hold, in its standard errors (assumed)."""
MAX_HOLD_VARIATION = 1.2
"""Largest standard deviation of the samples of a hold, over that of the noise (assumed)."""
MAX_END_DEVIATION = 2.0
"""Largest deviation of the mean at an end of a hold from that of the hold, in its standard errors (assumed)."""
CONFIDENCE_SIGMAS = 0.5
"""Half width of the confidence interval of the value of a window, in standard errors (assumed). All repeats share the
error of a window that is too wide, while noise averages out: with 2, inputs of 200 Hz cause a misfit of 0.15 times the
noise of a load cell in clean data, with 0.5 one of 0.05."""
MAX_CHANGE_SIGMAS = 2.0
"""Largest change of a sample, in standard deviations of its noise (assumed)."""
MAX_UNEVEN_CHANGE_SIGMAS = 5.0
"""Largest change of a sample of an unevenly sampled signal, in standard deviations of its noise (assumed)."""
MAX_INTERVAL_VARIATION = 0.01
"""Largest variation of the sampling interval, as a fraction of it, of a signal that counts as evenly sampled
(assumed)."""
MIN_REGULAR_FRACTION = 0.9
"""Smallest fraction of equal sampling intervals of an uneven signal that is smoothed outside of holds: what an
irregular one is between its samples is not known well enough (assumed)."""
MAX_UPSAMPLING_FACTOR = 4
"""Largest number of even samples per sample of an unevenly sampled signal; a pause in a log would take any
number (assumed)."""


def estimate_white_noise(time: Array, value: Array) -> float:
    """Return the standard deviation of white noise in ``value`` (n,) at ``time`` [s] (n,), in the unit of ``value``.

    From third divided differences, which a parabola does not change however it is sampled. The median makes it robust
    against occasional fast movements, and is interpolated between the few values that the differences of a coarse
    display have. Returns 0 for a signal without noise, or one with too few digits to tell.
    """
    if len(value) < 4:
        return 0.0
    nodes = np.stack([time[k : len(time) - 3 + k] for k in range(4)])
    differences = nodes[:, None, :] - nodes[None, :, :]
    differences[np.arange(4), np.arange(4)] = 1.0
    weights = 1.0 / differences.prod(axis=1)
    third = sum(weight * value[k : len(value) - 3 + k] for k, weight in enumerate(weights))
    scaled = np.abs(third) / np.sqrt((weights**2).sum(axis=0))
    return _compute_median_size(scaled) / NORMAL_MEDIAN


def _compute_median_size(sizes: Array) -> float:
    """Return the median of ``sizes`` >= 0, (n,), of differences of a normal distribution; 0 where most are 0.

    A median of a coarse display would jump by a whole step. So each size is spread evenly as far as half way to the
    next other one. Up to :data:`MAX_COARSE_STEPS` steps, the median is that of a distribution with the same root mean
    square, in which sizes beyond :data:`MAX_DISPLAY_STEPS` steps count as these.
    """
    largest = float(sizes.max())
    if largest == 0.0:
        return 0.0
    digits = np.round(sizes / largest, 9)  # equal differences of a display differ in their last bits
    if np.median(digits) == 0.0:
        return 0.0
    values, counts = np.unique(digits, return_counts=True)
    edges = np.concatenate([[0.0], 0.5 * (values[1:] + values[:-1]), values[-1:]])
    cumulated = np.concatenate([[0.0], np.cumsum(counts)])
    median = float(np.interp(0.5 * len(sizes), cumulated, edges))
    step = float(values[values > 0.0][0])
    if median <= MAX_COARSE_STEPS * step:
        median = NORMAL_MEDIAN * float(np.sqrt(np.mean(np.minimum(digits, MAX_DISPLAY_STEPS * step) ** 2)))
    return largest * median


def denoise(time: Array, value: Array) -> Array:
    """Return ``value`` (n,), sampled at ``time`` [s] (n,), without white noise.

    Outside of holds no sample changes by more than :data:`MAX_CHANGE_SIGMAS` standard deviations of the noise
    (:data:`MAX_UNEVEN_CHANGE_SIGMAS` in an unevenly sampled signal), and in holds by no more than its own noise. A
    signal with a few other intervals is smoothed at even times, between which it is interpolated linearly; of an
    irregular one only the holds are. A signal shorter than two windows is returned unchanged.
    """
    windows = [window for window in WINDOW_SIZES if 2 * window <= len(value)]
    deviation = estimate_white_noise(time, value)
    if deviation == 0.0 or not windows:
        return value
    steps = np.diff(time)
    if np.ptp(steps) <= MAX_INTERVAL_VARIATION * steps.mean():
        return _smooth(value, deviation, windows)
    n_even = min(round((time[-1] - time[0]) / float(np.median(steps))) + 1, MAX_UPSAMPLING_FACTOR * len(time))
    even = np.linspace(time[0], time[-1], max(n_even, 2 * windows[0]))
    even_value, limit = np.interp(even, time, value), MAX_UNEVEN_CHANGE_SIGMAS * deviation
    is_regular = np.abs(steps - np.median(steps)) <= MAX_INTERVAL_VARIATION * np.median(steps)
    if is_regular.mean() >= MIN_REGULAR_FRACTION:
        fitting = [window for window in windows if 2 * window <= len(even)]
        denoised = np.interp(time, even, _smooth(even_value, deviation, fitting))
    else:
        flat = _flatten_holds(even_value, even_value, deviation) if len(even) >= 2 * HOLD_WINDOW else even_value
        is_held = np.interp(time, even, flat != even_value) == 1.0
        denoised = np.where(is_held, np.interp(time, even, flat), value)
    return np.asarray(np.clip(denoised, value - limit, value + limit))


def _smooth(value: Array, deviation: float, windows: Sequence[int]) -> Array:
    """Return ``value`` (n,), evenly sampled with noise of ``deviation``, smoothed by the widest of ``windows``."""
    denoised = value
    min_value, max_value = value - MAX_CHANGE_SIGMAS * deviation, value + MAX_CHANGE_SIGMAS * deviation
    lower, upper = min_value, max_value
    agrees = np.ones(len(value), dtype=bool)
    for window in windows:
        fitted = savgol_filter(value, window, 2, mode="interp")
        half_width = CONFIDENCE_SIGMAS * deviation * np.sqrt(_smoothing_variance_ratio(window))
        lower, upper = np.maximum(lower, fitted - half_width), np.minimum(upper, fitted + half_width)
        agrees &= lower <= upper
        denoised = np.where(agrees, fitted, denoised)
    denoised = np.clip(denoised, min_value, max_value)
    return _flatten_holds(value, denoised, deviation) if len(value) >= 2 * HOLD_WINDOW else denoised


def _flatten_holds(value: Array, denoised: Array, deviation: float) -> Array:
    """Return ``denoised`` with the mean of ``value`` in each hold: (n,), evenly sampled with noise of ``deviation``.

    A friction force follows the direction of a motion however slow, so the last micrometres of noise would reverse it
    all the time in a muscle that is held. A hold has no significant slope, as a whole and in each window.
    """
    slope = savgol_filter(value, HOLD_WINDOW, 1, deriv=1, mode="interp")
    is_still = np.abs(slope) < MAX_SLOPE_SIGMAS * _compute_slope_error(HOLD_WINDOW, deviation)
    local = uniform_filter1d(value, END_WINDOW)
    flat = denoised.copy()
    for begin, end in find_runs(is_still):
        hold = value[begin:end]
        n = len(hold)
        if n < HOLD_WINDOW or hold.std() > MAX_HOLD_VARIATION * deviation:
            continue
        trend = np.polyfit(np.arange(n), hold, 1)[0]
        if abs(trend) < MAX_SLOPE_SIGMAS * _compute_slope_error(n, deviation):
            mean = float(hold.mean())
            agrees = np.abs(local - mean) < MAX_END_DEVIATION * deviation / np.sqrt(END_WINDOW)
            first, last = max(0, begin - HOLD_WINDOW // 2), min(len(value), end + HOLD_WINDOW // 2)
            flat[begin - _count_leading(agrees[first:begin][::-1]) : end + _count_leading(agrees[end:last])] = mean
    return flat


def _count_leading(mask: Mask) -> int:
    """Return the number of elements before the first false one."""
    return int(np.argmin(mask)) if not mask.all() else len(mask)


def _compute_slope_error(n: int, deviation: float) -> float:
    """Return the standard error of the slope per sample of a line through ``n`` samples with noise of ``deviation``."""
    return deviation * float(np.sqrt(12.0 / (n * (n * n - 1.0))))


def _smoothing_variance_ratio(window: int) -> float:
    """Return the variance of a fitted parabola's middle over that of a sample: ``3 (3 n^2 - 7) / (4 n (n^2 - 4))``."""
    return 3.0 * (3.0 * window**2 - 7.0) / (4.0 * window * (window**2 - 4.0))
