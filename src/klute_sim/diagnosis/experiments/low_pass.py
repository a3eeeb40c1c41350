"""Low-pass filters of Butterworth and Bessel."""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import besselap, buttap

from klute_sim.diagnosis.experiments.channel_filter import ChannelFilter
from klute_sim.types import Array

FilterKind = Literal["zero-lag", "butterworth", "bessel"]
"""A Butterworth filter forward and backward, which has no delay, or one forward only, of Butterworth or Bessel."""

PADDING_PERIODS = 3.0
"""Length by which a signal is continued at each end before it is filtered [periods of the cut-off frequency]."""
END_PERIODS = 2.0
"""Length at each end of a record that is not compared [periods of the cut-off frequency] (assumed)."""


@lru_cache
def _compute_poles(kind: FilterKind, order: int) -> NDArray[np.complex128]:
    """Return the poles (order,) of the analog filter of 1 rad/s."""
    _, poles, _ = besselap(order, norm="mag") if kind == "bessel" else buttap(order)
    return np.asarray(poles, dtype=np.complex128)


@dataclass(frozen=True)
class LowPassFilter(ChannelFilter):
    """Low-pass filter with one of the usual frequency responses."""

    cutoff: float
    """Frequency [Hz] at which a pass lowers the amplitude to 0.71; a zero-lag filter halves it."""
    order: int
    """Order of each pass."""
    sampling_rate: float
    """Sampling rate of the filter [Hz]; infinite for an analog one."""
    kind: FilterKind = "zero-lag"
    is_aligned: bool = False
    """Whether the channel is not late to the inputs: they went through the same filter, or its delay was subtracted."""

    @property
    def has_delay(self) -> bool:
        """Whether a signal leaves the filter later than it enters."""
        return self.kind != "zero-lag"

    @property
    def delay(self) -> float:
        """Delay of a slow signal [s]: the group delay at 0 Hz, ``sum(Re(-1/p)) / (2 pi f_c)`` for poles ``p``.

        A digital filter has ``f_s tan(pi f_c / f_s)`` in place of ``pi f_c``, at the sampling rate ``f_s``.
        """
        if not self.has_delay:
            return 0.0
        rate = 2.0 * float(self._warp(np.array([self.cutoff]))[0])
        return float(np.sum((-1.0 / _compute_poles(self.kind, self.order)).real) / rate)

    @property
    def lateness(self) -> float:
        """Time [s] by which slow signals of the channel are later than those of a simulation."""
        return 0.0 if self.is_aligned else self.delay

    @property
    def stop_band_exponent(self) -> int:
        """Exponent n of the amplitude far above the cut-off frequency, ``f^-n``."""
        return self.order if self.has_delay else 2 * self.order

    def _warp(self, frequency: Array) -> Array:
        """Return pi times the frequency [Hz] of the analog filter that the bilinear transform makes ``frequency``."""
        if np.isinf(self.sampling_rate):
            return np.pi * frequency
        return self.sampling_rate * np.tan(np.pi * frequency / self.sampling_rate)

    def compute_response(self, frequency: Array) -> NDArray[np.complex128]:
        """Return the frequency response [1] at ``frequency`` [Hz] (n,).

        A pass is ``H = prod(-p / (j w - p))`` with the poles ``p`` of the analog filter and ``w = f / f_c``, or, for a
        digital filter with the sampling rate ``f_s``, ``w = tan(pi f / f_s) / tan(pi f_c / f_s)`` below half of it, by
        the bilinear transform (Oppenheim and Schafer, Discrete-Time Signal Processing, 2010, 7.2). A zero-lag filter is
        ``|H|^2``. An aligned channel has no :attr:`delay`, only the shape that the filter gives to a signal.
        """
        is_sampled = frequency < 0.5 * self.sampling_rate
        ratio = self._warp(frequency[is_sampled]) / self._warp(np.array([self.cutoff]))
        response = np.zeros(len(frequency), dtype=np.complex128)
        if self.has_delay:
            poles = _compute_poles(self.kind, self.order)
            response[is_sampled] = np.prod(-poles / (1j * ratio[:, None] - poles), axis=1)
            if self.is_aligned:
                response *= np.exp(2j * np.pi * frequency * self.delay)
        else:
            response[is_sampled] = 1.0 / (1.0 + ratio ** (2 * self.order))
        return response

    @property
    def padding_time(self) -> float:
        """Time [s] by which a signal is continued at each end before it is filtered."""
        return PADDING_PERIODS / self.cutoff

    @property
    def end_time(self) -> float:
        """Time [s] at each end of a record that is not compared."""
        return END_PERIODS / self.cutoff

    @property
    def words(self) -> str:
        """The cut-off frequency."""
        return f"{self.cutoff:.2g} Hz"

    def align(self) -> "LowPassFilter":
        """Return the filter of a channel that is not late to the inputs; itself without delay."""
        return replace(self, is_aligned=True) if self.has_delay else self

    def scale_cutoff(self, factor: float) -> "LowPassFilter":
        """Return the filter with another cut-off frequency."""
        return replace(self, cutoff=factor * self.cutoff)
