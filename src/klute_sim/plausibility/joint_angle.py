"""Unit of the angle of a joint with stops: an angle far beyond them that fits in the other unit."""

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.units import round_digits
from klute_sim.types import Array

MAX_EXCESS_FRACTION = 0.5
"""Distance from the stops, over the distance between them, up to which an angle may be right (assumed: stops of a model
are rough, and so may be the zero of an encoder)."""
DEGREES_PER_RADIAN = 180.0 / np.pi


def check_joint_angle(channel: str, angle: Array, unit: str, stops: tuple[float, float], place: str) -> list[Finding]:
    """Return a finding if the ``angle`` [rad], read in ``unit``, are degrees that were taken for radians.

    ``stops`` are the lowest and the highest angle of the joint [rad].
    """
    excess = MAX_EXCESS_FRACTION * (stops[1] - stops[0])
    low, high = stops[0] - excess, stops[1] + excess
    lowest, highest = float(np.nanmin(angle)), float(np.nanmax(angle))
    if low <= lowest and highest <= high:
        return []
    if not (low <= lowest / DEGREES_PER_RADIAN and highest / DEGREES_PER_RADIAN <= high):
        return []
    factor = 1.0 if unit == "rad" else DEGREES_PER_RADIAN
    advice = "correct the unit to deg" if unit == "rad" else "it was converted to degrees twice"
    first, last, *limits = (f"{round_digits(value * factor):g}" for value in (lowest, highest, *stops))
    statement = (
        f"`{channel}` is {first} to {last} {unit}, but the stops of its joint are at {' and '.join(limits)} {unit}: it "
        f"looks like degrees that were taken for radians; {advice}"
    )
    return [Finding(f"{channel}-unit", place, statement)]
