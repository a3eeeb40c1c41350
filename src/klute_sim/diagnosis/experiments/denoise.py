"""Noise removal from prescribed channels, where it changes nothing but noise.

Dry friction is history-dependent: noise on the prescribed length adds reversals and erodes the hysteresis loop, so
inputs are denoised. Input noise biases the output; it does not average out.

Each sample becomes the mean of the widest window that the data allow, by the rule of intersecting confidence intervals
(Goldenshluger and Nemirovski, Math. Methods Statist. 6:135, 1997): windows grow while their mean agrees with the means
of all narrower windows. In a hold or a steady ramp the window is wide; at a corner the sample stays as it is.
"""

import numpy as np
from scipy.signal import savgol_filter

from klute_sim.types import Array

WINDOW_SIZES = (5, 9, 17, 33)
"""Odd numbers of samples, to which parabolas are fitted (Savitzky and Golay, 1964)."""
CONFIDENCE_SIGMAS = 2.0
"""Half width of a confidence interval, and largest change of a sample, in standard deviations of its noise."""
MAX_INTERVAL_VARIATION = 0.01
"""Largest variation of the sampling interval, as a fraction of it."""


def estimate_white_noise(value: Array) -> float:
    """Return the standard deviation of white noise in ``value`` (n,), from third differences, in the unit of ``value``.

    The median makes it robust against occasional fast movements. Returns 0 for a signal without noise, or one with
    too few digits to tell.
    """
    third = np.diff(value, 3)
    return 0.0 if len(third) < 3 else float(np.median(np.abs(third)) / 0.6745 / np.sqrt(20.0))


def denoise(time: Array, value: Array) -> Array:
    """Return ``value`` (n,), sampled at ``time`` [s] (n,), without white noise.

    No sample changes by more than :data:`CONFIDENCE_SIGMAS` standard deviations of the noise. Unevenly sampled and
    short signals are returned unchanged.
    """
    deviation, steps = estimate_white_noise(value), np.diff(time)
    if deviation == 0.0 or len(value) < 2 * WINDOW_SIZES[-1] or np.ptp(steps) > MAX_INTERVAL_VARIATION * steps.mean():
        return value
    denoised = value
    min_value, max_value = value - CONFIDENCE_SIGMAS * deviation, value + CONFIDENCE_SIGMAS * deviation
    lower, upper = min_value, max_value
    agrees = np.ones(len(value), dtype=bool)
    for window in WINDOW_SIZES:
        mean = savgol_filter(value, window, 2, mode="interp")
        half_width = CONFIDENCE_SIGMAS * deviation * np.sqrt(_smoothing_variance_ratio(window))
        lower, upper = np.maximum(lower, mean - half_width), np.minimum(upper, mean + half_width)
        agrees &= lower <= upper
        denoised = np.where(agrees, mean, denoised)
    return np.clip(denoised, min_value, max_value)


def _smoothing_variance_ratio(window: int) -> float:
    """Return the variance of a fitted parabola's middle over that of a sample: ``3 (3 n^2 - 7) / (4 n (n^2 - 4))``."""
    return 3.0 * (3.0 * window**2 - 7.0) / (4.0 * window * (window**2 - 4.0))
