"""Spectra of noise, and the likelihood of their shapes."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import detrend, periodogram

from klute_sim.diagnosis.experiments.denoise import MAX_INTERVAL_VARIATION
from klute_sim.types import Array

N_BANDS = 200
"""Number of bands, evenly spaced on a logarithmic scale, in which the frequencies of a spectrum are averaged."""
MIN_SAMPLES = 120
"""Fewest samples of a record whose spectrum shows a filter (assumed)."""
MIN_STOP_FRACTION = 0.9
"""Part of the spectrum above which the noise is gone (assumed)."""
MIN_POWER_FRACTION = 1e-4
"""Power, over that of the lowest frequencies, below which a spectrum ends for a fit: beyond, other noise begins."""
FLOOR_FRACTIONS = np.append(1e-12, np.geomspace(MIN_POWER_FRACTION, 1e-2, 5))
"""Power of the noise behind the filter, such as that of the last digit, over the power before it, that is tried; the
first one is that of rounding errors."""


class Spectrum(NamedTuple):
    """Spectrum of a record."""

    frequency: Array
    """Frequencies above 0 [Hz], (n,)."""
    power: Array
    """Power density [SI^2/Hz], (n,)."""
    n_averaged: Array
    """Number of averaged frequencies, (n,)."""


def compute_spectrum(time: Array, difference: Array, *, is_banded: bool = True) -> Spectrum | None:
    """Return the spectrum of the ``difference`` of two repeats (n,) at ``time`` [s] (n,); None where it shows none.

    Frequencies are averaged in bands, unless not ``is_banded``.
    """
    steps = np.diff(time)
    if len(time) < MIN_SAMPLES or np.ptp(steps) > MAX_INTERVAL_VARIATION * steps.mean() or not difference.any():
        return None
    rate = 1.0 / float(steps.mean())
    frequency, power = periodogram(detrend(difference), rate, window="hann", detrend=False)
    frequency, power = frequency[2:-1], power[2:-1]
    if not is_banded:
        return Spectrum(frequency, power, np.ones(len(frequency)))
    starts = np.unique(np.searchsorted(frequency, np.geomspace(frequency[0], frequency[-1], N_BANDS)))
    n_averaged = np.diff(np.append(starts, len(frequency)))
    mean_frequency, mean_power = (np.add.reduceat(values, starts) / n_averaged for values in (frequency, power))
    return Spectrum(mean_frequency, mean_power, n_averaged.astype(np.float64))


def compute_negative_log_likelihood(
    spectra: Sequence[Spectrum], compute_power: Callable[[Array], Array], poles: Array
) -> float:
    """Return the negative logarithm of the likelihood (Whittle, 1953) of noise through a filter, and a floor.

    ``compute_power`` returns the squared gain of the filter at frequencies [Hz]. The noise before it is white up to one
    of ``poles`` [Hz]. Its power, pole and floor are the best ones of each spectrum.
    """
    total = 0.0
    for frequency, power, n_averaged in spectra:
        noise = 1.0 / (1.0 + (frequency / poles[:, None]) ** 2)
        shape = noise[:, None, :] * compute_power(frequency) + FLOOR_FRACTIONS[:, None]
        n = n_averaged.sum()
        level = (n_averaged * power / shape).sum(axis=-1) / n
        has_pole = 0.5 * np.log(n) * np.isfinite(poles)[:, None]  # one more parameter, as in half of BIC
        total += float(np.min(n * np.log(level) + (n_averaged * np.log(shape)).sum(axis=-1) + has_pole))
    return total


def compute_stop_ratio(spectra: Sequence[Spectrum], end: float) -> float:
    """Return the power of the noise at the highest frequencies over that up to ``end`` [Hz]."""
    return float(
        np.mean(
            [
                average_power(s, MIN_STOP_FRACTION * s.frequency[-1], np.inf) / average_power(s, 0.0, end)
                for s in spectra
            ]
        )
    )


def average_power(spectrum: Spectrum, start: float, end: float) -> float:
    """Return the mean power density [SI^2/Hz] from ``start`` to ``end`` [Hz]; not a number without any frequency."""
    is_inside = (spectrum.frequency >= start) & (spectrum.frequency < end)
    if not is_inside.any():
        return math.nan
    return float(np.average(spectrum.power[is_inside], weights=spectrum.n_averaged[is_inside]))
