"""Which actuators of Table 3.1, how many and how long.

A longer actuator is the same braid: N and B grow with L0, so that force over L/L0 stays what it is.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from klute_sim.design.choices import MOST_ACTUATORS, ROWS, Choices
from klute_sim.device.files import load
from klute_sim.device.schema import MuscleSection
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import Muscle
from klute_sim.units import BAR

SLENDER = 14.0
"""Least length over diameter of the actuators that were tested (Table 3.1)."""


@cache
def row(preset: str) -> MuscleSection:
    """One actuator of Table 3.1."""
    return load(preset).spec.muscle


def muscle(preset: str, count: int, resting_length: float) -> Muscle:
    """``count`` actuators of that row, cut to ``resting_length`` [m]."""
    return row(preset).model_copy(update={"count": count, "resting_length_mm": 1e3 * resting_length}).parameters()


def isometric_force(muscle: Muscle, pressure: float, ratio: float) -> float:
    """F0 [N]: isometric force at gauge ``pressure`` [Pa] and ``ratio`` = L/L0."""
    return mckibben.force(muscle, pressure, ratio * muscle.resting_length)


def pressure_for(muscle: Muscle, force: float, length: float, most: float = 20e5) -> float:
    """Gauge pressure [Pa] at which ``muscle`` pulls with ``force`` [N] at ``length`` [m]; NaN beyond ``most``.

    By bisection, to 1 Pa. A much shortened muscle may lose force with pressure below 2 bar, where friction fades in.
    """
    if force <= mckibben.force(muscle, 0.0, length):
        return 0.0
    if force > mckibben.force(muscle, most, length):
        return math.nan
    low, high = 0.0, most
    while high - low > 1.0:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if mckibben.force(muscle, middle, length) >= force else (middle, high)
    return high


@dataclass(frozen=True)
class Need:
    """What the actuators have to do."""

    force: float
    """Isometric force [N]; 0: any will do."""
    ratio: Callable[[float], float]
    """L0 [m] -> L/L0 at which it has to be reached."""
    length: float | None = None
    """L0 [m] where it is fixed; None: the row's own, or longer where ``excursion`` asks for it."""
    excursion: float = 0.0
    """Travel of the ankle's end of the tendon [m]."""


@dataclass(frozen=True)
class Option:
    """What one row of Table 3.1 would take."""

    actuator: str
    """Preset."""
    resting_length: float
    """L0 [m]."""
    force: float
    """F0 of one actuator [N]: at the design ratio."""
    ratio: float
    """L/L0 at which the force is needed."""
    strength: float
    """Force of one actuator there [N]."""
    count: int
    """How many reach the force; those that were asked for, where a count is fixed."""
    volume: float
    """Gas in all of them at the design ratio [m3]."""
    slenderness: float
    """Length over diameter [1]."""
    sufficient: bool
    """Whether that many reach the force."""

    @property
    def total(self) -> float:
        """F0 of all of them [N]."""
        return self.count * self.force


def choose(need: Need, choices: Choices) -> tuple[Option, list[Option]]:
    """The actuators to take, and what every row would have taken, the preferred one first.

    Preferred (assumed): enough force, then fewest actuators, then least gas. Where a count is fixed and no row is
    strong enough, the strongest is taken; where none is fixed, InputError is raised.
    """
    found = [_option(preset, need, choices) for preset in ROWS]
    found.sort(key=lambda o: (not o.sufficient, o.count, o.volume))
    if choices.actuator is not None:
        return next(o for o in found if o.actuator == choices.actuator), found
    if found[0].sufficient:
        return found[0], found
    if choices.count is None:
        raise InputError(
            f"no actuator of Table 3.1 reaches {need.force:.0f} N with {MOST_ACTUATORS} in parallel at "
            f"{choices.supply_pressure / BAR:g} bar"
        )
    return max(found, key=lambda o: o.strength), found


def _option(preset: str, need: Need, choices: Choices) -> Option:
    own, assumed, pressure = row(preset).si("resting_length_mm"), choices.assumptions, choices.supply_pressure
    # Rounded up to a whole millimetre: nobody cuts a muscle finer.
    stretched = math.ceil(1e3 * need.excursion / assumed.excursion_share - 1e-9) * 1e-3
    resting = max(own, stretched) if need.length is None else need.length
    one, ratio = muscle(preset, 1, resting), need.ratio(resting)
    strength = isometric_force(one, pressure, ratio)
    enough = math.ceil(need.force / strength - 1e-9) if strength > 0.0 else MOST_ACTUATORS + 1
    count = min(max(1, enough), MOST_ACTUATORS) if choices.count is None else choices.count
    return Option(
        actuator=preset,
        resting_length=resting,
        force=isometric_force(one, pressure, assumed.design_ratio),
        ratio=ratio,
        strength=strength,
        count=count,
        volume=count * mckibben.volume(one, assumed.design_ratio * resting),
        slenderness=resting / (2.0 * one.bladder_radius),
        sufficient=enough <= count,
    )
