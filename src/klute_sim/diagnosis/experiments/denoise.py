"""Noise taken off a prescribed channel, where that changes nothing but noise.

What rubs or sticks in a device remembers every reversal, and so it remembers the noise of the length that it is given:
friction that is told to tremble loses some of its hysteresis. Noise of inputs is no noise of outputs that averages out.

Every sample gets the mean of a window as wide as the data allow, by the rule of intersecting confidence intervals
(Goldenshluger and Nemirovski, Math. Methods Statist. 6:135, 1997): windows grow as long as what they say agrees with
what all narrower ones said. In a hold or a steady ramp that is wide; at a corner the sample stays as it is.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

Array = NDArray[np.float64]

WINDOW_SIZES = (5, 9, 17, 33)
"""Samples, all odd; parabolas are fitted in them (Savitzky and Golay, 1964)."""
CONFIDENCE_SIGMAS = 2.0
"""Half width of a confidence interval in standard deviations. A sample is moved by at most as much of its own noise."""
MAX_INTERVAL_VARIATION = 0.01
"""Of the sampling interval, by which it may vary."""


def estimate_white_noise(value: Array) -> float:
    """Standard deviation of white noise in ``value`` (n), in its unit: from third differences, most of which are noise.

    Robust: what moves fast, now and then, does not count. 0 for what was recorded without, or too coarsely to tell.
    """
    third = np.diff(value, 3)
    return 0.0 if len(third) < 3 else float(np.median(np.abs(third)) / 0.6745 / np.sqrt(20.0))


def denoise(time: Array, value: Array) -> Array:
    """``value`` (n), in its unit, sampled at ``time`` [s] (n); no sample is moved by more than :data:`STRICT` noises.

    What is not sampled evenly, or is too short, comes back as it is.
    """
    deviation, steps = estimate_white_noise(value), np.diff(time)
    if deviation == 0.0 or len(value) < 2 * WINDOW_SIZES[-1] or np.ptp(steps) > MAX_INTERVAL_VARIATION * steps.mean():
        return value
    found = value
    least, most = value - CONFIDENCE_SIGMAS * deviation, value + CONFIDENCE_SIGMAS * deviation
    low, high = least, most
    agreed = np.ones(len(value), dtype=bool)
    for window in WINDOW_SIZES:
        mean = savgol_filter(value, window, 2, mode="interp")
        half = CONFIDENCE_SIGMAS * deviation * np.sqrt(_smoothing_variance_ratio(window))
        low, high = np.maximum(low, mean - half), np.minimum(high, mean + half)
        agreed &= low <= high
        found = np.where(agreed, mean, found)
    return np.clip(found, least, most)


def _smoothing_variance_ratio(window: int) -> float:
    """Variance of a parabola's middle over that of a sample: ``3 (3 n^2 - 7) / (4 n (n^2 - 4))``."""
    return 3.0 * (3.0 * window**2 - 7.0) / (4.0 * window * (window**2 - 4.0))
