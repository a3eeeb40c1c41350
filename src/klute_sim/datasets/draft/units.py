"""Units of columns whose headings state none, from the size of their samples in all files."""

from collections.abc import Sequence

import numpy as np

from klute_sim.datasets.draft.columns import UNKNOWN_UNIT, USUAL_UNITS, RecognizedFile
from klute_sim.datasets.draft.headings import RATIO, interpret_heading
from klute_sim.datasets.unit_conversion import get_si_factor
from klute_sim.types import Array

MAX_SAMPLING_INTERVAL_S = 0.5
"""Longest usual time between samples of a bench recording (assumed)."""
MIN_DURATION_S = 1.0
"""Shortest usual bench recording (assumed)."""
MAX_PRESSURE_PA = 20e5
"""Largest usual pressure of a pneumatic muscle (assumed)."""
MIN_LENGTH_MM = 1.0
"""Smallest number among lengths or displacements in mm of a whole set of recordings (assumed)."""
MIN_NUMBER = 5e-3
"""Largest number of displacements that are noise of a specimen that is held (assumed: 5 um; 5 mm if metres)."""
METRE_RATIOS = 0.5, 1.5
"""Shortest and longest length of a unit over its resting length that is taken for metres (assumed)."""

_SMALLER_UNITS = {"time": ("ms", "us"), "pressure": ("kPa", "Pa"), "pressure_command": ("kPa", "Pa")}
"""Channel or time -> units that follow the usual one, from the largest to the smallest."""


def assume_units(files: Sequence[RecognizedFile], resting_length: float) -> dict[str, str]:
    """Return the unit of each heading that states none and whose samples contradict the usual unit.

    Large times and pressures are in a smaller unit. Lengths below 1 mm are metres, fractions of the ``resting_length``
    [m] of the unit, or :data:`UNKNOWN_UNIT`.
    """
    sizes: dict[tuple[str, str], list[float]] = {}
    for file in files:
        for channel, choice in file.choices.items():
            if choice.is_unit_assumed and channel in _SMALLER_UNITS:
                sizes.setdefault((channel, choice.heading), []).append(_compute_size(file, channel))
    units = _assume_units_of_lengths(files, resting_length)
    for (channel, heading), values in sizes.items():
        si_unit = "s" if channel == "time" else "Pa"
        limit = MAX_SAMPLING_INTERVAL_S if channel == "time" else MAX_PRESSURE_PA
        size = float(np.median(values)) if channel == "time" else max(values)
        usual_factor = get_si_factor(USUAL_UNITS[si_unit], si_unit) or 1.0
        if size > limit:
            factors = {unit: get_si_factor(unit, si_unit) or 1.0 for unit in _SMALLER_UNITS[channel]}
            fitting = [unit for unit, factor in factors.items() if size * factor / usual_factor <= limit]
            units[heading] = next(iter(fitting), _SMALLER_UNITS[channel][-1])
    return units


def _assume_units_of_lengths(files: Sequence[RecognizedFile], resting_length: float) -> dict[str, str]:
    lengths: dict[str, list[Array]] = {}
    for file in files:
        for channel in ("length", "muscle_length"):
            choice = file.choices.get(channel)
            if choice is not None and choice.is_unit_assumed:
                lengths.setdefault(choice.heading, []).append(file.samples[channel])
    units = {}
    factor = get_si_factor(USUAL_UNITS["m"], "m") or 1.0
    for heading, samples in lengths.items():
        numbers = np.concatenate(samples) / factor
        meaning, largest = interpret_heading(heading), float(np.nanmax(np.abs(numbers)))
        if meaning is None or not MIN_NUMBER < largest < MIN_LENGTH_MM:
            continue
        low, high = (ratio * resting_length for ratio in METRE_RATIOS)
        if meaning.direction == 0 and low < float(np.nanmedian(numbers)) < high:
            units[heading] = "m"
        elif meaning.direction != 0 and largest > low:  # more than a muscle can move
            units[heading] = RATIO
        else:
            units[heading] = UNKNOWN_UNIT
    return units


def _compute_size(file: RecognizedFile, channel: str) -> float:
    """Return the largest pressure [Pa] of ``file``, or the median time [s] between its samples.

    0 for a file that is too short for a smaller unit of time.
    """
    samples = file.samples[channel][np.isfinite(file.samples[channel])]
    if channel != "time":
        return float(samples.max())
    is_short = float(np.ptp(samples)) < 1e3 * MIN_DURATION_S
    return 0.0 if is_short else float(np.median(np.diff(samples)))
