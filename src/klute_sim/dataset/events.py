"""Heel strikes and toe-offs from the vertical ground reaction."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from klute_sim.dataset.channels import LOADED
from klute_sim.recording.recording import Samples

SHORTEST_CONTACT = 0.15
"""Shorter ones [s] are noise or a knock."""
SHORTEST_GAP = 0.08
"""Shorter losses of contact [s] are noise."""


@dataclass(frozen=True)
class Contact:
    """One foot's time on the ground [s]."""

    strike: float
    """Heel strike, where ``begun``; otherwise the first sample."""
    lift: float
    begun: bool
    """Whether the heel strike was seen; otherwise the foot was down when the record began."""
    ended: bool
    """Whether the toe-off was seen."""


def offset(vertical: Samples) -> float:
    """What a plate reads with nobody on it [N]: the median of what is below a twentieth of the largest load."""
    free = vertical[vertical < 0.05 * np.nanmax(vertical)]
    return float(np.median(free)) if len(free) > 0.05 * len(vertical) else 0.0


def contacts(time: Samples, vertical: Samples, threshold: float = LOADED) -> list[Contact]:
    """Contacts in ``vertical`` [N] at ``time`` [s]; events are where straight lines between samples cross."""
    loaded = np.nan_to_num(vertical) > threshold
    edges = np.flatnonzero(np.diff(loaded.astype(int))) + 1
    bounds = [0, *edges.tolist(), len(loaded)]
    spans = [(a, b) for a, b in pairwise(bounds) if loaded[a]]
    joined: list[tuple[int, int]] = []
    for a, b in spans:
        if joined and time[a] - time[joined[-1][1]] < SHORTEST_GAP:
            joined[-1] = (joined[-1][0], b)
        else:
            joined.append((a, b))
    found = []
    for a, b in joined:
        strike = _crossing(time, vertical, a, threshold) if a > 0 else float(time[0])
        lift = _crossing(time, vertical, b, threshold) if b < len(time) else float(time[-1])
        if lift - strike >= SHORTEST_CONTACT:
            found.append(Contact(strike, lift, a > 0, b < len(time)))
    return found


def _crossing(time: Samples, values: Samples, after: int, threshold: float) -> float:
    """When the line from the sample before to that at ``after`` passes ``threshold``."""
    low, high = float(values[after - 1]), float(values[after])
    share = (threshold - low) / (high - low) if np.isfinite(low) and high != low else 1.0
    return float(time[after - 1] + share * (time[after] - time[after - 1]))
