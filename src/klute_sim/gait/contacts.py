"""Heel strikes and toe-offs from the vertical ground reaction."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD
from klute_sim.datasets.foot_load import estimate_force_offset, find_loaded_samples
from klute_sim.mask_runs import find_runs
from klute_sim.types import Array

MIN_CONTACT_TIME = 0.15
"""Minimum duration of a contact [s]; a shorter one is noise or an impact."""
MIN_GAP_TIME = 0.08
"""Minimum duration of a gap between two contacts [s]; a shorter one is noise."""
MAX_SWING_TIME = 0.8
"""Longest swing [s] between two contacts; a longer time without load is a step on no plate (assumed; a swing takes
about 0.4 s)."""

MIN_MISSING_SWING_TIME = 0.2
"""Minimum duration [s] of missing samples that are a swing (assumed)."""
MAX_SWING_EDGE_FRACTION = 0.3
"""Largest force next to the missing samples of a swing, as a fraction of the peak (assumed: at toe-off and heel strike
it changes by so much within a few samples)."""
MAX_EVENT_GAP_TIME = 0.03
"""Longest gap [s] in which a heel strike or toe-off is interpolated (assumed: its time is then known to 15 ms)."""


@dataclass(frozen=True)
class Contact:
    """Contact of one foot with the ground."""

    foot_strike: float
    """Time of heel strike, or of the first loaded sample without ``has_foot_strike`` [s]."""
    toe_off: float
    """Time of toe-off, or of the last loaded sample without ``has_toe_off`` [s]."""
    has_foot_strike: bool
    """Whether the heel strike is in the recording; otherwise the foot was on the ground at its start or after a gap."""
    has_toe_off: bool
    """Whether the toe-off is in the recording; otherwise the foot was on the ground at its end or before a gap."""


def fill_swings(time: Array, vertical_force: Array) -> Array:
    """Return ``vertical_force`` (n,) at ``time`` [s] with zeros in long gaps between small forces, and at the ends.

    Some programs leave out the samples of an unloaded plate.
    """
    missing = np.isnan(vertical_force)
    result = vertical_force.copy()
    for start, stop in find_runs(missing):
        neighbours = [k for k in (start - 1, stop) if 0 <= k < len(time)]
        is_long = len(neighbours) == 1 or (
            len(neighbours) == 2 and time[stop] - time[start - 1] >= MIN_MISSING_SWING_TIME
        )
        if is_long and max(vertical_force[neighbours]) < MAX_SWING_EDGE_FRACTION * np.nanmax(vertical_force):
            result[start:stop] = 0.0
    return result


def find_contacts(time: Array, vertical_force: Array, threshold: float = CONTACT_FORCE_THRESHOLD) -> list[Contact]:
    """Return the contacts in ``vertical_force`` [N] at ``time`` [s].

    Events are the times at which straight lines between samples cross ``threshold`` [N]. Noise of an unloaded plate
    that exceeds it is no contact. Missing samples are interpolated, but have no event except in a short gap.
    """
    force = fill_swings(time, vertical_force - estimate_force_offset(vertical_force))
    known = np.flatnonzero(np.isfinite(force))
    if not len(known):
        return []
    force = np.interp(time, time[known], force[known])
    loaded = find_loaded_samples(force, threshold)
    edges = np.flatnonzero(np.diff(loaded.astype(int))) + 1
    bounds = [0, *edges.tolist(), len(loaded)]
    spans = [(a, b) for a, b in pairwise(bounds) if loaded[a]]
    joined: list[tuple[int, int]] = []
    for a, b in spans:
        if joined and time[a] - time[joined[-1][1]] < MIN_GAP_TIME:
            joined[-1] = (joined[-1][0], b)
        else:
            joined.append((a, b))
    contacts = []
    for a, b in joined:
        before, after = np.searchsorted(known, [a, b])
        has_foot_strike, has_toe_off = (_has_event(time, known, k) for k in (before, after))
        foot_strike, toe_off = float(time[known[before]]), float(time[known[after - 1]])
        if has_foot_strike:
            foot_strike = _interpolate_crossing(time, force, a, threshold)
        if has_toe_off:
            toe_off = _interpolate_crossing(time, force, b, threshold)
        if toe_off - foot_strike >= MIN_CONTACT_TIME:
            contacts.append(Contact(foot_strike, toe_off, has_foot_strike, has_toe_off))
    return contacts


def _has_event(time: Array, known: NDArray[np.intp], position: int) -> bool:
    """Return whether an event just before the known sample at ``position`` of ``known`` has a time.

    It has none at an end of the recording and in a gap longer than :data:`MAX_EVENT_GAP_TIME`.
    """
    if not 0 < position < len(known):
        return False
    first, last = known[position - 1], known[position]
    return bool(last - first == 1 or time[last] - time[first] <= MAX_EVENT_GAP_TIME)


def _interpolate_crossing(time: Array, values: Array, index: int, threshold: float) -> float:
    """Return the time at which the line from sample ``index - 1`` to sample ``index`` crosses ``threshold``."""
    low, high = float(values[index - 1]), float(values[index])
    fraction = (threshold - low) / (high - low)
    return float(time[index - 1] + fraction * (time[index] - time[index - 1]))
