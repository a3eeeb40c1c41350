"""Positions of the ankle and the centre of pressure: unit, axis, direction and origin."""

import math
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.gait.steps import TOE_OFF_PCT, Series, Step, average_cycle
from klute_sim.plausibility.units import UNITS, Range, format_value, round_digits
from klute_sim.types import Array, Mask

RISE_RANGE = Range(0.022, 0.9, 0.15)
"""Rise of the ankle from stance to swing [m]; shuffling has 0.03, sprinting 0.8."""
HEIGHT_RANGE = (-0.1, 0.4)
"""Height of the standing ankle above the ground [m], with an offset of the laboratory (assumed)."""
SPEED_RANGE = Range(0.3, 14.0, 2.8)
"""Forward speed of the ankle in swing relative to stance [m/s]; slow walking has 0.8, sprinting 12."""
MAX_WALKING_SPEED = 3.2
"""Speed above which nobody walks [m/s]; the world record of race walking is 4.2 m/s with straight knees."""
MAX_COP_DISTANCE = 0.5
"""Largest distance of the centre of pressure from the ankle under load [m]; a long shoe has 0.3."""
MAX_COP_PROGRESSION = -0.07
"""Progression of the centre of pressure through stance [m] below which it moves from toe to heel."""


class Motion(NamedTuple):
    """Mean motion of the ankle over the cycle, in metres after the corrections that findings propose."""

    rise: float
    """Rise from stance to swing [m]."""
    swing_speed: float
    """Forward speed in swing relative to stance [m/s]."""
    walking_speed: float
    """Speed relative to the ground or belt [m/s]."""
    height_difference: float
    """Height at toe-off minus height at foot strike [m]."""


class ScaledSeries(NamedTuple):
    """A channel in SI units as read, with the unit in its heading."""

    channel: str
    """Name of the channel."""
    series: Series
    """Samples [SI]."""
    unit: str
    """Unit in the heading."""
    factor: float
    """Factor of that unit to SI."""

    def multiply(self, factor: float) -> "ScaledSeries":
        """Return the channel with all samples multiplied by ``factor``."""
        return self._replace(series=Series(self.series.time, factor * self.series.value))


def measure_rise(curve: Array) -> float:
    """Return the largest value in swing minus the median in stance of a mean ``curve``; 0 where it is unknown."""
    stance, swing = curve[8:32], curve[TOE_OFF_PCT - 4 :]
    if not (np.isfinite(stance).any() and np.isfinite(swing).any()):
        return 0.0
    difference = swing - float(np.nanmedian(stance))
    largest, smallest = float(np.nanmax(difference)), float(np.nanmin(difference))
    return largest if largest > -smallest else smallest


def measure_swing_speed(curve: Array, steps: list[Step]) -> float:
    """Return the speed in swing relative to that in stance of a mean relative ``curve``; 0 where it is unknown."""
    stance, swing = _measure_phases(steps)
    first, last = TOE_OFF_PCT + 4, _find_last_known(curve)
    if last < first + 8 or not np.isfinite(curve[[6, 36]]).all() or not np.isfinite(curve[first]):
        return 0.0
    in_swing = (curve[last] - curve[first]) / ((last - first) / (100.0 - TOE_OFF_PCT) * swing)
    in_stance = (curve[36] - curve[6]) / (30.0 / TOE_OFF_PCT * stance)
    return float(in_swing - in_stance)


def _find_last_known(curve: Array) -> int:
    known = np.flatnonzero(np.isfinite(curve[:98]))
    return int(known[-1]) if known.size else 0


def _measure_phases(steps: list[Step]) -> tuple[float, float]:
    """Return the mean durations of stance and swing."""
    stance = float(np.mean([step.toe_off - step.strike for step in steps]))
    return stance, float(np.mean([step.next_strike - step.toe_off for step in steps]))


def measure_motion(x: Series, z: Series, steps: list[Step]) -> Motion:
    """Return the mean motion of the ankle."""
    relative, height = average_cycle(x, steps, relative=True), average_cycle(z, steps)
    swing_speed = measure_swing_speed(relative, steps)
    stance, swing = _measure_phases(steps)
    return Motion(
        measure_rise(height),
        swing_speed,
        swing_speed * swing / (stance + swing),
        float(height[TOE_OFF_PCT] - height[2]),
    )


def find_exchanged_axes(x: ScaledSeries, z: ScaledSeries, steps: list[Step], place: str) -> list[Finding]:
    """Return whether the forward and the vertical position of the ankle are exchanged."""
    as_is, exchanged = (measure_motion(a.series, b.series, steps) for a, b in ((x, z), (z, x)))
    if abs(exchanged.swing_speed) < 3.0 * abs(as_is.swing_speed) or abs(exchanged.rise) > 0.6 * abs(as_is.rise):
        return []
    if not (SPEED_RANGE.contains(abs(exchanged.swing_speed)) and RISE_RANGE.contains(abs(exchanged.rise))):
        return []
    statement = (
        f"`{x.channel}` rises and falls in swing and `{z.channel}` travels forward: the axes are exchanged; exchange "
        "the columns"
    )
    return [Finding(f"{x.channel}-exchanged", place, statement)]


def guess_length_unit(size: float, factor: float, plausible: Range) -> str:
    """Return the unit that brings a ``size`` [SI], as read with ``factor``, closest to the typical one; '' for none.

    A smaller number is taken for metres only.
    """
    if plausible.contains(size) or not size > 0.0:
        return ""
    units = {unit: size / factor * other for unit, other in UNITS["m"].items() if other < factor or unit == "m"}
    possible = {unit: value for unit, value in units.items() if plausible.contains(value)}
    return min(possible, key=lambda unit: abs(math.log(possible[unit] / plausible.typical)), default="")


def check_unit(
    position: ScaledSeries, size: float, plausible: Range, meaning: str, place: str
) -> tuple[list[Finding], str]:
    """Return the finding on the unit of ``position``, whose ``size`` [SI] has a ``plausible`` range, and the unit."""
    guess = guess_length_unit(abs(size), position.factor, plausible)
    if not guess:
        return [], ""
    what = format_value(abs(size), position.unit, position.factor)
    statement = (
        f"`{position.channel}` in [{position.unit}]: {meaning} {what}, which no leg does: it looks like {guess}; "
        "correct the unit in its heading"
    )
    return [Finding(f"{position.channel}-unit", place, statement)], guess


def check_height(z: ScaledSeries, steps: list[Step], place: str) -> list[Finding]:
    """Return the finding on the origin of the height of the ankle."""
    curve = average_cycle(z.series, steps)[8:32]
    height = float(np.nanmedian(curve)) if np.isfinite(curve).any() else 0.0
    if HEIGHT_RANGE[0] <= height <= HEIGHT_RANGE[1]:
        return []
    statement = (
        f"`{z.channel}` of the standing foot is {round_digits(height):g} m: heights are above the ground, so an ankle "
        "stands at about 0.1 m; subtract the height of the ground (or the axis is not vertical)"
    )
    return [Finding(f"{z.channel}-zero", place, statement)]


def check_cop(
    cop: ScaledSeries, x: Series, vertical: Series, steps: list[Step], place: str
) -> tuple[list[Finding], float]:
    """Return the finding on the centre of pressure, and its progression relative to the ankle [m]; NaN if unknown."""
    force = np.interp(cop.series.time, vertical.time, np.nan_to_num(np.abs(vertical.value)))
    is_loaded = np.isfinite(cop.series.value) & (force > 0.35 * float(np.percentile(np.abs(vertical.value), 97.0)))
    ankle = np.interp(cop.series.time, x.time, x.value, left=np.nan, right=np.nan)
    is_loaded &= _is_inside(cop.series.time, steps) & np.isfinite(ankle)
    if is_loaded.sum() < 5:
        return [], np.nan
    gap = np.where(is_loaded, cop.series.value - ankle, np.nan)
    if _is_near(gap):
        return [], _measure_progression(Series(cop.series.time, gap), steps)
    name, middle = cop.channel, float(np.nanmedian(gap))
    for unit, factor in UNITS["m"].items():
        scaled = np.where(is_loaded, cop.series.value * factor / cop.factor - ankle, np.nan)
        if factor != cop.factor and _is_near(scaled):
            size = format_value(float(np.nanmedian(np.abs(gap))), cop.unit, cop.factor)
            statement = (
                f"`{name}` in [{cop.unit}] is {size} from the ankle under load: it looks like {unit}; correct the unit "
                "in its heading"
            )
            return [Finding(f"{name}-unit", place, statement)], np.nan
    if _is_near(np.where(is_loaded, -cop.series.value - ankle, np.nan)):
        statement = f"`{name}` follows the ankle only with the opposite sign: forward is positive; multiply it by -1"
        return [Finding(f"{name}-sign", place, statement)], np.nan
    if _is_near(gap - middle):
        statement = (
            f"`{name}` is {round_digits(middle):g} m from the ankle under load, up to {MAX_COP_DISTANCE:g} m is "
            f"possible: it has another origin than the ankle (such as the middle of the force plate); add "
            f"{round_digits(-middle):g} m"
        )
        return [Finding(f"{name}-origin", place, statement)], np.nan
    distance = float(np.nanpercentile(np.abs(gap), 90.0))
    statement = (
        f"`{name}` is up to {round_digits(distance):g} m from the ankle under load, up to {MAX_COP_DISTANCE:g} m is "
        "possible: it has another origin, axis, direction or unit than the ankle, or belongs to the other foot"
    )
    return [Finding(f"{name}-origin", place, statement)], np.nan


def check_progression(progression: float, channel: str, place: str) -> list[Finding]:
    """Return the finding on a centre of pressure that moves from toe to heel by ``progression`` [m]."""
    if not progression < MAX_COP_PROGRESSION:
        return []
    statement = (
        f"`{channel}` moves from the toe to the heel of the loaded foot, by {-100 * progression:.0f} cm: its direction "
        "is reversed, or the corners of the force plate are in the wrong order; correct the one that is wrong"
    )
    return [Finding(f"{channel}-sign", place, statement)]


def _is_inside(time: Array, steps: list[Step]) -> Mask:
    inside = np.zeros(len(time), dtype=np.bool_)
    for step in steps:
        inside |= (time >= step.strike) & (time <= step.toe_off)
    return inside


def _is_near(gap: Array) -> bool:
    known = np.abs(gap[np.isfinite(gap)])
    return float(np.percentile(known, 85.0)) <= MAX_COP_DISTANCE and float(np.median(known)) <= 0.4


def _measure_progression(gap: Series, steps: list[Step]) -> float:
    curve = average_cycle(gap, steps)
    early, late = curve[6:18], curve[42:56]
    if not (np.isfinite(early).any() and np.isfinite(late).any()):
        return float(np.nan)
    return float(np.nanmean(late) - np.nanmean(early))
