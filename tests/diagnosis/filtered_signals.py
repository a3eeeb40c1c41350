"""A force with the jumps of dry friction, noise, and the filter of usual data processing."""

import numpy as np
from scipy.signal import butter, sosfiltfilt

RATE_HZ, DURATION_S = 500.0, 15.0
TIME = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
MOTION = 900.0 + 300.0 * np.sin(2.0 * np.pi * 0.7 * TIME)
REVERSALS = MOTION + 40.0 * np.sign(np.cos(2.0 * np.pi * 0.7 * TIME))


def filter_twice(values: np.ndarray, cutoff: float, order: int) -> np.ndarray:
    """Return ``values`` (n,) through a Butterworth filter of ``order``, forward and backward, at ``cutoff`` [Hz]."""
    return sosfiltfilt(butter(order, cutoff, fs=RATE_HZ, output="sos"), values)


def make_noise(seed: int) -> np.ndarray:
    """Return white noise of 4 N at :data:`TIME`."""
    return np.random.default_rng(seed).normal(0.0, 4.0, len(TIME))
