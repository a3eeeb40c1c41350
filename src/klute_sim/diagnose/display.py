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

from klute_sim.diagnose import noise as noises
from klute_sim.diagnose.experiment import UNITS, Array, Experiment

EXACT = 0.02
"""Of a step, by which samples may be beside the grid: figures are written with so many digits."""
COARSE = 1.0
"""Steps per standard deviation of the noise from which a display is worth a word; finer ones are lost in it."""
FEWEST = 200
"""Samples that it takes to tell."""
HARMONICS = 8
SMOOTHEST, SHARPEST = 1.0, 0.05
"""Noise before a display, over its step, between which it is looked for: no rounding is left to see at the one, and
more corners than matter at the other."""


class Display(NamedTuple):
    """Of one channel [SI]."""

    step: float
    error: float
    """Of the step, at most: as far as figures tell."""
    zero: float
    """A value that is shown."""
    dither: float
    """Standard deviation of the noise before it, over the step."""

    def shows(self, value: Array) -> Array:
        """What is shown on average for ``value``.

        Rounding adds a sawtooth, ``(s/pi) sum (-1)^k/k sin(2 pi k y/s)``; Gaussian noise before it takes
        ``exp(-2 pi^2 k^2 d^2)`` off each of its terms (Widrow & Kollar 2008, ch. 4).
        """
        place = 2.0 * np.pi * (value - self.zero) / self.step
        found = value.copy()
        for k in range(1, HARMONICS + 1):
            size = (-1.0) ** k / (np.pi * k) * np.exp(-2.0 * (np.pi * k * self.dither) ** 2)
            found += self.step * size * np.sin(k * place)
        return found


def displayed(
    experiments: Sequence[Experiment], fitted: Sequence[Experiment]
) -> tuple[list[Experiment], dict[str, Display]]:
    """``experiments`` with the displays that the samples of the ``fitted`` ones show, and these by channel.

    There are none where nothing was repeated.
    """
    values = [{c: series.value for c, series in e.measured.items()} for e in fitted]
    found = {}
    for channel, noise in noises.measure(fitted, values).items():
        if channel in UNITS:
            grid = _grid(np.concatenate([each[channel] for each in values if channel in each]))
            if grid is not None and grid.step > COARSE * noise.deviation:
                found[channel] = Display(*grid, _dither(noise.deviation / grid.step))
    return [replace(e, displays={c: found[c] for c in e.measured if c in found}) for e in experiments], found


class _Grid(NamedTuple):
    step: float
    error: float
    zero: float


def _grid(values: Array) -> _Grid | None:
    """The grid that all of ``values`` are on, if they are on one."""
    shown = np.unique(values)
    if len(values) < FEWEST or not 2 < len(shown) < 0.5 * len(values):
        return None
    gaps = np.diff(shown)
    step = float(np.median(gaps[gaps < 1.5 * gaps[gaps > 0.3 * np.median(gaps)].min()]))
    for _ in range(3):  # ever more exactly: the count of steps is known at first for near ones only
        count = np.round((shown - shown[0]) / step)
        step, zero = (float(x) for x in np.polyfit(count, shown, 1))
    beside = np.abs(shown - zero - step * count).max()
    return _Grid(step, EXACT * step / float(count[-1]), zero) if beside < EXACT * step else None


def _dither(deviation: float) -> float:
    """Noise before a display from the ``deviation`` of repeats after it, both over the step.

    What repeats show is noise, and rounding less the part of it that is the same in all.
    """

    def excess(dither: float) -> float:
        same = sum(np.exp(-((2.0 * np.pi * k * dither) ** 2)) / (2.0 * (np.pi * k) ** 2) for k in range(1, 9))
        return float(dither**2 + 1.0 / 12.0 - same - deviation**2)

    if excess(SHARPEST) >= 0.0:
        return SHARPEST
    return SMOOTHEST if excess(SMOOTHEST) <= 0.0 else float(brentq(excess, SHARPEST, SMOOTHEST))
