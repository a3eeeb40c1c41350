"""Low-pass filter that a channel went through before it came here."""

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

from klute_sim.datasets.trial import TimeSeries
from klute_sim.types import Array

PADDING_PERIODS = 3.0
"""Length by which a signal is continued at each end before it is filtered [periods of the cut-off frequency]."""
END_PERIODS = 2.0
"""Length at each end of a record that is not compared [periods of the cut-off frequency] (assumed)."""


@dataclass(frozen=True)
class LowPassFilter:
    """Butterworth filter, forward and backward, so without delay."""

    cutoff: float
    """Frequency [Hz] at which the amplitude is halved."""
    order: int
    """Order of each pass."""
    sampling_rate: float
    """Sampling rate of the filtered channel [Hz]."""

    def compute_gain(self, frequency: Array) -> Array:
        """Return the gain of the amplitude [1] at ``frequency`` [Hz] (n,).

        It is ``1 / (1 + (tan(pi f / f_s) / tan(pi f_c / f_s))^(2 order))`` with the sampling rate ``f_s``, by the
        bilinear transform (Oppenheim and Schafer, Discrete-Time Signal Processing, 2010, 7.2), and 0 above half of it.
        """
        is_sampled = frequency < 0.5 * self.sampling_rate
        ratio = np.tan(np.pi * frequency[is_sampled] / self.sampling_rate) / np.tan(
            np.pi * self.cutoff / self.sampling_rate
        )
        gain = np.zeros(len(frequency))
        gain[is_sampled] = 1.0 / (1.0 + ratio ** (2 * self.order))
        return gain

    def apply(self, time: Array, value: Array) -> Array:
        """Return the filtered ``value`` (n,) at equally spaced ``time`` [s] (n,); its ends are continued by reflection
        in a point.
        """
        interval = float(time[-1] - time[0]) / (len(time) - 1)
        padding = min(len(value) - 1, round(PADDING_PERIODS / self.cutoff / interval))
        before, after = 2.0 * value[0] - value[padding:0:-1], 2.0 * value[-1] - value[-2 : -2 - padding : -1]
        padded = np.concatenate([before, value, after])
        slope = np.linspace(padded[0], padded[-1], len(padded))  # the ends of a periodic signal meet
        size = next_fast_len(len(padded), real=True)
        spectrum = rfft(np.pad(padded - slope, (0, size - len(padded))))
        filtered = irfft(spectrum * self.compute_gain(rfftfreq(size, interval)), size)[: len(padded)] + slope
        return np.asarray(filtered[padding : padding + len(value)])

    def trim_ends(self, series: TimeSeries) -> TimeSeries:
        """Return ``series`` without the samples near its ends, which depend on how the filter continued the record."""
        margin = END_PERIODS / self.cutoff
        is_inner = (series.time >= series.time[0] + margin) & (series.time <= series.time[-1] - margin)
        return TimeSeries(series.time[is_inner], series.value[is_inner])
