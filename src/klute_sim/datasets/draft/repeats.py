"""Detection of repeats among bench recordings: equal commands and equal lengths."""

from collections.abc import Sequence

import numpy as np

from klute_sim.datasets.draft.columns import RecognizedFile
from klute_sim.types import Array

RELATIVE_TOLERANCE = 0.02
"""Largest rms difference between the inputs of repeats, relative to their range over all files (assumed)."""
MIN_TOLERANCES = {"length": 3e-4, "pressure_command": 5e3}
"""Smallest tolerances [SI]: the noise of a length sensor, the resolution of a regulator (assumed)."""
DURATION_TOLERANCE = 0.05
"""Largest relative difference between the durations of repeats (assumed)."""
N_COMPARED = 400
"""Number of instants that are compared."""


def group_repeats(files: Sequence[RecognizedFile]) -> list[int]:
    """Return the group number of each file, starting at 0, in the order of their first members.

    Files without all inputs form groups of their own.
    """
    tolerances = {channel: _compute_tolerance(channel, files) for channel in MIN_TOLERANCES}
    first_members: list[RecognizedFile] = []
    groups = []
    for file in files:
        index = next(
            (k for k, other in enumerate(first_members) if _are_repeats(file, other, tolerances)), len(first_members)
        )
        if index == len(first_members):
            first_members.append(file)
        groups.append(index)
    return groups


def _compute_tolerance(channel: str, files: Sequence[RecognizedFile]) -> float:
    values = [file.samples[channel] for file in files if channel in file.samples]
    span = float(np.ptp(np.concatenate(values))) if values else 0.0
    return max(RELATIVE_TOLERANCE * span, MIN_TOLERANCES[channel])


def _are_repeats(file: RecognizedFile, other: RecognizedFile, tolerances: dict[str, float]) -> bool:
    if any(name not in each.samples for each in (file, other) for name in ("time", *tolerances)):
        return False
    durations = [float(np.ptp(each.samples["time"])) for each in (file, other)]
    if abs(durations[0] - durations[1]) > DURATION_TOLERANCE * max(durations):
        return False
    times = np.linspace(0.0, min(durations), N_COMPARED)
    return all(
        float(np.sqrt(np.mean((_sample(file, channel, times) - _sample(other, channel, times)) ** 2))) <= tolerance
        for channel, tolerance in tolerances.items()
    )


def _sample(file: RecognizedFile, channel: str, times: Array) -> Array:
    own_times = file.samples["time"]
    return np.interp(times, own_times - own_times[0], file.samples[channel])
