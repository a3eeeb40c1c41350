"""A force with the jumps of dry friction, noise, and the filters of usual data processing and of amplifiers."""

import numpy as np
from scipy.signal import bessel, butter, sosfilt, sosfilt_zi, sosfiltfilt

RATE_HZ, DURATION_S = 500.0, 15.0
TIME = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
MOTION = 900.0 + 300.0 * np.sin(2.0 * np.pi * 0.7 * TIME)
REVERSALS = MOTION + 40.0 * np.sign(np.cos(2.0 * np.pi * 0.7 * TIME))


def filter_twice(values: np.ndarray, cutoff: float, order: int) -> np.ndarray:
    """Return ``values`` (n,) through a Butterworth filter of ``order``, forward and backward, at ``cutoff`` [Hz]."""
    return sosfiltfilt(butter(order, cutoff, fs=RATE_HZ, output="sos"), values)


def amplify(values: np.ndarray, cutoff: float, order: int, kind: str = "butterworth") -> np.ndarray:
    """Return ``values`` (n,) through the filter of an amplifier, which has a delay; ``kind`` may be ``"bessel"``."""
    if kind == "bessel":
        sections = bessel(order, cutoff, fs=RATE_HZ, norm="mag", output="sos")
    else:
        sections = butter(order, cutoff, fs=RATE_HZ, output="sos")
    return sosfilt(sections, values, zi=values[0] * sosfilt_zi(sections))[0]


def average(values: np.ndarray, n_samples: int, *, is_trailing: bool = False) -> np.ndarray:
    """Return the mean of each window of ``n_samples``, whose middle or end is at its sample."""
    means = np.convolve(values, np.full(n_samples, 1.0 / n_samples), "full")[: len(values)]
    return means if is_trailing else np.roll(means, -(n_samples // 2))


def make_noise(seed: int) -> np.ndarray:
    """Return white noise of 4 N at :data:`TIME`."""
    return np.random.default_rng(seed).normal(0.0, 4.0, len(TIME))
