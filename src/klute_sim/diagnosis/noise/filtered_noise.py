"""Low-pass filters of channels, detected from the spectrum of their noise.

A filter rounds what is fast in a signal, as the jump of a dry friction, in all repeats alike, so a simulation must go
through the same filter. The noise shows it: it was white before, and its spectrum has the shape of the filter. Repeats
are compared by their residuals, so that inputs that differ count as little as in any estimate of the noise.
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
"""Smallest order of a filter: devices and instruments make noise with a spectrum of the first."""
N_CUTOFFS = 60
"""Number of cut-off frequencies that are tried."""
N_FINER_CUTOFFS = 41
"""Number of cut-off frequencies that are tried between the neighbors of the best one."""
MAX_LIKELIHOOD_FALL = 4.0
"""Largest fall of the logarithm of the likelihood of an admitted cut-off frequency: within 2.8 standard errors."""
N_ADMITTED = 9
"""Number of admitted cut-off frequencies."""
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


class _Spectrum(NamedTuple):
    frequency: Array
    """Frequencies above 0 [Hz], (n,)."""
    power: Array
    """Power density [SI^2/Hz], (n,)."""


def add_low_pass_filters(
    experiments: Sequence[Experiment],
    fit_experiments: Sequence[Experiment],
    sampling_rates: Mapping[str, float],
    simulator: Simulator,
) -> tuple[list[Experiment], dict[str, LowPassFilter]]:
    """Return ``experiments`` with the filters detected in ``fit_experiments``, and the filter of each such channel.

    ``sampling_rates`` [Hz] are those of the measured channels before samples were left out. Of the filters that the
    noise admits, the nominal device agrees best with the one that is chosen. Samples near the ends of a filtered record
    are left out. Channels without repeats get no filter.
    """
    values = [{channel: series.value for channel, series in e.measured.items()} for e in fit_experiments]
    residuals = _compute_residuals(fit_experiments, simulator)
    admitted = {}
    for channel in list_channels(fit_experiments):
        differences = [_compare_repeats(fit_experiments, rows, channel) for rows in (values, residuals)]
        # Residuals contain the noise of the recorded inputs, and values what differs between the inputs.
        smaller = min(differences, key=lambda rows: float(np.sum([difference @ difference for _, difference in rows])))
        found = find_admitted_filters(smaller, sampling_rates[channel])
        if found:
            admitted[channel] = found
    if not admitted:
        return list(experiments), {}
    squares: dict[str, list[float]] = {channel: [] for channel in admitted}
    for index in range(N_ADMITTED):
        tried = {channel: filters[index] for channel, filters in admitted.items()}
        rows = _compute_residuals([_add_filters(e, tried) for e in fit_experiments], simulator)
        for channel in admitted:
            squares[channel].append(float(np.sum([row[channel] @ row[channel] for row in rows if channel in row])))
    filters = {channel: found[int(np.argmin(squares[channel]))] for channel, found in admitted.items()}
    return [_add_filters(e, filters) for e in experiments], filters


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


def describe_low_pass_filters(filters: Mapping[str, LowPassFilter]) -> list[str]:
    """Return a sentence about the ``filters`` of the channels; none without any."""
    if not filters:
        return []
    names = ", ".join(f"'{channel}' ({found.cutoff:.2g} Hz)" for channel, found in filters.items())
    return [
        f"The noise shows that these channels were low-pass filtered, so the simulation is filtered alike: {names}. "
        "It is taken to have no delay (zero lag); the delay of an amplifier has a name of its own."
    ]


def _compute_spectrum(time: Array, difference: Array) -> _Spectrum | None:
    """Return the spectrum of the ``difference`` of two repeats (n,) at ``time`` [s] (n,); None where it shows none."""
    steps = np.diff(time)
    if len(steps) < 4 * N_STOP_BINS or np.ptp(steps) > MAX_INTERVAL_VARIATION * steps.mean() or not difference.any():
        return None
    rate = 1.0 / float(steps.mean())
    frequency, power = periodogram(detrend(difference), rate, window="hann", detrend=False)
    min_power = MIN_FLOOR_FRACTION * float(power[2 : 2 + MIN_PASS_BINS].mean())
    return _Spectrum(frequency[2:-1], np.maximum(power[2:-1], min_power))


def find_admitted_filters(differences: Sequence[tuple[Array, Array]], sampling_rate: float) -> list[LowPassFilter]:
    """Return :data:`N_ADMITTED` filters that the ``differences`` of repeats admit; none where they do not show any.

    A difference is a pair of times [s] (n,) and values [SI] (n,); ``sampling_rate`` [Hz] is that of the filter.
    """
    spectra = [s for s in (_compute_spectrum(*difference) for difference in differences) if s is not None]
    if not spectra:
        return []
    nyquist = min(s.frequency[-1] for s in spectra)
    lowest = max(MIN_PASS_BINS * 2.0 * s.frequency[0] for s in spectra)
    cutoffs = np.geomspace(lowest, nyquist, N_CUTOFFS)[:-1] if lowest < nyquist else np.empty(0)
    filters = [LowPassFilter(float(cutoff), order, sampling_rate) for order in ORDERS for cutoff in cutoffs]
    if not filters:
        return []
    coarse = min(filters, key=lambda tried: _compute_misfit(spectra, tried))
    ratio = float(cutoffs[1] / cutoffs[0])
    finer = [replace(coarse, cutoff=coarse.cutoff * x) for x in np.geomspace(1.0 / ratio, ratio, N_FINER_CUTOFFS)]
    misfits = np.array([_compute_misfit(spectra, tried) for tried in finer])
    best = finer[int(np.argmin(misfits))]
    if best.order < MIN_ORDER or best.cutoff >= MAX_CUTOFF_NYQUIST_FRACTION * nyquist:
        return []
    if not _has_shape(spectra, best.cutoff):
        return []
    is_admitted = misfits <= misfits.min() + MAX_LIKELIHOOD_FALL
    low, high = (finer[int(index)].cutoff for index in np.flatnonzero(is_admitted)[[0, -1]])
    return [replace(best, cutoff=float(cutoff)) for cutoff in np.geomspace(low, high, N_ADMITTED)]


def _compute_misfit(spectra: Sequence[_Spectrum], tried: LowPassFilter) -> float:
    """Return the negative logarithm of the likelihood (Whittle, 1953) of white noise through the filter, and a floor.

    The power of the noise is the best one of each spectrum.
    """
    total = 0.0
    for frequency, power in spectra:
        shape = tried.compute_gain(frequency)[None, :] ** 2 + FLOOR_FRACTIONS[:, None]
        level = (power / shape).mean(axis=1)
        total += float(np.min(len(power) * np.log(level) + np.log(shape).sum(axis=1)))
    return total


def _has_shape(spectra: Sequence[_Spectrum], cutoff: float) -> bool:
    """Return whether the noise is white in the pass band of a filter with this ``cutoff`` [Hz], and gone far above."""
    powers = []
    for frequency, power in spectra:
        passed = power[frequency < 0.5 * cutoff]
        stopped = power[-max(N_STOP_BINS, len(power) // 10) :]
        bands = (*np.array_split(passed, 2), stopped)
        powers.append([float(band.mean()) / float(passed.mean()) for band in bands])
    lower, upper, stopped_power = np.mean(powers, axis=0)
    return bool(1.0 / MAX_PASS_RATIO < lower / upper < MAX_PASS_RATIO and stopped_power < 1.0 / MIN_STOP_RATIO)
