"""Unit, zero and wraps of one angle of the leg."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.units import round_digits
from klute_sim.types import Array

DEGREES_PER_RADIAN = 180.0 / np.pi
SPAN_RANGE_DEG = (7.0, 170.0)
"""Range of a joint's or segment's motion in gait [deg] (assumed: a stiff ankle, a sprinter's knee)."""
MAX_SPAN_DEG = 300.0
"""Span [deg] that no angle of a leg has."""
MAX_ZERO_ERROR_DEG = 42.0
"""Largest distance of the middle of an angle's range from the typical one [deg] (assumed; a slope of 10 degrees, an
encoder's zero and a crouch stay below)."""
MIN_JUMP_DEG = 120.0
"""Smallest change [deg] from sample to sample that is a wrap."""
JUMP_TOLERANCE_DEG = 65.0
"""Largest difference [deg] of a jump from a half or a full turn."""


class AngleLimits(NamedTuple):
    """Limits of one angle."""

    max_radian_span: float
    """Span below which numbers under degrees are radians."""
    middle: float
    """Typical middle of the range of motion [deg]."""
    convention: str
    """What the standard zero is."""
    at_right_angle: str
    """The usual other convention, whose values are 90 degrees away."""
    at_half_turn: str
    """The usual other convention, whose values are 180 degrees away."""


LIMITS: Mapping[str, AngleLimits] = MappingProxyType(
    {
        "hip": AngleLimits(1.9, 12.0, "0 with the thigh in line", "an angle from the horizontal", "the included angle"),
        "knee": AngleLimits(2.6, 33.0, "0 when straight", "an angle from the horizontal", "the included angle"),
        "ankle": AngleLimits(
            0.95, 0.0, "0 in standing", "the angle between foot and shank, 90 in standing", "a shifted zero"
        ),
        "shank": AngleLimits(
            2.3, 16.0, "0 when vertical", "the angle from the horizontal, 90 when vertical", "an angle from above"
        ),
    }
)
"""Joint or segment -> limits."""


class CheckedAngle(NamedTuple):
    """An angle after the check."""

    findings: list[Finding]
    """Findings."""
    degrees: Array
    """Values after the correction that the findings propose [deg]."""


def check_angle(part: str, channel: str, degrees: Array, unit: str, place: str) -> CheckedAngle:
    """Check unit, wraps and zero of an angle of ``part``, a key of :data:`LIMITS`.

    ``degrees`` are the values as read in ``unit`` and converted to degrees.
    """
    limits, factor = LIMITS[part], DEGREES_PER_RADIAN if unit == "rad" else 1.0
    findings: list[Finding] = []
    span = measure_span(degrees)
    if 0.0 < span < limits.max_radian_span and span * DEGREES_PER_RADIAN > SPAN_RANGE_DEG[0]:
        statement = (
            f"`{channel}` spans {round_digits(span / factor):g} {unit} in [{unit}]: it looks like radians; convert it "
            f"to {unit} or correct the unit"
        )
        findings.append(Finding(f"{channel}-unit", place, statement))
        degrees = degrees * DEGREES_PER_RADIAN
        span *= DEGREES_PER_RADIAN
    unwrapped, turn = unwrap(degrees)
    if turn and measure_span(unwrapped) < MAX_SPAN_DEG:
        statement = (
            f"`{channel}` jumps by about {turn:g} degrees between samples: it is wrapped at {turn:g} degrees; unwrap it"
        )
        findings.append(Finding(f"{channel}-wrapped", place, statement))
        degrees = unwrapped
    elif span > MAX_SPAN_DEG and SPAN_RANGE_DEG[0] < span / DEGREES_PER_RADIAN < SPAN_RANGE_DEG[1]:
        advice = "correct the unit to deg" if unit == "rad" else "it was converted to degrees twice"
        statement = (
            f"`{channel}` spans {round_digits(span / factor):g} {unit} in [{unit}]: it looks like degrees that were "
            f"taken for radians; {advice}"
        )
        findings.append(Finding(f"{channel}-unit", place, statement))
        degrees = degrees / DEGREES_PER_RADIAN
    elif span > MAX_SPAN_DEG:
        statement = f"`{channel}` spans {round_digits(span / factor):g} {unit}, which no leg can; check its unit"
        findings.append(Finding(f"{channel}-unit", place, statement))
        return CheckedAngle(findings, degrees)
    middle = _find_middle(degrees)
    quarter_turns = round((middle - limits.middle) / 90.0)
    is_negative = abs(-middle - limits.middle) <= 0.5 * MAX_ZERO_ERROR_DEG  # a matter of the sign
    if abs(middle - limits.middle) > MAX_ZERO_ERROR_DEG and quarter_turns and not is_negative:
        degrees = degrees - 90.0 * quarter_turns
        if not turn:
            other = limits.at_right_angle if quarter_turns % 2 else limits.at_half_turn
            statement = (
                f"`{channel}` is centred on {middle:.0f} degrees, near {limits.middle:.0f} is usual: it looks like "
                f"{other}; the zero is {limits.convention}, so subtract it (and check the sign)"
            )
            findings.append(Finding(f"{channel}-zero", place, statement))
    elif abs(middle - limits.middle) > MAX_ZERO_ERROR_DEG and not is_negative:
        statement = (
            f"`{channel}` is centred on {middle:.0f} degrees, near {limits.middle:.0f} is usual: its zero is wrong; it "
            f"is {limits.convention}"
        )
        findings.append(Finding(f"{channel}-zero", place, statement))
    return CheckedAngle(findings, degrees)


def measure_span(values: Array) -> float:
    """Return the range of ``values`` without the outermost half per cent of a long recording."""
    known = values[np.isfinite(values)]
    if known.size == 0:
        return 0.0
    low, high = (0.5, 99.5) if known.size > 400 else (0.0, 100.0)
    return float(np.percentile(known, high) - np.percentile(known, low))


def _find_middle(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(0.5 * (np.percentile(known, 1.0) + np.percentile(known, 99.0))) if known.size else 0.0


def unwrap(degrees: Array) -> tuple[Array, float]:
    """Return ``degrees`` without jumps of a half or a full turn, and that turn [deg]; 0 where there is no jump."""
    known = np.isfinite(degrees)
    values = degrees[known]
    steps = np.diff(values)
    is_jump = np.abs(steps) > MIN_JUMP_DEG
    if not is_jump.any() or is_jump.mean() > 0.2:
        return degrees, 0.0
    size = float(np.median(np.abs(steps[is_jump])))
    turn = 360.0 if size > 250.0 else 180.0
    if (np.abs(np.abs(steps[is_jump]) - turn) > JUMP_TOLERANCE_DEG).any():
        return degrees, 0.0
    result = degrees.copy()
    shift = np.concatenate([[0.0], np.cumsum(np.where(is_jump, -np.sign(steps) * turn, 0.0))])
    shifted = values + shift
    shifted -= turn * round(float(np.median(shifted)) / turn)
    result[known] = shifted
    return result, turn
