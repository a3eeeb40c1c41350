"""Which walks are repeats of one experiment: as long a stride, under the same pressures."""

from collections.abc import Sequence

import numpy as np

from klute_sim.motion.walks import Walk

PACE = 0.04
"""Difference of stride times, over the first one's, up to which two walks are at one speed (assumed)."""
ALIKE = 0.05
"""Root mean square of two profiles' difference, over the first one's peak, up to which they are one (assumed)."""
LEAST = 0.05
"""The same [bar], for profiles that hardly ask for anything (assumed)."""
PHASE = np.linspace(0.0, 1.0, 101)


def groups(walks: Sequence[Walk], each: int | None = None) -> list[int]:
    """The group of every walk, counted from 1 in the order in which they come; ``each``: so many on end are one."""
    if each is not None:
        return [1 + k // each for k in range(len(walks))]
    firsts: list[Walk] = []
    found = []
    for walk in walks:
        place = next((k for k, first in enumerate(firsts) if _repeats(walk, first)), len(firsts))
        if place == len(firsts):
            firsts.append(walk)
        found.append(1 + place)
    return found


def _repeats(one: Walk, first: Walk) -> bool:
    if abs(one.stride_time - first.stride_time) > PACE * first.stride_time:
        return False
    wanted = first.command(PHASE)
    apart = float(np.sqrt(np.mean((one.command(PHASE) - wanted) ** 2)))
    return apart <= max(LEAST, ALIKE * float(np.abs(wanted).max()))
