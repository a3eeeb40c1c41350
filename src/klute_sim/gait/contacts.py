"""Heel strikes and toe-offs from the vertical ground reaction."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD
from klute_sim.datasets.foot_load import estimate_force_offset, find_loaded_samples
from klute_sim.types import Array

MIN_CONTACT_TIME = 0.15
"""Minimum duration of a contact [s]; a shorter one is noise or an impact."""
MIN_GAP_TIME = 0.08
"""Minimum duration of a gap between two contacts [s]; a shorter one is noise."""


@dataclass(frozen=True)
class Contact:
    """Contact of one foot with the ground."""

    foot_strike: float
    """Time of heel strike, or of the first sample without ``has_foot_strike`` [s]."""
    toe_off: float
    """Time of toe-off, or of the last sample without ``has_toe_off`` [s]."""
    has_foot_strike: bool
    """Whether the heel strike is in the recording; otherwise the foot was on the ground at its start."""
    has_toe_off: bool
    """Whether the toe-off is in the recording."""


def find_contacts(time: Array, vertical_force: Array, threshold: float = CONTACT_FORCE_THRESHOLD) -> list[Contact]:
    """Return the contacts in ``vertical_force`` [N] at ``time`` [s].

    Events are the times at which straight lines between samples cross ``threshold`` [N]. Noise of an unloaded plate
    that exceeds it is no contact, and missing samples are interpolated.
    """
    known = np.isfinite(vertical_force)
    if not known.any():
        return []
    vertical_force = np.interp(time, time[known], vertical_force[known] - estimate_force_offset(vertical_force))
    loaded = find_loaded_samples(vertical_force, threshold)
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
        foot_strike = _interpolate_crossing(time, vertical_force, a, threshold) if a > 0 else float(time[0])
        toe_off = _interpolate_crossing(time, vertical_force, b, threshold) if b < len(time) else float(time[-1])
        if toe_off - foot_strike >= MIN_CONTACT_TIME:
            contacts.append(Contact(foot_strike, toe_off, a > 0, b < len(time)))
    return contacts


def _interpolate_crossing(time: Array, values: Array, index: int, threshold: float) -> float:
    """Return the time at which the line from sample ``index - 1`` to sample ``index`` crosses ``threshold``."""
    low, high = float(values[index - 1]), float(values[index])
    fraction = (threshold - low) / (high - low)
    return float(time[index - 1] + fraction * (time[index] - time[index - 1]))
