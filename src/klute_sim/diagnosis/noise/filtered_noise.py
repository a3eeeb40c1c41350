"""Low-pass filters of channels, detected from the spectrum of their noise.

A filter rounds what is fast in a signal, as the jump of a dry friction, in all repeats alike, so a simulation must go
through the same filter. The noise shows it: it was white before, possibly with a lag of the sensor, and its spectrum
has the shape of the filter. It is the difference between repeats, of their residuals where their inputs differ.

A spectrum does not show the phase of a filter, but those of amplifiers, which have a delay, fall in another way than
those that a program applies forward and backward. Where that does not decide, the signals do
(:mod:`klute_sim.diagnosis.filter_refinement`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.signal import detrend, periodogram

from klute_sim.diagnosis.experiments.base import Experiment, SimulationSetup
from klute_sim.diagnosis.experiments.denoise import MAX_INTERVAL_VARIATION
from klute_sim.diagnosis.experiments.low_pass import FilterKind, LowPassFilter
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.noise.repeats import align_repeats, list_channels
from klute_sim.types import Array

ZERO_LAG_SHAPES: tuple[tuple[FilterKind, int], ...] = tuple(("zero-lag", order) for order in (1, 2, 3, 4))
"""Kinds and orders of the filters without delay that are tried."""
DELAYING_SHAPES: tuple[tuple[FilterKind, int], ...] = (
    *(("butterworth", order) for order in (2, 3, 4, 6, 8)),
    *(("bessel", order) for order in (2, 4, 6, 8)),
)
"""Kinds and orders of the filters with delay that are tried."""
MIN_EXPONENT = 4
"""Smallest exponent of a filter in its stop band: devices and instruments make noise with smaller ones (assumed)."""
MIN_KIND_GAIN = 10.0
"""Gain of the logarithm of the likelihood by which the noise shows a filter with delay (assumed)."""
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


Filters = dict[str, LowPassFilter]
"""Channel -> the filter that it went through."""
Shapes = tuple[tuple[FilterKind, int], ...]


def add_low_pass_filters(
    experiments: Sequence[Experiment],
    fit_experiments: Sequence[Experiment],
    sampling_rates: Mapping[str, float],
    simulator: Simulator,
) -> tuple[list[Experiment], Filters]:
    """Return ``experiments`` with the filters detected in ``fit_experiments``, and those of the other kind.

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
    filters, others = detect_low_pass_filters(differences, sampling_rates)
    return [_add_filters(e, filters) if filters else e for e in experiments], others


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
    names = ", ".join(f"'{channel}' ({_describe_filter(found)})" for channel, found in filters.items())
    sentence = (
        "The noise shows that these channels were low-pass filtered, so the simulation is filtered alike: " + names
    )
    if any(found.has_delay for found in filters.values()):
        if all(found.is_aligned for found in filters.values()):
            return [f"{sentence}. The inputs are as late as these channels, or the delays were subtracted."]
        return [f"{sentence}. The simulation has their delay, too, as behind an amplifier."]
    return [f"{sentence}. They are taken to have no delay (zero lag); state that of an amplifier in [delay]."]


def _describe_filter(found: LowPassFilter) -> str:
    return f"{found.cutoff:.2g} Hz" + (f", delay {1e3 * found.delay:.3g} ms" if found.has_delay else "")


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
) -> tuple[Filters, Filters]:
    """Return the filters that the noise of channels went through, and those of the other kind, with or without delay.

    ``differences`` between repeats are pairs of times [s] (n,) and values [SI] (n,); ``sampling_rates`` [Hz] are those
    of the filters. The likelier kind is the first one, but without clear evidence it has no delay. Channels without a
    filter are left out.
    """
    spectra = {
        channel: [s for s in (_compute_spectrum(*difference) for difference in rows) if s is not None]
        for channel, rows in differences.items()
    }
    (zero_lag, misfits), (delaying, other_misfits) = (
        _detect_kind(spectra, sampling_rates, shapes) for shapes in (ZERO_LAG_SHAPES, DELAYING_SHAPES)
    )
    compared = (zero_lag.keys() | delaying.keys()) & misfits.keys() & other_misfits.keys()
    gain = sum(misfits[channel] - other_misfits[channel] for channel in compared)
    has_delay = delaying and (not zero_lag or gain > MIN_KIND_GAIN)
    return (delaying, zero_lag) if has_delay else (zero_lag, delaying)


def _detect_kind(
    all_spectra: Mapping[str, Sequence[_Spectrum]], sampling_rates: Mapping[str, float], shapes: Shapes
) -> tuple[Filters, dict[str, float]]:
    """Return the filters of these ``shapes`` that the noise went through, and the least misfit of each channel.

    Channels share a filter where that is nearly as likely, because the noise of one shows it to a few per cent only,
    and noise that is not white beside it not at all.
    """
    spectra, likeliest, filters = {}, {}, {}
    for channel, own in all_spectra.items():
        found = _find_likeliest(own, sampling_rates[channel], shapes) if own else None
        if found is None:
            continue
        spectra[channel], likeliest[channel] = [_cut_spectrum(s) for s in own], found
        if found.stop_band_exponent >= MIN_EXPONENT and _has_shape(own, found.cutoff):
            filters[channel] = found
    misfits = {channel: _compute_misfit(own, likeliest[channel]) for channel, own in spectra.items()}
    if not filters:
        return {}, misfits
    start = next(iter(filters.values()))
    common = _fit_filter([s for channel in filters for s in spectra[channel]], start, shapes)
    losses = {c: _compute_misfit(own, common) - misfits[c] for c, own in spectra.items()}
    is_shared = all(losses[channel] <= MAX_COMMON_LOSS for channel in filters)
    for channel, loss in losses.items():
        if loss <= MAX_COMMON_LOSS and (is_shared or channel not in filters):
            filters[channel] = replace(common, sampling_rate=sampling_rates[channel])
    return filters, misfits


def _find_likeliest(spectra: Sequence[_Spectrum], sampling_rate: float, shapes: Shapes) -> LowPassFilter | None:
    """Return the most likely filter of one channel with ``spectra``; None where they show none with a stop band."""
    nyquist = min(s.frequency[-1] for s in spectra)
    lowest = max(MIN_PASS_BINS * 2.0 * s.frequency[0] for s in spectra)
    if lowest >= nyquist:
        return None
    passed = [_cut_spectrum(spectrum) for spectrum in spectra]
    coarse = [
        LowPassFilter(float(cutoff), order, sampling_rate, kind)
        for kind, order in shapes
        for cutoff in np.geomspace(lowest, nyquist, N_CUTOFFS)[:-1]
    ]
    best = _fit_filter(passed, min(coarse, key=lambda tried: _compute_misfit(passed, tried)), shapes)
    return best if best.cutoff < MAX_CUTOFF_NYQUIST_FRACTION * nyquist else None


def _fit_filter(spectra: Sequence[_Spectrum], start: LowPassFilter, shapes: Shapes) -> LowPassFilter:
    """Return the most likely filter near ``start``, of one of these ``shapes``."""
    tried = [
        replace(start, cutoff=start.cutoff * float(factor), order=order, kind=kind)
        for kind, order in shapes
        for factor in CUTOFF_FACTORS
    ]
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
