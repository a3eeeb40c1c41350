"""Moving averages and Savitzky-Golay filters: weighted means of a window of samples."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial.chebyshev import chebval
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs

from klute_sim.diagnosis.experiments.channel_filter import ChannelFilter
from klute_sim.types import Array

CUTOFF_GAIN = np.sqrt(0.5)
"""Gain of the amplitude at the cut-off frequency."""
N_CUTOFF_FREQUENCIES = 500
"""Number of frequencies, up to half the sampling rate, among which the cut-off frequency is looked for."""
PADDING_WINDOWS = 2.0
"""Length by which a signal is continued at each end before it is filtered [windows]."""


@dataclass(frozen=True)
class WindowFilter(ChannelFilter):
    """Value at the middle of a polynomial that is fitted to a window of samples (Savitzky and Golay, 1964).

    That of degree 0 or 1 is a moving average.
    """

    n_samples: int
    """Number of samples of the window; odd but for a moving average."""
    sampling_rate: float
    """Sampling rate of the channel [Hz]."""
    degree: int = 0
    """Even degree of the polynomial; the odd degree above it does the same."""
    n_passes: int = 1
    """How often it is applied; twice, as one filter forward and backward, for a triangular window."""
    is_trailing: bool = False
    """Whether the window ends at its sample, which makes a moving average late; otherwise its middle is there."""

    @property
    def duration(self) -> float:
        """Duration of the windows of all passes [s]."""
        return self.n_passes * self.n_samples / self.sampling_rate

    @property
    def cutoff(self) -> float:
        """Frequency [Hz] at which the amplitude falls to 0.71."""
        return _find_cutoff(replace(self, is_trailing=False))

    @property
    def delay(self) -> float:
        """Delay [s]: half of the time from the first to the last sample of a trailing window."""
        return 0.5 * self.n_passes * (self.n_samples - 1) / self.sampling_rate if self.is_trailing else 0.0

    @property
    def padding_time(self) -> float:
        """Time [s] by which a signal is continued at each end before it is filtered."""
        return PADDING_WINDOWS * self.duration

    @property
    def end_time(self) -> float:
        """Time [s] at each end of a record that is not compared: the window."""
        return self.duration

    @property
    def words(self) -> str:
        """Kind and number of samples."""
        if self.degree == 0:
            return f"moving average of {self.n_samples} samples" + (", twice" if self.n_passes == 2 else "")
        return f"Savitzky-Golay filter of {self.n_samples} samples, degree {self.degree} or {self.degree + 1}"

    def compute_response(self, frequency: Array) -> NDArray[np.complex128]:
        """Return the frequency response [1] at ``frequency`` [Hz] (n,).

        The sum of ``w_k cos(2 pi f k / f_s)`` over the weights ``w_k`` of the samples ``k`` from the middle of the
        window; for a moving average of n samples ``sin(pi f n / f_s) / (n sin(pi f / f_s))`` (Smith, The Scientist and
        Engineer's Guide to Digital Signal Processing, 1997, equation 15-2). Passes multiply.
        A trailing window is late by :attr:`delay`.
        """
        angle = np.pi * frequency / self.sampling_rate
        if self.degree == 0:
            sine = np.sin(angle)
            is_peak = np.abs(sine) < 1e-9  # at multiples of the sampling rate
            safe_sine = np.where(is_peak, 1.0, self.n_samples * sine)
            response = np.where(
                is_peak, np.cos((self.n_samples - 1) * angle), np.sin(self.n_samples * angle) / safe_sine
            )
        else:
            # cos(k x) is the Chebyshev polynomial of degree k of cos(x); its recurrence needs one cosine for all k.
            response = chebval(np.cos(2.0 * angle), _compute_series_coefficients(self.n_samples, self.degree))
        response = response**self.n_passes
        if self.is_trailing:
            return np.asarray(response * np.exp(-2j * np.pi * frequency * self.delay))
        return response.astype(np.complex128)

    def align(self) -> "WindowFilter":
        """Return the filter of a channel that is not late to the inputs: that of a centred window."""
        return replace(self, is_trailing=False)

    def scale_cutoff(self, factor: float) -> "WindowFilter":
        """Return the filter itself: the noise shows the window exactly."""
        return self


@lru_cache(maxsize=1024)
def _compute_series_coefficients(n_samples: int, degree: int) -> Array:
    """Return the coefficients of the cosine series of a Savitzky-Golay filter: a symmetric window has each twice."""
    weights = savgol_coeffs(n_samples, degree)[n_samples // 2 :]
    return np.append(weights[0], 2.0 * weights[1:])


@lru_cache
def _find_cutoff(centred: WindowFilter) -> float:
    frequency = np.linspace(0.0, 0.5 * centred.sampling_rate, N_CUTOFF_FREQUENCIES)
    return float(frequency[np.argmax(centred.compute_gain(frequency) < CUTOFF_GAIN)])
