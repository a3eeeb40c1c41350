"""Detection of repeats among bench recordings: equal commands, equal lengths, and outputs that agree."""

from collections.abc import Mapping, Sequence

import numpy as np

from klute_sim.datasets.channels import get_measured_units
from klute_sim.datasets.draft.columns import RecognizedFile
from klute_sim.types import Array

RELATIVE_TOLERANCE = 0.02
"""Largest rms difference between the inputs of repeats, relative to their range in these files (assumed)."""
MIN_TOLERANCES = {"length": 3e-4, "pressure_command": 5e3}
"""Smallest tolerances [SI]: the noise of a length sensor, the resolution of a regulator (assumed)."""
OUTPUT_TOLERANCE = 0.05
"""Largest rms difference between an output of repeats, relative to its range in these files (assumed; muscles of 10 mm
whose pressures agreed within 2 % differed by up to 3.3 %)."""
MIN_OUTPUT_TOLERANCE = 0.01
"""Smallest tolerance of an output, relative to its range over all files: the noise of a sensor (assumed)."""
DURATION_TOLERANCE = 0.05
"""Largest relative difference between the durations of repeats (assumed)."""
N_COMPARED = 400
"""Number of instants that are compared."""
MAD_TO_DEVIATION = 1.4826
"""Standard deviation of normal noise over its median absolute deviation."""


def group_repeats(files: Sequence[RecognizedFile], resting_lengths: Sequence[float] = ()) -> list[int]:
    """Return the group number of each file, starting at 0, in the order of their first members.

    Files are compared by the inputs that are known of both; a file with another input, or without any, is no repeat.
    Files with different ``resting_lengths``, one for each file if they are known, are no repeats either.
    """
    noise = {channel: MIN_OUTPUT_TOLERANCE * _compute_span(files, channel) for channel in get_measured_units("bench")}
    specimens = resting_lengths or [0.0] * len(files)
    first_members: list[int] = []
    groups = []
    for index, (file, specimen) in enumerate(zip(files, specimens, strict=True)):
        candidates = (
            group
            for group, first in enumerate(first_members)
            if specimens[first] == specimen and _are_repeats(file, files[first], noise)
        )
        group = next(candidates, len(first_members))
        if group == len(first_members):
            first_members.append(index)
        groups.append(group)
    return groups


def _compute_span(files: Sequence[RecognizedFile], channel: str) -> float:
    """Return the range of ``channel`` over ``files``; 0 where none has it."""
    samples = [values for file in files if (values := file.get_output(channel)) is not None]
    return float(np.nanmax(np.concatenate(samples)) - np.nanmin(np.concatenate(samples))) if samples else 0.0


def _are_repeats(file: RecognizedFile, other: RecognizedFile, noise: Mapping[str, float]) -> bool:
    """Return whether inputs and outputs agree; ``noise`` holds the smallest tolerance of each output."""
    pair = (file, other)
    known = [{name for name in ("time", *MIN_TOLERANCES) if member.get_output(name) is not None} for member in pair]
    inputs = known[0] - {"time"}
    if known[0] != known[1] or not inputs:
        return False
    durations = [float(np.ptp(_get_times(member))) for member in pair]
    if abs(durations[0] - durations[1]) > DURATION_TOLERANCE * max(durations):
        return False
    times = np.linspace(0.0, min(durations), N_COMPARED)
    outputs = [name for name in noise if all(member.get_output(name) is not None for member in pair)]
    limits = [(name, RELATIVE_TOLERANCE, MIN_TOLERANCES[name]) for name in inputs]
    limits += [(name, OUTPUT_TOLERANCE, noise[name]) for name in outputs]
    for name, relative, smallest in limits:
        difference = _sample(file, name, times) - _sample(other, name, times)
        tolerance = max(relative * max(_compute_span([member], name) for member in pair), smallest)
        # A measured input, such as the pressure that stands for the command, differs by its noise as well.
        variance = sum(_estimate_noise(member, name) ** 2 for member in pair)
        if not float(np.mean(difference**2)) <= tolerance**2 + variance:  # or the time is missing somewhere
            return False
    return True


def _estimate_noise(file: RecognizedFile, channel: str) -> float:
    """Return the standard deviation of the noise of ``channel``, by its second differences, which motion hardly has."""
    values = file.get_output(channel)
    assert values is not None
    curvature = np.diff(values[np.isfinite(values)], 2)
    return MAD_TO_DEVIATION * float(np.median(np.abs(curvature))) / np.sqrt(6.0) if len(curvature) else 0.0


def _get_times(file: RecognizedFile) -> Array:
    """Return the time of each sample after the first [s]; its row [1] where the file has no time."""
    if "time" not in file.samples:
        return np.arange(float(max(len(values) for values in (*file.samples.values(), *file.readings.values()))))
    times: Array = file.samples["time"] - file.samples["time"][0]
    return times


def _sample(file: RecognizedFile, channel: str, times: Array) -> Array:
    """Return ``channel`` at ``times`` after the first sample, between samples that are missing, too."""
    values = file.get_output(channel)
    assert values is not None
    is_present = np.isfinite(values)
    return np.interp(times, _get_times(file)[is_present], values[is_present])
