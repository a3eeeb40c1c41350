"""Detection of repeated trials: equal stride times and equal commanded pressures."""

from collections.abc import Sequence

import numpy as np

from klute_sim.mocap.prosthesis_trials import ProsthesisTrial
from klute_sim.mocap.strides.strides import PHASE_GRID

STRIDE_TIME_TOLERANCE = 0.04
"""Largest relative difference of stride times between repeats (assumed)."""
COMMAND_TOLERANCE = 0.05
"""Largest rms difference of commanded pressures between repeats, relative to the first one's peak (assumed)."""
MIN_COMMAND_TOLERANCE_BAR = 0.05
"""Smallest tolerance for the rms difference of commanded pressures [bar], for low pressures (assumed)."""


def group_repeats(trials: Sequence[ProsthesisTrial], trials_per_group: int | None = None) -> list[int]:
    """Return the group number of each trial, starting at 1.

    With ``trials_per_group``, consecutive trials form groups of this size; otherwise repeats are detected.
    """
    if trials_per_group is not None:
        return [1 + k // trials_per_group for k in range(len(trials))]
    references: list[ProsthesisTrial] = []
    groups = []
    for trial in trials:
        index = next((k for k, reference in enumerate(references) if _is_repeat(trial, reference)), len(references))
        if index == len(references):
            references.append(trial)
        groups.append(1 + index)
    return groups


def _is_repeat(trial: ProsthesisTrial, reference: ProsthesisTrial) -> bool:
    if abs(trial.stride_time - reference.stride_time) > STRIDE_TIME_TOLERANCE * reference.stride_time:
        return False
    reference_command = reference.compute_mean_command(PHASE_GRID)
    rms_difference = float(np.sqrt(np.mean((trial.compute_mean_command(PHASE_GRID) - reference_command) ** 2)))
    return rms_difference <= max(MIN_COMMAND_TOLERANCE_BAR, COMMAND_TOLERANCE * float(np.abs(reference_command).max()))
