"""Hum of the electric mains in a channel: a line at 50 or 60 Hz and its multiples.

Its phase differs from trial to trial, but within a trial it repeats itself, so the products of two repeats do not
average out as those of noise do. It is fitted at its own frequency and subtracted.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.signal import detrend, periodogram

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.experiments.denoise import MAX_INTERVAL_VARIATION
from klute_sim.types import Array

MAINS_FREQUENCIES = 50.0, 60.0
"""Frequencies of public networks [Hz] (IEC 60196:2009)."""
MAX_FREQUENCY_DEVIATION = 0.01
"""Largest deviation of the frequency, as a fraction of it: 50 Hz are kept within 1 % for 99.5 % of a year
(EN 50160:2010)."""
MAX_NYQUIST_FRACTION = 0.95
"""Largest frequency of a line, as a fraction of half the sampling rate (assumed)."""
NEIGHBOR_RANGE_HZ = 15.0
"""Distance within which no other line may be [Hz]: a periodic motion has lines at all multiples of its frequency
(assumed)."""
MIN_PEAK_RATIO = 4.0
"""Smallest ratio of the power of a line to the largest power beside it (assumed: white noise reaches about ten times
its mean)."""
LINE_WIDTH_BINS, LINE_WIDTH_HZ = 3, 0.1
"""Distance from its peak within which a line has power, the larger of the two: in frequencies of the periodogram (Hann
window), and by its wander [Hz] (assumed)."""
MIN_DURATION = 2.0
"""Shortest record whose spectrum separates the mains from other frequencies [s] (assumed)."""
SEGMENT_DURATION = 10.0
"""Longest interval in which the frequency counts as constant [s] (assumed: it wanders by 0.02 Hz in a minute)."""
MIN_AMPLITUDE_FRACTION = 1e-9
"""Smallest amplitude of a line, as a fraction of the largest value: a smaller one is an error of rounding (assumed)."""
N_FREQUENCIES = 15
"""Number of frequencies that are tried within one bin of a peak, and again between the neighbors of the best one."""


class MainsLine(NamedTuple):
    """Line of the mains in one channel of a trial."""

    frequency: float
    """Nominal frequency [Hz]."""
    amplitude: float
    """Amplitude [SI]."""


def remove_mains_hum(trial: Trial) -> Trial:
    """Return ``trial`` without the hum of the mains in any channel."""
    return replace(
        trial,
        prescribed={name: _split_hum(series)[0] for name, series in trial.prescribed.items()},
        measured={name: _split_hum(series)[0] for name, series in trial.measured.items()},
    )


def describe_mains_hum(trials: Sequence[Trial]) -> list[str]:
    """Return a sentence about the channels of ``trials`` with a hum, and its largest lines; none without any."""
    amplitudes: dict[str, dict[float, float]] = {}
    for trial in trials:
        for name, series in (*trial.prescribed.items(), *trial.measured.items()):
            for frequency, amplitude in _split_hum(series)[1]:
                lines = amplitudes.setdefault(name, {})
                lines[frequency] = max(lines.get(frequency, 0.0), amplitude)
    if not amplitudes:
        return []
    channels = []
    for name, lines in amplitudes.items():
        unit, factor = CHANNEL_UNITS[name]
        listed = " and ".join(f"{amplitude / factor:.2g} {unit} at {f:g} Hz" for f, amplitude in lines.items())
        channels.append(f"'{name}' ({listed})")
    return [f"The hum of the mains is subtracted from {', '.join(channels)}; check shield and ground of the cables."]


def _split_hum(series: TimeSeries) -> tuple[TimeSeries, list[MainsLine]]:
    """Return ``series`` without the hum of the mains, and the lines that were subtracted."""
    steps = np.diff(series.time)
    is_finite = np.isfinite(series.value)
    has_even_samples = len(steps) > 0 and np.ptp(steps) <= MAX_INTERVAL_VARIATION * steps.mean()
    if not has_even_samples or series.time[-1] - series.time[0] < MIN_DURATION or is_finite.sum() < len(steps) / 2:
        return series, []
    rate = 1.0 / float(steps.mean())
    value = np.interp(series.time, series.time[is_finite], series.value[is_finite])
    lines = []
    for mains in MAINS_FREQUENCIES:
        for multiple in range(1, int(MAX_NYQUIST_FRACTION * 0.5 * rate / mains) + 1):
            hum = _fit_line(series.time, value, rate, multiple * mains)
            amplitude = 0.0 if hum is None else float(np.sqrt(2.0) * hum.std())
            if hum is None or amplitude <= MIN_AMPLITUDE_FRACTION * np.abs(value).max():
                continue
            value = value - hum
            lines.append(MainsLine(multiple * mains, amplitude))
    return (series._replace(value=np.where(is_finite, value, np.nan)), lines) if lines else (series, [])


def _fit_line(time: Array, value: Array, rate: float, nominal_frequency: float) -> Array | None:
    """Return the hum in ``value`` (n,) near ``nominal_frequency`` [Hz], (n,); None where it is no line of its own."""
    frequencies, power = periodogram(detrend(value), rate, window="hann", detrend=False)
    bin_width = frequencies[1]
    near = np.abs(frequencies - nominal_frequency) <= MAX_FREQUENCY_DEVIATION * nominal_frequency + bin_width
    peak = int(np.argmax(np.where(near, power, 0.0)))
    distance = np.abs(frequencies - frequencies[peak])
    beside = (distance > max(LINE_WIDTH_BINS * bin_width, LINE_WIDTH_HZ)) & (distance <= NEIGHBOR_RANGE_HZ)
    if power[peak] <= MIN_PEAK_RATIO * power[beside].max(initial=0.0):
        return None
    hum = np.empty(len(value))
    n_segments = max(1, round((time[-1] - time[0]) / SEGMENT_DURATION))
    for part in np.array_split(np.arange(len(value)), n_segments):
        hum[part] = _fit_sine_near(time[part], value[part], float(frequencies[peak]), rate / len(part))
    return hum


def _fit_sine_near(time: Array, value: Array, frequency: float, width: float) -> Array:
    """Return the largest sine in ``value`` (n,) within ``width`` of ``frequency`` [Hz]: (n,)."""
    best = np.zeros(len(value))
    for half_width in (width, 2.0 * width / (N_FREQUENCIES - 1)):
        frequencies = frequency + np.linspace(-half_width, half_width, N_FREQUENCIES)
        fits = [_fit_sine(time, value, f) for f in frequencies]
        index = int(np.argmax([fit @ fit for fit in fits]))
        frequency, best = float(frequencies[index]), fits[index]
    return best


def _fit_sine(time: Array, value: Array, frequency: float) -> Array:
    """Return the sine of ``frequency`` [Hz] in ``value`` (n,) at ``time`` [s] (n,) by least squares: (n,)."""
    phase = 2.0 * np.pi * frequency * (time - time[0])
    window = np.hanning(len(time) + 2)[1:-1]  # keeps the motion, which is large and slow, out of the fit
    waves = np.column_stack([np.cos(phase), np.sin(phase)])
    coefficients = np.linalg.lstsq(window[:, None] * waves, window * (value - value.mean()))[0]
    return np.asarray(waves @ coefficients)
