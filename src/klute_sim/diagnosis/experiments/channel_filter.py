"""Filter that a channel went through before it came here: of an amplifier, or of a data processing."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

from klute_sim.datasets.trial import TimeSeries
from klute_sim.types import Array

N_CACHED_RESPONSES = 64
"""Frequency responses kept in memory: every simulation of a trial needs the same one."""


class ChannelFilter(ABC):
    """A linear filter with gain 1 for slow signals; it is hashable, and equal to one with the same response."""

    @property
    @abstractmethod
    def delay(self) -> float:
        """Delay of a slow signal [s]."""

    @property
    @abstractmethod
    def padding_time(self) -> float:
        """Time [s] by which a signal is continued at each end before it is filtered."""

    @property
    @abstractmethod
    def end_time(self) -> float:
        """Time [s] at each end of a record that is not compared: it depends on how the filter continued the record."""

    @property
    @abstractmethod
    def words(self) -> str:
        """Description without the delay, for a sentence."""

    @abstractmethod
    def compute_response(self, frequency: Array) -> NDArray[np.complex128]:
        """Return the frequency response [1] at ``frequency`` [Hz] (n,)."""

    @abstractmethod
    def align(self) -> Self:
        """Return the filter of a channel that is not late to the inputs."""

    @abstractmethod
    def scale_cutoff(self, factor: float) -> Self:
        """Return the filter with another cut-off frequency, where the noise does not show it exactly."""

    @property
    def has_delay(self) -> bool:
        """Whether a signal leaves the filter later than it enters."""
        return self.delay > 0.0

    @property
    def lateness(self) -> float:
        """Time [s] by which slow signals of the channel are later than those of a simulation."""
        return self.delay

    def compute_gain(self, frequency: Array) -> Array:
        """Return the gain of the amplitude [1] at ``frequency`` [Hz] (n,)."""
        return np.abs(self.compute_response(frequency))

    def apply(self, time: Array, value: Array) -> Array:
        """Return the filtered ``value`` (n,) at equally spaced ``time`` [s] (n,); its ends are continued by reflection
        in a point.
        """
        interval = float(time[-1] - time[0]) / (len(time) - 1)
        padding = min(len(value) - 1, round(self.padding_time / interval))
        before, after = 2.0 * value[0] - value[padding:0:-1], 2.0 * value[-1] - value[-2 : -2 - padding : -1]
        padded = np.concatenate([before, value, after])
        rise = (padded[-1] - padded[0]) / (len(padded) - 1)
        line = padded[0] + rise * np.arange(len(padded))  # without it, the ends of a periodic signal meet
        size = next_fast_len(len(padded), real=True)
        spectrum = rfft(np.pad(padded - line, (0, size - len(padded))))
        filtered = irfft(spectrum * _compute_grid_response(self, size, interval), size)[: len(padded)]
        filtered += line - rise * self.lateness / interval
        return np.asarray(filtered[padding : padding + len(value)])

    def trim_ends(self, series: TimeSeries) -> TimeSeries:
        """Return ``series`` without the samples near its ends, which depend on how the filter continued the record."""
        start, end = series.time[0] + self.end_time, series.time[-1] - self.end_time
        is_inner = (series.time >= start) & (series.time <= end)
        return TimeSeries(series.time[is_inner], series.value[is_inner])


@lru_cache(N_CACHED_RESPONSES)
def _compute_grid_response(applied: ChannelFilter, size: int, interval: float) -> NDArray[np.complex128]:
    """Return the response at the frequencies of a discrete Fourier transform of ``size`` samples."""
    return applied.compute_response(rfftfreq(size, interval))


Filters = Mapping[str, ChannelFilter]
"""Channel -> the filter that it went through."""
