"""Position of a slide with stops: values far beyond them, and the mistake that explains these."""

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.joint_angle import MAX_EXCESS_FRACTION
from klute_sim.plausibility.samples import Samples
from klute_sim.plausibility.units import UNIT_ADVICE, UNITS, format_range, format_value

MIN_UNIT_RATIO = 20.0
"""Smallest ratio of two units that are told apart (assumed: a wrong zero looks like a ratio of a few)."""
MIN_MOTION_FRACTION = 0.02
"""Smallest motion, over the distance between the stops, of a position in another unit (assumed)."""


def check_slide_position(samples: Samples, stops: tuple[float, float], place: str) -> list[Finding]:
    """Return a finding if the position [m] is far beyond the ``stops`` [m] of its joint in half of its ``samples``."""
    values, stop_range = samples.finite, stops[1] - stops[0]
    low, high = stops[0] - MAX_EXCESS_FRACTION * stop_range, stops[1] + MAX_EXCESS_FRACTION * stop_range
    if values.size == 0 or low <= np.median(values) <= high:
        return []
    units = [
        unit
        for unit, factor in UNITS["m"].items()
        if factor * MIN_UNIT_RATIO < samples.factor
        and low <= values.min() * factor / samples.factor
        and values.max() * factor / samples.factor <= high
        and np.ptp(values) * factor / samples.factor > MIN_MOTION_FRACTION * stop_range
    ]
    first, last = (format_value(stop, samples.unit, samples.factor) for stop in stops)
    if units:
        kind, cause = "unit", f"is its unit {units[0]}? {UNIT_ADVICE}"
    else:
        kind = "zero"
        cause = "its zero or its scale differs from that of the model; correct it in [columns]"
    statement = (
        f"`{samples.channel}` is {format_range(values, samples.unit, samples.factor)}, but the stops of its joint are "
        f"at {first} and {last}: {cause}"
    )
    return [Finding(f"{samples.channel}-{kind}", place, statement)]
