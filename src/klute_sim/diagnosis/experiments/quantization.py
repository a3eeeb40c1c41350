"""Channels that show whole steps only: read off the data's own grid, and looked at as such.

No simulation is needed to see that every sample is a whole number of steps. Noise before the display makes the next
step be shown now and then, so on average a display shows a staircase with its corners rounded: that is what simulated
values are turned into. What is left of repeats then is noise again, although each shows the same wrong steps.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Array, Experiment
from klute_sim.diagnosis.noise import repeats as noises

GRID_TOLERANCE = 0.02
"""Of a step, by which samples may be beside the grid: figures are written with so many digits."""
MIN_RESOLUTION_TO_NOISE = 1.0
"""Steps per standard deviation of the noise from which a display is worth a word; finer ones are lost in it."""
MIN_SAMPLES = 200
"""Samples that it takes to tell."""
N_HARMONICS = 8
MAX_DITHER, MIN_DITHER = 1.0, 0.05
"""Noise before a display, over its step, between which it is looked for: no rounding is left to see at the one, and
more corners than matter at the other."""


class Quantizer(NamedTuple):
    """Of one channel [SI]."""

    resolution: float
    resolution_error: float
    """Of the step, at most: as far as figures tell."""
    offset: float
    """A value that is shown."""
    dither: float
    """Standard deviation of the noise before it, over the step."""

    def quantize(self, value: Array) -> Array:
        """What is shown on average for ``value``.

        Rounding adds a sawtooth, ``(s/pi) sum (-1)^k/k sin(2 pi k y/s)``; Gaussian noise before it takes
        ``exp(-2 pi^2 k^2 d^2)`` off each of its terms (Widrow & Kollar 2008, ch. 4).
        """
        place = 2.0 * np.pi * (value - self.offset) / self.resolution
        found = value.copy()
        for k in range(1, N_HARMONICS + 1):
            size = (-1.0) ** k / (np.pi * k) * np.exp(-2.0 * (np.pi * k * self.dither) ** 2)
            found += self.resolution * size * np.sin(k * place)
        return found


def detect_quantizers(
    experiments: Sequence[Experiment], fit_experiments: Sequence[Experiment]
) -> tuple[list[Experiment], dict[str, Quantizer]]:
    """``experiments`` with the displays that the samples of the ``fitted`` ones show, and these by channel.

    There are none where nothing was repeated.
    """
    values = [{c: series.value for c, series in e.measured.items()} for e in fit_experiments]
    found = {}
    for channel, noise in noises.estimate_noise_from_repeats(fit_experiments, values).items():
        if channel in CHANNEL_UNITS:
            grid = _find_grid(np.concatenate([each[channel] for each in values if channel in each]))
            if grid is not None and grid.resolution > MIN_RESOLUTION_TO_NOISE * noise.std:
                found[channel] = Quantizer(*grid, _solve_dither(noise.std / grid.resolution))
    return [replace(e, quantizers={c: found[c] for c in e.measured if c in found}) for e in experiments], found


class _Grid(NamedTuple):
    resolution: float
    resolution_error: float
    offset: float


def _find_grid(values: Array) -> _Grid | None:
    """The grid that all of ``values`` are on, if they are on one."""
    shown = np.unique(values)
    if len(values) < MIN_SAMPLES or not 2 < len(shown) < 0.5 * len(values):
        return None
    gaps = np.diff(shown)
    step = float(np.median(gaps[gaps < 1.5 * gaps[gaps > 0.3 * np.median(gaps)].min()]))
    for _ in range(3):  # ever more exactly: the count of steps is known at first for near ones only
        count = np.round((shown - shown[0]) / step)
        step, zero = (float(x) for x in np.polyfit(count, shown, 1))
    beside = np.abs(shown - zero - step * count).max()
    return _Grid(step, GRID_TOLERANCE * step / float(count[-1]), zero) if beside < GRID_TOLERANCE * step else None


def _solve_dither(noise_ratio: float) -> float:
    """Noise before a display from the ``deviation`` of repeats after it, both over the step.

    What repeats show is noise, and rounding less the part of it that is the same in all.
    """

    def excess(dither: float) -> float:
        same = sum(np.exp(-((2.0 * np.pi * k * dither) ** 2)) / (2.0 * (np.pi * k) ** 2) for k in range(1, 9))
        return float(dither**2 + 1.0 / 12.0 - same - noise_ratio**2)

    if excess(MIN_DITHER) >= 0.0:
        return MIN_DITHER
    return MAX_DITHER if excess(MAX_DITHER) <= 0.0 else float(brentq(excess, MIN_DITHER, MAX_DITHER))
