"""Low-pass filters of channels, detected from the spectrum of their noise.

A filter rounds what is fast in a signal, as the jump of a dry friction, in all repeats alike, so a simulation must go
through the same filter. The noise shows it: it was white before, possibly with a lag of the sensor, and its spectrum
has the shape of the filter. It is the difference between repeats, of their residuals where their inputs differ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.signal import detrend, periodogram

from klute_sim.diagnosis.experiments.base import Experiment, SimulationSetup
from klute_sim.diagnosis.experiments.denoise import MAX_INTERVAL_VARIATION
from klute_sim.diagnosis.experiments.low_pass import LowPassFilter
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.noise.repeats import align_repeats, list_channels
from klute_sim.types import Array

ORDERS = 1, 2, 3, 4
"""Orders of a Butterworth filter in each of its two passes, forward and backward."""
MIN_ORDER = 2
"""Smallest order of a filter: devices and instruments make noise with a spectrum of the first (assumed)."""
N_CUTOFFS = 60
"""Number of cut-off frequencies that are tried."""
CUTOFF_FACTORS = np.geomspace(0.8, 1.25, 61)
"""Cut-off frequencies that are tried around the best one of an order, over it."""
POLE_FACTORS = np.inf, 4.0, 2.0, 1.0, 0.5
"""Frequencies above which the noise before the filter falls, as that of a sensor with a lag, over the cut-off
frequency."""
MAX_COMMON_LOSS = 4.0
"""Fall of the logarithm of the likelihood of a channel up to which it went through the filter of others (assumed)."""
N_BANDS = 200
"""Number of bands, evenly spaced on a logarithmic scale, in which the frequencies of a spectrum are averaged."""
MIN_PASS_BINS = 10
"""Fewest frequencies of a spectrum below half the cut-off, which show whether the noise was white (assumed)."""
MIN_STOP_FRACTION = 0.9
"""Part of the spectrum above which the noise is gone (assumed)."""
MIN_SAMPLES = 120
"""Fewest samples of a record whose spectrum shows a filter (assumed)."""
MAX_PASS_RATIO = 3.0
"""Largest ratio of the noise in the lower and the upper half of this band, either way (assumed)."""
MIN_STOP_RATIO = 100.0
"""Smallest ratio of the power of the noise in this band to that at the highest frequencies (assumed)."""
MAX_CUTOFF_NYQUIST_FRACTION = 0.5
"""Largest cut-off frequency, as a fraction of half the sampling rate (assumed)."""
MIN_POWER_FRACTION = 1e-4
"""Power, over that of the lowest frequencies, below which a spectrum ends for a fit: beyond, other noise begins."""
FLOOR_FRACTIONS = np.append(1e-12, np.geomspace(MIN_POWER_FRACTION, 1e-2, 5))
"""Power of the noise behind the filter, such as that of the last digit, over the power before it, that is tried; the
first one is that of rounding errors."""


class _Spectrum(NamedTuple):
    frequency: Array
    """Frequencies above 0 [Hz], (n,)."""
    power: Array
    """Power density [SI^2/Hz], (n,)."""
    n_averaged: Array
    """Number of averaged frequencies, (n,)."""


def add_low_pass_filters(
    experiments: Sequence[Experiment],
    fit_experiments: Sequence[Experiment],
    sampling_rates: Mapping[str, float],
    simulator: Simulator,
) -> list[Experiment]:
    """Return ``experiments`` with the filters detected in ``fit_experiments``.

    ``sampling_rates`` [Hz] are those of the measured channels before samples were left out. Samples near the ends of a
    filtered record are left out. Channels without repeats get no filter.
    """
    values = [{channel: series.value for channel, series in e.measured.items()} for e in fit_experiments]
    residuals = _compute_residuals(fit_experiments, simulator)
    differences = {}
    for channel in list_channels(fit_experiments):
        candidates = [_compare_repeats(fit_experiments, rows, channel) for rows in (values, residuals)]
        # Residuals contain the noise of the recorded inputs, and values what differs between the inputs.
        differences[channel] = min(candidates, key=lambda rows: float(np.sum([change @ change for _, change in rows])))
    filters = detect_low_pass_filters(differences, sampling_rates)
    return [_add_filters(e, filters) if filters else e for e in experiments]


def _compute_residuals(experiments: Sequence[Experiment], simulator: Simulator) -> list[dict[str, Array]]:
    """Return for each experiment: channel -> residual of the nominal device [SI]."""
    setups = [SimulationSetup(e.device.parameters) for e in experiments]
    return [
        {channel: series.value - reading[channel] for channel, series in e.measured.items()}
        for e, reading in zip(experiments, simulator.simulate([setups], experiments)[0], strict=True)
    ]


def _compare_repeats(
    experiments: Sequence[Experiment], rows: Sequence[Mapping[str, Array]], channel: str
) -> list[tuple[Array, Array]]:
    """Return times [s] (n,) and the difference between two repeats (n,) of ``rows`` in ``channel``, for each pair."""
    return [
        (repeats.time, one - other)
        for repeats in align_repeats(experiments, rows, channel)
        for one, other in combinations(repeats.residuals, 2)
    ]


def _add_filters(experiment: Experiment, filters: Mapping[str, LowPassFilter]) -> Experiment:
    measured = {
        channel: filters[channel].trim_ends(series) if channel in filters else series
        for channel, series in experiment.measured.items()
    }
    return replace(experiment, measured=measured, filters=filters)


def describe_low_pass_filters(experiments: Sequence[Experiment]) -> list[str]:
    """Return a sentence about the channels of ``experiments`` that were filtered; none without any."""
    filters = dict(item for e in experiments for item in e.filters.items())
    if not filters:
        return []
    names = ", ".join(f"'{channel}' ({found.cutoff:.2g} Hz)" for channel, found in filters.items())
    return [
        f"The noise shows that these channels were low-pass filtered, so the simulation is filtered alike: {names}. "
        "It is taken to have no delay (zero lag); state that of an amplifier in [delay]."
    ]


def _compute_spectrum(time: Array, difference: Array) -> _Spectrum | None:
    """Return the spectrum of the ``difference`` of two repeats (n,) at ``time`` [s] (n,); None where it shows none."""
    steps = np.diff(time)
    if len(time) < MIN_SAMPLES or np.ptp(steps) > MAX_INTERVAL_VARIATION * steps.mean() or not difference.any():
        return None
    rate = 1.0 / float(steps.mean())
    frequency, power = periodogram(detrend(difference), rate, window="hann", detrend=False)
    frequency, power = frequency[2:-1], power[2:-1]
    starts = np.unique(np.searchsorted(frequency, np.geomspace(frequency[0], frequency[-1], N_BANDS)))
    n_averaged = np.diff(np.append(starts, len(frequency)))
    mean_frequency, mean_power = (np.add.reduceat(values, starts) / n_averaged for values in (frequency, power))
    return _Spectrum(mean_frequency, mean_power, n_averaged.astype(np.float64))


def detect_low_pass_filters(
    differences: Mapping[str, Sequence[tuple[Array, Array]]], sampling_rates: Mapping[str, float]
) -> dict[str, LowPassFilter]:
    """Return channel -> the filter that its noise went through, for those channels that show one.

    ``differences`` between repeats are pairs of times [s] (n,) and values [SI] (n,); ``sampling_rates`` [Hz] are those
    of the filters. Channels share a filter where that is nearly as likely, because the noise of one shows it to a few
    per cent only, and noise that is not white beside it not at all.
    """
    spectra, likeliest, filters = {}, {}, {}
    for channel, rows in differences.items():
        own = [s for s in (_compute_spectrum(*difference) for difference in rows) if s is not None]
        found = _find_likeliest(own, sampling_rates[channel]) if own else None
        if found is None:
            continue
        spectra[channel], likeliest[channel] = [_cut_spectrum(s) for s in own], found
        if found.order >= MIN_ORDER and _has_shape(own, found.cutoff):
            filters[channel] = found
    if not filters:
        return {}
    start = next(iter(filters.values()))
    common = _fit_filter([s for channel in filters for s in spectra[channel]], start)
    losses = {c: _compute_misfit(own, common) - _compute_misfit(own, likeliest[c]) for c, own in spectra.items()}
    is_shared = all(losses[channel] <= MAX_COMMON_LOSS for channel in filters)
    for channel, loss in losses.items():
        if loss <= MAX_COMMON_LOSS and (is_shared or channel not in filters):
            filters[channel] = replace(common, sampling_rate=sampling_rates[channel])
    return filters


def _find_likeliest(spectra: Sequence[_Spectrum], sampling_rate: float) -> LowPassFilter | None:
    """Return the most likely filter of one channel with ``spectra``; None where they show none with a stop band."""
    nyquist = min(s.frequency[-1] for s in spectra)
    lowest = max(MIN_PASS_BINS * 2.0 * s.frequency[0] for s in spectra)
    if lowest >= nyquist:
        return None
    passed = [_cut_spectrum(spectrum) for spectrum in spectra]
    coarse = [
        LowPassFilter(float(cutoff), order, sampling_rate)
        for order in ORDERS
        for cutoff in np.geomspace(lowest, nyquist, N_CUTOFFS)[:-1]
    ]
    best = _fit_filter(passed, min(coarse, key=lambda tried: _compute_misfit(passed, tried)))
    return best if best.cutoff < MAX_CUTOFF_NYQUIST_FRACTION * nyquist else None


def _fit_filter(spectra: Sequence[_Spectrum], start: LowPassFilter) -> LowPassFilter:
    """Return the most likely filter near ``start``, of any order."""
    tried = [replace(start, cutoff=start.cutoff * float(x), order=order) for order in ORDERS for x in CUTOFF_FACTORS]
    return min(tried, key=lambda each: _compute_misfit(spectra, each))


def _cut_spectrum(spectrum: _Spectrum) -> _Spectrum:
    """Return ``spectrum`` up to where its power falls below :data:`MIN_POWER_FRACTION`."""
    n_lowest = int(np.searchsorted(np.cumsum(spectrum.n_averaged), MIN_PASS_BINS)) + 1
    lowest = float(np.average(spectrum.power[:n_lowest], weights=spectrum.n_averaged[:n_lowest]))
    below = np.flatnonzero(spectrum.power < MIN_POWER_FRACTION * lowest)
    end = max(n_lowest, int(below[0])) if len(below) else len(spectrum.power)
    return _Spectrum(*(values[:end] for values in spectrum))


def _compute_misfit(spectra: Sequence[_Spectrum], tried: LowPassFilter) -> float:
    """Return the negative logarithm of the likelihood (Whittle, 1953) of noise through the filter, and a floor.

    The noise before the filter is white up to a pole. Its power, pole and floor are the best ones of each spectrum.
    """
    poles = tried.cutoff * np.array(POLE_FACTORS)
    total = 0.0
    for frequency, power, n_averaged in spectra:
        noise = 1.0 / (1.0 + (frequency / poles[:, None]) ** 2)
        shape = noise[:, None, :] * tried.compute_gain(frequency) ** 2 + FLOOR_FRACTIONS[:, None]
        n = n_averaged.sum()
        level = (n_averaged * power / shape).sum(axis=-1) / n
        has_pole = 0.5 * np.log(n) * np.isfinite(poles)[:, None]  # one more parameter, as in half of BIC
        total += float(np.min(n * np.log(level) + (n_averaged * np.log(shape)).sum(axis=-1) + has_pole))
    return total


def _has_shape(spectra: Sequence[_Spectrum], cutoff: float) -> bool:
    """Return whether the noise is white in the pass band of a filter with this ``cutoff`` [Hz], and gone far above."""
    powers = []
    for frequency, power, n_averaged in spectra:
        lower, upper = frequency < 0.25 * cutoff, (frequency >= 0.25 * cutoff) & (frequency < 0.5 * cutoff)
        bands = lower, upper, frequency > MIN_STOP_FRACTION * frequency[-1], lower | upper
        means = [float(np.average(power[band], weights=n_averaged[band])) if band.any() else np.nan for band in bands]
        powers.append([mean / means[-1] for mean in means[:-1]])
    lower, upper, stopped_power = np.mean(powers, axis=0)
    return bool(1.0 / MAX_PASS_RATIO < lower / upper < MAX_PASS_RATIO and stopped_power < 1.0 / MIN_STOP_RATIO)
