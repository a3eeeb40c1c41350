"""Low-pass filters that channels went through before they came here.

A filter rounds what is fast in a signal, as the jump of a dry friction, in all repeats alike, so a simulation must go
through the same filter. The noise shows it: it was white before, and its spectrum has the shape of the filter. Repeats
differ by noise alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.signal import detrend, periodogram

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.diagnosis.experiments.denoise import MAX_INTERVAL_VARIATION
from klute_sim.types import Array

ORDERS = 1, 2, 3, 4
"""Orders of a Butterworth filter in each of its two passes, forward and backward."""
MIN_ORDER = 2
"""Smallest order of a filter: devices and instruments make noise with a spectrum of the first."""
N_CUTOFFS = 60
"""Number of cut-off frequencies that are tried."""
N_FINER_CUTOFFS = 21
"""Number of cut-off frequencies that are tried between the neighbors of the best one."""
MIN_PASS_BINS = 10
"""Fewest frequencies of a spectrum below half the cut-off, which show whether the noise was white."""
N_STOP_BINS = 30
"""Fewest frequencies at the end of a spectrum, which show whether the noise is gone."""
MAX_PASS_RATIO = 3.0
"""Largest ratio of the noise in the lower and the upper half of this band, either way (assumed)."""
MIN_STOP_RATIO = 100.0
"""Smallest ratio of the power of the noise in this band to that at the highest frequencies (assumed)."""
MAX_CUTOFF_NYQUIST_FRACTION = 0.5
"""Largest cut-off frequency, as a fraction of half the sampling rate."""
MIN_FLOOR_FRACTION = 1e-6
"""Smallest power of the spectrum that counts, over that of its lowest frequencies: less leaks from these."""
FLOOR_FRACTIONS = np.geomspace(MIN_FLOOR_FRACTION, 1e-2, 9)
"""Power of the noise behind the filter, such as that of the last digit, over the power before it, that is tried."""
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


class _Spectrum(NamedTuple):
    frequency: Array
    """Frequencies above 0 [Hz], (n,)."""
    power: Array
    """Power density [SI^2/Hz], (n,)."""
    sampling_rate: float
    """Sampling rate [Hz]."""


def detect_low_pass_filters(trials: Sequence[Trial]) -> dict[str, LowPassFilter]:
    """Return channel -> the filter that it went through in all of ``trials``, for those channels whose noise shows one.

    Needs repeats with the same samples.
    """
    spectra: dict[str, list[_Spectrum]] = {}
    for one, other in combinations(trials, 2):
        if one.group != other.group:
            continue
        for channel in one.measured.keys() & other.measured.keys():
            spectrum = _compute_noise_spectrum(one.measured[channel], other.measured[channel])
            if spectrum is not None:
                spectra.setdefault(channel, []).append(spectrum)
    filters = {channel: _fit_filter(rows) for channel, rows in sorted(spectra.items())}
    return {channel: found for channel, found in filters.items() if found is not None}


def describe_low_pass_filters(filters: Mapping[str, LowPassFilter]) -> list[str]:
    """Return a sentence about the ``filters`` of the channels; none without any."""
    if not filters:
        return []
    names = ", ".join(f"'{channel}' ({found.cutoff:.2g} Hz)" for channel, found in filters.items())
    return [
        f"The noise shows that these channels were low-pass filtered, so the simulation is filtered alike: {names}. "
        "It is taken to have no delay (zero lag); the delay of an amplifier has a name of its own."
    ]


def _compute_noise_spectrum(one: TimeSeries, other: TimeSeries) -> _Spectrum | None:
    """Return the spectrum of the difference of two repeats; None where their samples differ."""
    steps = np.diff(one.time)
    if len(one.time) != len(other.time) or len(steps) < 4 * N_STOP_BINS:
        return None
    if np.ptp(steps) > MAX_INTERVAL_VARIATION * steps.mean() or np.ptp(one.time - other.time) > 0.1 * steps.mean():
        return None
    difference = one.value - other.value
    if not np.isfinite(difference).all() or not difference.any():
        return None
    rate = 1.0 / float(steps.mean())
    frequency, power = periodogram(detrend(difference), rate, window="hann", detrend=False)
    min_power = MIN_FLOOR_FRACTION * float(power[2 : 2 + MIN_PASS_BINS].mean())
    return _Spectrum(frequency[2:-1], np.maximum(power[2:-1], min_power), rate)


def _fit_filter(spectra: Sequence[_Spectrum]) -> LowPassFilter | None:
    """Return the filter whose squared gain the ``spectra`` have; None where they do not show a filter."""
    rate = float(np.median([s.sampling_rate for s in spectra]))
    nyquist = 0.5 * rate
    lowest = max(MIN_PASS_BINS * 2.0 * s.frequency[0] for s in spectra)
    cutoffs = np.geomspace(lowest, nyquist, N_CUTOFFS) if lowest < nyquist else np.empty(0)
    filters = [LowPassFilter(float(cutoff), order, rate) for order in ORDERS for cutoff in cutoffs[:-1]]
    if not filters:
        return None
    coarse = min(filters, key=lambda tried: _compute_misfit(spectra, tried))
    ratio = float(cutoffs[1] / cutoffs[0])
    finer = coarse.cutoff * np.geomspace(1.0 / ratio, ratio, N_FINER_CUTOFFS)
    refined = [replace(coarse, cutoff=float(cutoff)) for cutoff in finer]
    best = min(refined, key=lambda tried: _compute_misfit(spectra, tried))
    has_filter = best.order >= MIN_ORDER and best.cutoff < MAX_CUTOFF_NYQUIST_FRACTION * nyquist
    return best if has_filter and _has_shape(spectra, best.cutoff) else None


def _compute_misfit(spectra: Sequence[_Spectrum], tried: LowPassFilter) -> float:
    """Return the negative logarithm of the likelihood (Whittle, 1953) of white noise through the filter, and a floor.

    The power of the noise is the best one of each spectrum.
    """
    total = 0.0
    for frequency, power, _ in spectra:
        shape = tried.compute_gain(frequency)[None, :] ** 2 + FLOOR_FRACTIONS[:, None]
        level = (power / shape).mean(axis=1)
        total += float(np.min(len(power) * np.log(level) + np.log(shape).sum(axis=1)))
    return total


def _has_shape(spectra: Sequence[_Spectrum], cutoff: float) -> bool:
    """Return whether the noise is white in the pass band of a filter with this ``cutoff`` [Hz], and gone far above."""
    powers = []
    for frequency, power, _ in spectra:
        passed = power[frequency < 0.5 * cutoff]
        stopped = power[-max(N_STOP_BINS, len(power) // 10) :]
        bands = (*np.array_split(passed, 2), stopped)
        powers.append([float(band.mean()) / float(passed.mean()) for band in bands])
    lower, upper, stopped_power = np.mean(powers, axis=0)
    return bool(1.0 / MAX_PASS_RATIO < lower / upper < MAX_PASS_RATIO and stopped_power < 1.0 / MIN_STOP_RATIO)
