"""Steps of one foot in a recording, in any units: contacts from the vertical force, and mean curves over the cycle."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.samples import compute_negative_share
from klute_sim.types import Array

LOADED_FRACTION = 0.1
"""Fraction of the peak vertical force above which the foot counts as loaded."""
MIN_CONTACT_FRACTION, MIN_SWING_FRACTION = 0.3, 0.15
"""Shortest contact and shortest swing that count, relative to a long contact."""
TOE_OFF_PCT = 62
"""Phase of toe-off in mean curves [%]: stance and swing are stretched to the typical ones."""
LOADED_STANCE_PCT = slice(4, 58)
"""Phases of mean curves [%] in which the plate knows the centre of pressure well (assumed)."""
MIN_KNOWN_PHASES = 20
"""Fewest of these phases with values for a comparison of two mean curves (assumed)."""
MAX_SWING_TO_STANCE = 2.2
"""Largest ratio of swing to stance; a longer swing is a step on no plate (sprinting has 2)."""
TYPICAL_SWING_TO_STANCE = 0.6
"""Ratio of swing to stance where no second heel strike is known."""


class Series(NamedTuple):
    """Samples of one channel and their times."""

    time: Array
    """Times, increasing."""
    value: Array
    """Samples; may hold NaN."""


class Step(NamedTuple):
    """One contact of the foot."""

    strike: float
    """Time of foot strike."""
    toe_off: float
    """Time of toe-off."""
    next_strike: float
    """Time of the next foot strike; after a typical swing where none is known."""
    is_complete: bool
    """Whether the next foot strike is known."""


def find_steps(vertical: Series) -> list[Step]:
    """Return the complete contacts in the ``vertical`` force, of either sign."""
    sign = -1.0 if compute_negative_share(vertical.value) > 0.6 else 1.0
    time, force = vertical.time, sign * np.nan_to_num(vertical.value)
    peak = float(np.percentile(force, 97.0)) if force.size else 0.0
    if peak <= 0.0:
        return []
    force = force - min(float(np.percentile(force, 2.0)), 0.3 * peak)
    loaded = force > LOADED_FRACTION * float(np.percentile(force, 97.0))
    edges = np.flatnonzero(np.diff(loaded.astype(np.int8)))
    bounds = [(int(a) + 1, int(b) + 1) for a, b in pairwise(edges)]
    contacts = [(float(time[a]), float(time[b])) for a, b in bounds if loaded[a]]
    if not contacts:
        return []
    long_contact = float(np.percentile([end - start for start, end in contacts], 75.0))
    merged: list[tuple[float, float]] = []
    for start, end in contacts:
        if merged and start - merged[-1][1] < MIN_SWING_FRACTION * long_contact:
            merged[-1] = (merged[-1][0], end)
        else:
            merged.append((start, end))
    merged = [(a, b) for a, b in merged if b - a > MIN_CONTACT_FRACTION * long_contact]
    steps = []
    for number, (start, end) in enumerate(merged):
        following = merged[number + 1][0] if number + 1 < len(merged) else np.inf
        is_complete = following - end < MAX_SWING_TO_STANCE * (end - start)
        next_strike = following if is_complete else end + TYPICAL_SWING_TO_STANCE * (end - start)
        steps.append(Step(start, end, float(next_strike), is_complete))
    complete = [step for step in steps if step.is_complete]
    return complete or steps


def measure_stride_time(steps: list[Step]) -> float:
    """Return the median time from strike to strike."""
    return float(np.median([step.next_strike - step.strike for step in steps]))


def average_cycle(series: Series, steps: list[Step], *, relative: bool = False) -> Array:
    """Return the mean curve at 0 to 99 % over ``steps``; NaN where it is unknown.

    ``relative`` curves are relative to their own value in the middle of stance.
    """
    known = np.isfinite(series.value)
    phase = np.arange(100.0)
    if known.sum() < 2:
        return np.full(100, np.nan)
    curves = []
    for step in steps:
        times = np.interp(phase, [0.0, TOE_OFF_PCT, 100.0], [step.strike, step.toe_off, step.next_strike])
        curve = np.interp(times, series.time[known], series.value[known], left=np.nan, right=np.nan)
        curves.append(curve - curve[TOE_OFF_PCT // 2] if relative else curve)
    count = np.isfinite(curves).sum(axis=0)
    return np.asarray(np.divide(np.nansum(curves, axis=0), count, out=np.full(100, np.nan), where=count > 0))
