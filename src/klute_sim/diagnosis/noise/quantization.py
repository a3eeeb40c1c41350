"""Quantization of channels: detection of a display's resolution in the data, and its model.

Data on a grid show that without any simulation. Noise before the quantizer makes it switch between neighbouring
values, so its mean output is a staircase with rounded corners; simulated values are mapped to that mean. The residuals
of repeats are then noise again, although all repeats share the same quantization error.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats, list_channels
from klute_sim.types import Array

GRID_TOLERANCE = 0.02
"""Largest distance of samples from the grid, as a fraction of the resolution: files have finite digits."""
MIN_RESOLUTION_TO_NOISE = 1.0
"""Resolution over the standard deviation of the noise, above which quantization matters (assumed)."""
MIN_SAMPLES = 200
"""Fewest samples for the detection of a grid (assumed)."""
HARMONICS = np.arange(1, 9)
"""Harmonics of the quantization error in the model."""
MAX_DITHER, MIN_DITHER = 1.0, 0.05
"""Limits of the dither: above, no quantization error is left in the mean; below, corners are sharper than matters."""


class Quantizer(NamedTuple):
    """Quantizer of one channel."""

    resolution: float
    """Step between neighbouring readings [SI]."""
    resolution_error: float
    """Largest error of the resolution, due to the digits in the file [SI]."""
    offset: float
    """Any one of the possible readings [SI]."""
    dither: float
    """Standard deviation of the noise before the quantizer, over the resolution."""

    def quantize(self, value: Array) -> Array:
        """Return the mean reading for ``value`` [SI].

        Rounding adds a sawtooth, ``(s/pi) sum (-1)^k/k sin(2 pi k y/s)``; Gaussian noise before it multiplies each
        term by ``exp(-2 pi^2 k^2 d^2)`` (Widrow & Kollar 2008, ch. 4).
        """
        phase = 2.0 * np.pi * (value - self.offset) / self.resolution
        reading = value.copy()
        for k in HARMONICS:
            amplitude = (-1.0) ** k / (np.pi * k) * np.exp(-2.0 * (np.pi * k * self.dither) ** 2)
            reading += self.resolution * amplitude * np.sin(k * phase)
        return reading


def detect_quantizers(
    experiments: Sequence[Experiment], fit_experiments: Sequence[Experiment], simulator: Simulator
) -> tuple[list[Experiment], dict[str, Quantizer]]:
    """Return ``experiments`` with the quantizers detected in ``fit_experiments``, and the quantizer of each channel.

    Channels without repeats get none. Samples at a limit of their sensor show nothing of the grid and count nowhere.
    """
    unlimited = [_drop_limited_samples(e) for e in fit_experiments]
    values = [{channel: series.value for channel, series in e.measured.items()} for e in unlimited]
    grids = {}
    for channel in list_channels(unlimited):
        grid = _find_grid(np.concatenate([row[channel] for row in values if channel in row]))
        if grid is not None and channel in CHANNEL_UNITS:
            grids[channel] = grid
    noise = _estimate_noise(unlimited, values, simulator) if grids else {}
    quantizers = {
        channel: Quantizer(*grid, _solve_dither(noise[channel] / grid.resolution))
        for channel, grid in grids.items()
        if channel in noise and grid.resolution > MIN_RESOLUTION_TO_NOISE * noise[channel]
    }
    with_quantizers = [
        replace(e, quantizers={channel: quantizers[channel] for channel in e.measured if channel in quantizers})
        for e in experiments
    ]
    return with_quantizers, quantizers


def _estimate_noise(
    experiments: Sequence[Experiment], values: Sequence[Mapping[str, Array]], simulator: Simulator
) -> dict[str, float]:
    """Return channel -> standard deviation [SI] of the noise before the quantizer, of repeated channels.

    It is the smaller one of two estimates: differences of ``values`` contain the differences of the inputs of repeats
    that start a few samples apart, and those of the residuals of the nominal device the noise of the recorded inputs.
    """
    residuals = simulator.compute_nominal_residuals(experiments)
    raw, modelled = (estimate_noise_from_repeats(experiments, rows) for rows in (values, residuals))
    return {channel: min(raw[channel].std, modelled[channel].std) for channel in raw}


def _drop_limited_samples(experiment: Experiment) -> Experiment:
    """Return ``experiment`` without samples at the limits of a sensor: they were moved there, off the grid."""
    measured = dict(experiment.measured)
    for channel in measured.keys() & experiment.limits.keys():
        (time, value), (low, high) = measured[channel], experiment.limits[channel]
        is_inside = (value > low) & (value < high)
        measured[channel] = TimeSeries(time[is_inside], value[is_inside])
    return replace(experiment, measured=measured, limits={})


class _Grid(NamedTuple):
    resolution: float
    resolution_error: float
    offset: float


def _find_grid(values: Array) -> _Grid | None:
    """Return the grid that all ``values`` lie on, or None."""
    readings = np.unique(values)
    if len(values) < MIN_SAMPLES or not 2 < len(readings) < 0.5 * len(values):
        return None
    gaps = np.diff(readings)
    resolution = float(np.median(gaps[gaps < 1.5 * gaps[gaps > 0.3 * np.median(gaps)].min()]))
    for _ in range(3):  # at first, the number of steps is exact for small distances only
        count = np.round((readings - readings[0]) / resolution)
        resolution, offset = (float(x) for x in np.polyfit(count, readings, 1))
    distance = np.abs(readings - offset - resolution * count).max()
    if not distance < GRID_TOLERANCE * resolution:
        return None
    return _Grid(resolution, GRID_TOLERANCE * resolution / float(count[-1]), offset)


def _solve_dither(noise_ratio: float) -> float:
    """Return the dither for which repeats deviate by ``noise_ratio`` after the quantizer, both over the resolution.

    The variance between repeats is that of the noise plus the quantization error, ``1/12``, minus that of the error
    common to all repeats, half the sum of the squared amplitudes of :meth:`Quantizer.quantize` (Widrow & Kollar 2008,
    ch. 4).
    """

    def excess_variance(dither: float) -> float:
        common = np.exp(-((2.0 * np.pi * HARMONICS * dither) ** 2)) / (2.0 * (np.pi * HARMONICS) ** 2)
        return float(dither**2 + 1.0 / 12.0 - common.sum() - noise_ratio**2)

    if excess_variance(MIN_DITHER) >= 0.0:
        return MIN_DITHER
    if excess_variance(MAX_DITHER) <= 0.0:
        return MAX_DITHER
    return float(brentq(excess_variance, MIN_DITHER, MAX_DITHER))
