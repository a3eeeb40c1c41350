"""Low-pass filters of channels, detected from the spectrum of their noise.

A filter rounds what is fast in a signal, as the jump of a dry friction, in all repeats alike, so a simulation must go
through the same filter. The noise shows it: it was white before, possibly with a lag of the sensor, and its spectrum
has the shape of the filter. It is the difference between repeats, of their residuals where their inputs differ.

A spectrum does not show the phase of a filter, but those of amplifiers, which have a delay, fall in another way than
those that a program applies forward and backward. Moving averages have their own shape
(:mod:`klute_sim.diagnosis.noise.window_noise`). Where the noise permits several filters, the signals decide
(:mod:`klute_sim.diagnosis.filter_refinement`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.experiments.base import MIN_SERIES_SAMPLES, Experiment
from klute_sim.diagnosis.experiments.channel_filter import ChannelFilter, Filters
from klute_sim.diagnosis.experiments.low_pass import FilterKind, LowPassFilter
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.noise.repeats import align_repeats, list_channels
from klute_sim.diagnosis.noise.spectrum import (
    MIN_POWER_FRACTION,
    Spectrum,
    average_power,
    compute_negative_log_likelihood,
    compute_spectrum,
    compute_stop_ratio,
)
from klute_sim.diagnosis.noise.window_noise import find_window
from klute_sim.types import Array

ZERO_LAG_ORDERS = 1, 2, 3, 4
"""Orders of the filters without delay that are tried."""
DELAYING_ORDERS: Mapping[FilterKind, Sequence[int]] = {"butterworth": (2, 3, 4, 6, 8), "bessel": (2, 4, 6, 8)}
"""Kind -> orders of the filters with delay that are tried."""
MIN_EXPONENT = 4
"""Smallest exponent of a filter in its stop band: devices and instruments make noise with smaller ones (assumed)."""
MAX_SHAPE_LOSS = 10.0
"""Fall of the logarithm of the likelihood up to which the noise permits a filter with delay of another shape
(assumed)."""
MIN_KIND_GAIN = 10.0
"""Gain of the logarithm of the likelihood by which the noise shows a filter with delay (assumed)."""
N_CUTOFFS = 40
"""Number of cut-off frequencies that are tried."""
CUTOFF_FACTORS = np.geomspace(0.87, 1.15, 29)
"""Cut-off frequencies that are tried around the best one of an order, over it."""
POLE_FACTORS = np.inf, 4.0, 2.0, 1.0, 0.5
"""Frequencies above which the noise before the filter falls, as that of a sensor with a lag, over the cut-off
frequency."""
MAX_COMMON_LOSS = 10.0
"""Fall of the logarithm of the likelihood of a channel up to which it went through the filter of others (assumed)."""
MIN_PASS_BINS = 10
"""Fewest frequencies of a spectrum below half the cut-off, which show whether the noise was white (assumed)."""
MAX_PASS_RATIO = 3.0
"""Largest ratio of the noise in the lower and the upper half of this band, either way (assumed)."""
MAX_STOP_RATIO = 0.01
"""Largest ratio of the power of the noise at the highest frequencies to that in this band (assumed)."""
MAX_CUTOFF_NYQUIST_FRACTION = 0.5
"""Largest cut-off frequency, as a fraction of half the sampling rate (assumed)."""


class _Candidate(NamedTuple):
    filters: Filters
    negative_log_likelihood: float
    """That of the noise of the filtered channels."""
    has_delay: bool


def add_low_pass_filters(
    experiments: Sequence[Experiment],
    fit_experiments: Sequence[Experiment],
    sampling_rates: Mapping[str, float],
    simulator: Simulator,
) -> tuple[list[Experiment], list[Filters]]:
    """Return ``experiments`` with the filters detected in ``fit_experiments``, and others that the noise permits.

    ``sampling_rates`` [Hz] are those of the measured channels before samples were left out. Samples near the ends of a
    filtered record are left out, and a record that is shorter than its ends is left out completely. Channels without
    repeats get no filter.
    """
    values = [{channel: series.value for channel, series in e.measured.items()} for e in fit_experiments]
    residuals = simulator.compute_nominal_residuals(fit_experiments)
    differences = {}
    for channel in list_channels(fit_experiments):
        candidates = [_compare_repeats(fit_experiments, rows, channel) for rows in (values, residuals)]
        # Residuals contain the noise of the recorded inputs, and values what differs between the inputs.
        differences[channel] = min(candidates, key=lambda rows: float(np.sum([change @ change for _, change in rows])))
    filters, *others = detect_filters(differences, sampling_rates) or [{}]
    return [_add_filters(e, filters) if filters else e for e in experiments], others


def _compare_repeats(
    experiments: Sequence[Experiment], rows: Sequence[Mapping[str, Array]], channel: str
) -> list[tuple[Array, Array]]:
    """Return times [s] (n,) and the difference between two repeats (n,) of ``rows`` in ``channel``, for each pair."""
    return [
        (repeats.time, one - other)
        for repeats in align_repeats(experiments, rows, channel)
        for one, other in combinations(repeats.residuals, 2)
    ]


def _add_filters(experiment: Experiment, filters: Filters) -> Experiment:
    """Return ``experiment`` with ``filters``, without the channels that are shorter than their ends."""
    trimmed = {
        channel: filters[channel].trim_ends(series) if channel in filters else series
        for channel, series in experiment.measured.items()
    }
    measured = {channel: series for channel, series in trimmed.items() if len(series.time) >= MIN_SERIES_SAMPLES}
    return replace(experiment, measured=measured, filters=filters)


def describe_low_pass_filters(experiments: Sequence[Experiment], detected: Filters) -> list[str]:
    """Return sentences about the channels of ``experiments`` that were filtered; none without any.

    ``detected`` are the filters that the noise shows first. The simulation does without those of channels that agree
    better so, as where the inputs went through the same.
    """
    filters = dict(item for e in experiments for item in e.filters.items())
    sentences = []
    if filters:
        start = "The noise shows that these channels were low-pass filtered, so the simulated ones are, too"
        sentences.append(f"{start}: {_list_filters(filters)}. {_describe_delay(filters)}")
    unused = {channel: other for channel, other in detected.items() if channel not in filters}
    if unused:
        sentences.append(
            f"The noise shows that these channels were low-pass filtered: {_list_filters(unused)}. They agree better "
            "with an unfiltered simulation, as they do if the inputs went through the same filter."
        )
    return sentences


def _list_filters(filters: Filters) -> str:
    return ", ".join(f"'{channel}' ({_describe_filter(applied)})" for channel, applied in filters.items())


def _describe_delay(filters: Filters) -> str:
    if not any(applied.has_delay for applied in filters.values()):
        return "They are taken to have no delay (zero lag); state that of an amplifier in [delay]."
    if any(applied.lateness for applied in filters.values()):
        return "The simulation has their delay, too."
    return "The inputs are as late as these channels, or the delays were subtracted."


def _describe_filter(applied: ChannelFilter) -> str:
    return applied.words + (f", delay {1e3 * applied.delay:.3g} ms" if applied.has_delay else "")


def detect_filters(
    differences: Mapping[str, Sequence[tuple[Array, Array]]], sampling_rates: Mapping[str, float]
) -> list[Filters]:
    """Return the filters that the noise of channels went through, and after them others that it permits.

    ``differences`` between repeats are pairs of times [s] (n,) and values [SI] (n,); ``sampling_rates`` [Hz] are those
    of the channels. Windows may be trailing ones, or the inputs went through the same, which leaves little of them.
    """
    likely_windows = {channel: find_window(rows, sampling_rates[channel]) for channel, rows in differences.items()}
    windows = {channel: window for channel, window in likely_windows.items() if window is not None}
    others = {channel: rows for channel, rows in differences.items() if channel not in windows}
    low_pass = detect_low_pass_filters(others, sampling_rates)
    if not windows:
        return low_pass
    trailing = {channel: replace(window, is_trailing=True) for channel, window in windows.items()}
    return [{**filters, **variant} for variant in (windows, trailing, {}) for filters in low_pass or [{}]]


def detect_low_pass_filters(
    differences: Mapping[str, Sequence[tuple[Array, Array]]], sampling_rates: Mapping[str, float]
) -> list[Filters]:
    """Return the filters that the noise of channels went through, and after them others that it permits.

    ``differences`` between repeats are pairs of times [s] (n,) and values [SI] (n,); ``sampling_rates`` [Hz] are those
    of the channels. Without clear evidence the first ones have no delay. All channels have the same kind and order, and
    those without a filter are left out; the list is empty without any.
    """
    spectra, likeliest, filtered = {}, {}, []
    for channel, rows in differences.items():
        channel_spectra = [s for s in (compute_spectrum(*difference) for difference in rows) if s is not None]
        shapes = _list_shapes(sampling_rates[channel])
        best = _find_likeliest(channel_spectra, shapes) if channel_spectra else None
        if best is None:
            continue
        spectra[channel], likeliest[channel] = channel_spectra, best
        steep = (
            best
            if _is_steep(best)
            else _find_likeliest(channel_spectra, [shape for shape in shapes if _is_steep(shape)])
        )
        if steep is None or not _has_shape(channel_spectra, steep.cutoff):
            continue
        pass_band_spectra = [_cut_spectrum(s) for s in channel_spectra]
        if (
            _compute_negative_log_likelihood(pass_band_spectra, steep)
            <= _compute_negative_log_likelihood(pass_band_spectra, best) + MAX_SHAPE_LOSS
        ):
            filtered.append(channel)
    if not filtered:
        return []
    candidates = [
        _fit_shape(spectra, likeliest, filtered, shape, sampling_rates)
        for shape in _list_shapes(sampling_rates[filtered[0]])
        if _is_steep(shape)
    ]
    candidates.sort(key=lambda candidate: candidate.negative_log_likelihood)
    zero_lag, delaying = ([c for c in candidates if c.has_delay == has_delay] for has_delay in (False, True))
    permitted = [
        c for c in delaying if c.negative_log_likelihood <= delaying[0].negative_log_likelihood + MAX_SHAPE_LOSS
    ]
    is_late = delaying[0].negative_log_likelihood < zero_lag[0].negative_log_likelihood - MIN_KIND_GAIN
    ordered = [*permitted, zero_lag[0]] if is_late else [zero_lag[0], *permitted]
    return [candidate.filters for candidate in ordered]


def _list_shapes(sampling_rate: float) -> list[LowPassFilter]:
    """Return a filter of each shape that is tried for a channel with ``sampling_rate`` [Hz]; cut-offs do not matter.

    Filters with delay are analog, or digital ones of the channel.
    """
    return [LowPassFilter(1.0, order, sampling_rate) for order in ZERO_LAG_ORDERS] + [
        LowPassFilter(1.0, order, rate, kind)
        for kind, orders in DELAYING_ORDERS.items()
        for order in orders
        for rate in (math.inf, sampling_rate)
    ]


def _is_steep(shape: LowPassFilter) -> bool:
    return shape.stop_band_exponent >= MIN_EXPONENT


def _fit_shape(
    all_spectra: Mapping[str, Sequence[Spectrum]],
    likeliest: Mapping[str, LowPassFilter],
    filtered: Sequence[str],
    shape: LowPassFilter,
    sampling_rates: Mapping[str, float],
) -> _Candidate:
    """Return the filters of this ``shape`` of the channels that were ``filtered``.

    Channels share a cut-off frequency where that is nearly as likely, because the noise of one shows it to a few per
    cent only, and noise that is not white beside it not at all. Other channels, with a ``likeliest`` filter of any
    shape, join where the shared one is nearly as likely.
    """
    spectra = {channel: [_cut_spectrum(s) for s in rows] for channel, rows in all_spectra.items()}
    rates = {channel: math.inf if math.isinf(shape.sampling_rate) else sampling_rates[channel] for channel in spectra}
    filters = {
        channel: _find_likeliest(all_spectra[channel], [replace(shape, sampling_rate=rates[channel])])
        or likeliest[channel]
        for channel in filtered
    }
    start = replace(shape, cutoff=float(np.exp(np.mean([np.log(fitted.cutoff) for fitted in filters.values()]))))
    common = _fit_cutoff([s for channel in filtered for s in spectra[channel]], start)
    losses = {
        channel: _compute_negative_log_likelihood(rows, common)
        - _compute_negative_log_likelihood(rows, filters.get(channel, likeliest[channel]))
        for channel, rows in spectra.items()
    }
    is_shared = all(losses[channel] <= MAX_COMMON_LOSS for channel in filtered)
    for channel, loss in losses.items():
        if loss <= MAX_COMMON_LOSS and (is_shared or channel not in filters):
            filters[channel] = replace(common, sampling_rate=rates[channel])
    total = sum(_compute_negative_log_likelihood(spectra[channel], filters[channel]) for channel in filtered)
    return _Candidate(filters, total, shape.has_delay)


def _find_likeliest(spectra: Sequence[Spectrum], shapes: Sequence[LowPassFilter]) -> LowPassFilter | None:
    """Return the most likely filter of one channel, of one of ``shapes``; None where ``spectra`` show no stop band."""
    nyquist = min(s.frequency[-1] for s in spectra)
    lowest = max(MIN_PASS_BINS * 2.0 * s.frequency[0] for s in spectra)
    if lowest >= nyquist or compute_stop_ratio(spectra, lowest) > MAX_STOP_RATIO:
        return None
    pass_band_spectra = [_cut_spectrum(spectrum) for spectrum in spectra]
    coarse = [
        min(
            (replace(shape, cutoff=float(cutoff)) for cutoff in np.geomspace(lowest, nyquist, N_CUTOFFS)[:-1]),
            key=lambda shape: _compute_negative_log_likelihood(pass_band_spectra, shape),
        )
        for shape in shapes
    ]
    best = min(
        (_fit_cutoff(pass_band_spectra, start) for start in coarse),
        key=lambda shape: _compute_negative_log_likelihood(pass_band_spectra, shape),
    )
    return best if best.cutoff < MAX_CUTOFF_NYQUIST_FRACTION * nyquist else None


def _fit_cutoff(spectra: Sequence[Spectrum], start: LowPassFilter) -> LowPassFilter:
    """Return the most likely filter of the shape and near the cut-off frequency of ``start``."""
    tried = [replace(start, cutoff=start.cutoff * float(factor)) for factor in CUTOFF_FACTORS]
    return min(tried, key=lambda each: _compute_negative_log_likelihood(spectra, each))


def _cut_spectrum(spectrum: Spectrum) -> Spectrum:
    """Return ``spectrum`` up to where its power falls below :data:`MIN_POWER_FRACTION`."""
    n_lowest = int(np.searchsorted(np.cumsum(spectrum.n_averaged), MIN_PASS_BINS)) + 1
    lowest = float(np.average(spectrum.power[:n_lowest], weights=spectrum.n_averaged[:n_lowest]))
    below = np.flatnonzero(spectrum.power < MIN_POWER_FRACTION * lowest)
    end = max(n_lowest, int(below[0])) if len(below) else len(spectrum.power)
    return Spectrum(*(values[:end] for values in spectrum))


def _compute_negative_log_likelihood(spectra: Sequence[Spectrum], tried: LowPassFilter) -> float:
    """Return the negative logarithm of the likelihood of noise through the filter."""
    return compute_negative_log_likelihood(
        spectra, lambda f: tried.compute_gain(f) ** 2, tried.cutoff * np.array(POLE_FACTORS)
    )


def _has_shape(spectra: Sequence[Spectrum], cutoff: float) -> bool:
    """Return whether the noise is white in the pass band of a filter with this ``cutoff`` [Hz], and gone far above."""
    lower, upper = (
        np.mean([average_power(s, low * cutoff, high * cutoff) / average_power(s, 0.0, 0.5 * cutoff) for s in spectra])
        for low, high in ((0.0, 0.25), (0.25, 0.5))
    )
    is_white = 1.0 / MAX_PASS_RATIO < lower / upper < MAX_PASS_RATIO
    return bool(is_white and compute_stop_ratio(spectra, 0.5 * cutoff) < MAX_STOP_RATIO)
