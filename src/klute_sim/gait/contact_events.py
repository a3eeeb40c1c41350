"""First contact and toe-off of one stride as gait phases."""

import numpy as np

from klute_sim.types import Array

MID_STANCE_PCT = 30.0
"""Gait phase [%] around which stance is detected."""
MAX_CONTACT_GAP_PCT = 5.0
"""Longest loss of contact that does not end stance [% of the cycle]."""


def find_contact_events(phase: Array, contact: np.ndarray) -> tuple[float | None, float | None]:
    """Return first contact and toe-off [%] of the stance around :data:`MID_STANCE_PCT`.

    Gaps up to :data:`MAX_CONTACT_GAP_PCT` do not end stance. A longer gap separates stance from a contact in swing.
    """
    if not contact.any():
        return None, None
    cycle = np.sort(phase[contact] - MID_STANCE_PCT)
    cycle = np.concatenate([cycle[cycle >= 50.0] - 100.0, cycle[cycle < 50.0]])  # with mid-stance in the middle
    before, after = cycle[cycle <= 0.0][::-1], cycle[cycle >= 0.0]
    return MID_STANCE_PCT - _measure_unbroken_extent(-before), MID_STANCE_PCT + _measure_unbroken_extent(after)


def _measure_unbroken_extent(distances: Array) -> float:
    """Return the last of the increasing ``distances`` from 0 before the first gap."""
    steps = np.diff(distances, prepend=0.0)
    gaps = np.flatnonzero(steps > MAX_CONTACT_GAP_PCT)
    unbroken = distances[: gaps[0]] if len(gaps) else distances
    return float(unbroken[-1]) if len(unbroken) else 0.0
