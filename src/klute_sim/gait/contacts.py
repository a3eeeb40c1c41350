"""Heel strikes and toe-offs from the vertical ground reaction."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD
from klute_sim.recording.recording import Array

MIN_CONTACT_TIME = 0.15
"""Shorter ones [s] are noise or a knock."""
MIN_GAP_TIME = 0.08
"""Shorter losses of contact [s] are noise."""


@dataclass(frozen=True)
class Contact:
    """One foot's time on the ground [s]."""

    foot_strike: float
    """Heel strike, where ``begun``; otherwise the first sample."""
    toe_off: float
    has_foot_strike: bool
    """Whether the heel strike was seen; otherwise the foot was down when the record began."""
    has_toe_off: bool
    """Whether the toe-off was seen."""


def estimate_force_offset(vertical_force: Array) -> float:
    """What a plate reads with nobody on it [N]: the median of what is below a twentieth of the largest load."""
    free = vertical_force[vertical_force < 0.05 * np.nanmax(vertical_force)]
    return float(np.median(free)) if len(free) > 0.05 * len(vertical_force) else 0.0


def find_contacts(time: Array, vertical_force: Array, threshold: float = CONTACT_FORCE_THRESHOLD) -> list[Contact]:
    """Contacts in ``vertical`` [N] at ``time`` [s]; events are where straight lines between samples cross."""
    loaded = np.nan_to_num(vertical_force) > threshold
    edges = np.flatnonzero(np.diff(loaded.astype(int))) + 1
    bounds = [0, *edges.tolist(), len(loaded)]
    spans = [(a, b) for a, b in pairwise(bounds) if loaded[a]]
    joined: list[tuple[int, int]] = []
    for a, b in spans:
        if joined and time[a] - time[joined[-1][1]] < MIN_GAP_TIME:
            joined[-1] = (joined[-1][0], b)
        else:
            joined.append((a, b))
    found = []
    for a, b in joined:
        strike = _interpolate_crossing(time, vertical_force, a, threshold) if a > 0 else float(time[0])
        lift = _interpolate_crossing(time, vertical_force, b, threshold) if b < len(time) else float(time[-1])
        if lift - strike >= MIN_CONTACT_TIME:
            found.append(Contact(strike, lift, a > 0, b < len(time)))
    return found


def _interpolate_crossing(time: Array, values: Array, index: int, threshold: float) -> float:
    """When the line from the sample before to that at ``after`` passes ``threshold``."""
    low, high = float(values[index - 1]), float(values[index])
    share = (threshold - low) / (high - low) if np.isfinite(low) and high != low else 1.0
    return float(time[index - 1] + share * (time[index] - time[index - 1]))
