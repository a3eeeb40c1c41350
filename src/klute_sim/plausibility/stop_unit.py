"""Stops of a hinge in degrees that the model takes for radians."""

from collections.abc import Sequence

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.joint_angle import DEGREES_PER_RADIAN, MAX_EXCESS_FRACTION
from klute_sim.plausibility.samples import Samples
from klute_sim.plausibility.units import format_range, round_digits

MIN_STOP_RANGE = 4.0 * np.pi
"""Distance between stops [rad] above which their unit is examined: two turns (assumed: winches have such stops)."""


def check_stop_unit(angles: Sequence[Samples], stops: tuple[float, float], place: str) -> list[Finding]:
    """Return a finding if the ``stops`` [rad] of a hinge are turns apart and all its ``angles`` fit them in degrees."""
    values = [samples.finite for samples in angles if samples.finite.size]
    stop_range = stops[1] - stops[0]
    if not values or stop_range < MIN_STOP_RANGE:
        return []
    low, high = (stop / DEGREES_PER_RADIAN for stop in stops)
    excess = MAX_EXCESS_FRACTION * stop_range / DEGREES_PER_RADIAN
    recorded, samples = np.concatenate(values), angles[0]
    if recorded.min() < low - excess or recorded.max() > high + excess:
        return []
    statement = (
        f"the stops of the joint of `{samples.channel}` are at {round_digits(stops[0]):g} and "
        f"{round_digits(stops[1]):g} rad, turns apart, and the angle is only "
        f"{format_range(recorded, samples.unit, samples.factor)} in all trials: are the angles of the model in "
        'degrees? Write angle="degree" under compiler'
    )
    return [Finding(f"{samples.channel}-geometry", place, statement)]
