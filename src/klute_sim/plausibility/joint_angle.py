"""Angle of a joint with stops: values far beyond them, and the mistake that explains these."""

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.units import format_range, format_value
from klute_sim.types import Array

MAX_EXCESS_FRACTION = 0.5
"""Distance from the stops, over the distance between them, up to which an angle may be right (assumed: stops of a model
are rough, and so may be the zero of an encoder)."""
DEGREES_PER_RADIAN = 180.0 / np.pi
TURN = 2.0 * np.pi
"""Full turn [rad]."""
WRAP_TOLERANCE = 0.2
"""Largest relative difference of a jump from a full turn that is taken for a wrap (assumed: the joint moves on)."""
MIN_MOTION_FRACTION = 0.15
"""Smallest motion, over the distance between the stops, of an angle that was converted to degrees twice (assumed)."""
MIN_CODE_SAMPLES = 3
"""Smallest number of samples with the same value that are taken for a code."""
MIN_COUNTS = 20
"""Smallest number of different whole numbers that are taken for counts (assumed)."""


class _Angle:
    """Samples of an angle, the stops of its joint, and how to write both."""

    def __init__(self, channel: str, values: Array, unit: str, stops: tuple[float, float], place: str) -> None:
        self.channel, self.values, self.place = channel, values[np.isfinite(values)], place
        self.factor = 1.0 if unit == "rad" else 1.0 / DEGREES_PER_RADIAN
        self.unit = unit if unit == "rad" else "deg"
        self.stops, self.stop_range = stops, stops[1] - stops[0]
        excess = MAX_EXCESS_FRACTION * self.stop_range
        self.low, self.high = stops[0] - excess, stops[1] + excess

    def fits(self, values: Array) -> bool:
        """Return whether all ``values`` [rad] lie near the stops or between them."""
        return bool(self.low <= values.min() and values.max() <= self.high)

    def describe(self, kind: str, cause: str) -> list[Finding]:
        """Return a finding that names the range of the samples, the stops and the ``cause``."""
        low, high = (format_value(stop, self.unit, self.factor) for stop in self.stops)
        statement = (
            f"`{self.channel}` is {format_range(self.values, self.unit, self.factor)}, but the stops of its joint are "
            f"at {low} and {high}: {cause}"
        )
        return [Finding(f"{self.channel}-{kind}", self.place, statement)]


def check_joint_angle(channel: str, angle: Array, unit: str, stops: tuple[float, float], place: str) -> list[Finding]:
    """Return a finding if the ``angle`` [rad], read in ``unit``, is far beyond the stops of its joint.

    ``stops`` are the lowest and the highest angle of the joint [rad].
    """
    samples = _Angle(channel, angle, unit, stops, place)
    if samples.values.size == 0 or samples.fits(samples.values):
        return []
    for check in (_check_code, _check_wrap, _check_counts, _check_degrees):
        findings = check(samples)
        if findings:
            return findings
    if np.ptp(samples.values) <= samples.stop_range:
        cause = "its zero or its sign differs from that of the model; add the difference, or turn the sign in [columns]"
        return samples.describe("zero", cause)
    return samples.describe("unit", "its unit or its scale is wrong; correct the heading, or convert it in [columns]")


def _check_code(angle: _Angle) -> list[Finding]:
    """Return a finding for one value beyond the stops that is repeated and far from all others."""
    for code in (angle.values.min(), angle.values.max()):
        is_code = angle.values == code
        others = angle.values[~is_code]
        if is_code.sum() < MIN_CODE_SAMPLES or others.size == 0 or not angle.fits(others):
            continue
        if min(abs(code - others.min()), abs(code - others.max())) > angle.stop_range:
            statement = (
                f"`{angle.channel}` is {format_value(code, angle.unit, angle.factor)} in {is_code.sum()} samples and "
                f"{format_range(others, angle.unit, angle.factor)} in the others: it looks like a code for missing "
                "values; leave the cells of missing samples empty"
            )
            return [Finding(f"{angle.channel}-missing", angle.place, statement)]
    return []


def _check_wrap(angle: _Angle) -> list[Finding]:
    """Return a finding for samples that lie between the stops once full turns are added."""
    steps = np.diff(angle.values)
    jumps = steps[np.abs(steps) > 0.5 * TURN]
    if angle.stop_range >= TURN or np.any(np.abs(np.abs(jumps) / TURN - 1.0) > WRAP_TOLERANCE):
        return []
    unwrapped = np.unwrap(angle.values)
    middle = 0.5 * (angle.low + angle.high)
    shifted = unwrapped - TURN * np.round((np.median(unwrapped) - middle) / TURN)
    if np.ptp(shifted) > angle.stop_range or not angle.fits(shifted):
        return []
    turn = format_value(TURN, angle.unit, angle.factor)
    if jumps.size == 0:
        return angle.describe("wrapped", f"it is a full turn off; add or subtract {turn} in [columns]")
    noun = "jump" if jumps.size == 1 else "jumps"
    cause = f"it has {jumps.size} {noun} of about {turn}, so the encoder wraps; add a full turn beyond each jump"
    return angle.describe("wrapped", cause)


def _check_counts(angle: _Angle) -> list[Finding]:
    """Return a finding for whole numbers over more than the distance between the stops."""
    written = angle.values / angle.factor
    numbers = np.unique(np.round(written))
    is_whole = np.abs(written - np.round(written)).max() < 1e-6 * np.abs(written).max()
    if not is_whole or len(numbers) < MIN_COUNTS or np.ptp(angle.values) <= angle.stop_range:
        return []
    cause = (
        "all samples are whole numbers, so they look like the counts of an encoder; convert them in [columns]: "
        f"(counts - counts at angle 0) / counts per turn * {format_value(TURN, angle.unit, angle.factor)}"
    )
    return angle.describe("unit", cause)


def _check_degrees(angle: _Angle) -> list[Finding]:
    """Return a finding for degrees that were taken for radians."""
    converted = angle.values / DEGREES_PER_RADIAN
    if not angle.fits(converted):
        return []
    if angle.unit == "rad":
        return angle.describe("unit", "it looks like degrees that were taken for radians; correct the unit to deg")
    if np.ptp(converted) < MIN_MOTION_FRACTION * angle.stop_range:
        return []
    cause = "it looks like degrees that were taken for radians; it was converted to degrees twice"
    return angle.describe("unit", cause)
