"""Which walks are repeats of one experiment: as long a stride, under the same pressures."""

from collections.abc import Sequence

import numpy as np

from klute_sim.mocap.prosthesis_trials import ProsthesisTrial

STRIDE_TIME_TOLERANCE = 0.04
"""Difference of stride times, over the first one's, up to which two walks are at one speed (assumed)."""
COMMAND_TOLERANCE = 0.05
"""Root mean square of two profiles' difference, over the first one's peak, up to which they are one (assumed)."""
MIN_COMMAND_TOLERANCE_BAR = 0.05
"""The same [bar], for profiles that hardly ask for anything (assumed)."""
PHASE_GRID = np.linspace(0.0, 1.0, 101)


def group_repeats(trials: Sequence[ProsthesisTrial], trials_per_group: int | None = None) -> list[int]:
    """The group of every walk, counted from 1 in the order in which they come; ``each``: so many on end are one."""
    if trials_per_group is not None:
        return [1 + k // trials_per_group for k in range(len(trials))]
    firsts: list[ProsthesisTrial] = []
    found = []
    for walk in trials:
        place = next((k for k, first in enumerate(firsts) if _is_repeat(walk, first)), len(firsts))
        if place == len(firsts):
            firsts.append(walk)
        found.append(1 + place)
    return found


def _is_repeat(trial: ProsthesisTrial, reference: ProsthesisTrial) -> bool:
    if abs(trial.stride_time - reference.stride_time) > STRIDE_TIME_TOLERANCE * reference.stride_time:
        return False
    wanted = reference.mean_command(PHASE_GRID)
    apart = float(np.sqrt(np.mean((trial.mean_command(PHASE_GRID) - wanted) ** 2)))
    return apart <= max(MIN_COMMAND_TOLERANCE_BAR, COMMAND_TOLERANCE * float(np.abs(wanted).max()))
