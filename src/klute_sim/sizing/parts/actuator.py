"""Which actuators of Table 3.1, how many and how long.

A longer actuator is the same braid: N and B grow with L0, so that force over L/L0 stays what it is.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from klute_sim.device.device import load_device
from klute_sim.device.schema.document import MuscleSection
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import Muscle
from klute_sim.sizing.choices import ACTUATOR_LABELS, MAX_ACTUATORS, DesignChoices
from klute_sim.units import BAR

MIN_TESTED_SLENDERNESS = 14.0
"""Least length over diameter of the actuators that were tested (Table 3.1)."""


@cache
def load_muscle_section(preset: str) -> MuscleSection:
    """One actuator of Table 3.1."""
    return load_device(preset).spec.muscle


def build_muscle(preset: str, count: int, resting_length: float) -> Muscle:
    """``count`` actuators of that row, cut to ``resting_length`` [m]."""
    return (
        load_muscle_section(preset)
        .model_copy(update={"count": count, "resting_length_mm": 1e3 * resting_length})
        .to_parameters()
    )


def isometric_force(muscle: Muscle, pressure: float, length_ratio: float) -> float:
    """F0 [N]: isometric force at gauge ``pressure`` [Pa] and ``ratio`` = L/L0."""
    return mckibben.force(muscle, pressure, length_ratio * muscle.resting_length)


def pressure_for_force(muscle: Muscle, force: float, length: float, max_pressure: float = 20e5) -> float:
    """Gauge pressure [Pa] at which ``muscle`` pulls with ``force`` [N] at ``length`` [m]; NaN beyond ``most``.

    By bisection, to 1 Pa. A much shortened muscle may lose force with pressure below 2 bar, where friction fades in.
    """
    if force <= mckibben.force(muscle, 0.0, length):
        return 0.0
    if force > mckibben.force(muscle, max_pressure, length):
        return math.nan
    low, high = 0.0, max_pressure
    while high - low > 1.0:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if mckibben.force(muscle, middle, length) >= force else (middle, high)
    return high


@dataclass(frozen=True)
class ActuatorRequirement:
    """What the actuators have to do."""

    force: float
    """Isometric force [N]; 0: any will do."""
    length_ratio: Callable[[float], float]
    """L0 [m] -> L/L0 at which it has to be reached."""
    resting_length: float | None = None
    """L0 [m] where it is fixed; None: the row's own, or longer where ``excursion`` asks for it."""
    excursion: float = 0.0
    """Travel of the ankle's end of the tendon [m]."""


@dataclass(frozen=True)
class ActuatorOption:
    """What one row of Table 3.1 would take."""

    actuator: str
    """Preset."""
    resting_length: float
    """L0 [m]."""
    isometric_force: float
    """F0 of one actuator [N]: at the design ratio."""
    length_ratio: float
    """L/L0 at which the force is needed."""
    available_force: float
    """Force of one actuator there [N]."""
    count: int
    """How many reach the force; those that were asked for, where a count is fixed."""
    gas_volume: float
    """Gas in all of them at the design ratio [m3]."""
    slenderness: float
    """Length over diameter [1]."""
    is_sufficient: bool
    """Whether that many reach the force."""

    @property
    def total_force(self) -> float:
        """F0 of all of them [N]."""
        return self.count * self.isometric_force


def select_actuators(
    requirement: ActuatorRequirement, choices: DesignChoices
) -> tuple[ActuatorOption, list[ActuatorOption]]:
    """The actuators to take, and what every row would have taken, the preferred one first.

    Preferred (assumed): enough force, then fewest actuators, then least gas. Where a count is fixed and no row is
    strong enough, the strongest is taken; where none is fixed, InputError is raised.
    """
    found = [_evaluate_option(preset, requirement, choices) for preset in ACTUATOR_LABELS]
    found.sort(key=lambda o: (not o.is_sufficient, o.count, o.gas_volume))
    if choices.actuator is not None:
        return next(o for o in found if o.actuator == choices.actuator), found
    if found[0].is_sufficient:
        return found[0], found
    if choices.count is None:
        raise InputError(
            f"no actuator of Table 3.1 reaches {requirement.force:.0f} N with {MAX_ACTUATORS} in parallel at "
            f"{choices.supply_pressure / BAR:g} bar"
        )
    return max(found, key=lambda o: o.available_force), found


def _evaluate_option(preset: str, requirement: ActuatorRequirement, choices: DesignChoices) -> ActuatorOption:
    own, assumed, pressure = (
        load_muscle_section(preset).get_si("resting_length_mm"),
        choices.assumptions,
        choices.supply_pressure,
    )
    # Rounded up to a whole millimetre: nobody cuts a muscle finer.
    stretched = math.ceil(1e3 * requirement.excursion / assumed.excursion_fraction - 1e-9) * 1e-3
    resting = max(own, stretched) if requirement.resting_length is None else requirement.resting_length
    one, ratio = build_muscle(preset, 1, resting), requirement.length_ratio(resting)
    strength = isometric_force(one, pressure, ratio)
    enough = math.ceil(requirement.force / strength - 1e-9) if strength > 0.0 else MAX_ACTUATORS + 1
    count = min(max(1, enough), MAX_ACTUATORS) if choices.count is None else choices.count
    return ActuatorOption(
        actuator=preset,
        resting_length=resting,
        isometric_force=isometric_force(one, pressure, assumed.design_ratio),
        length_ratio=ratio,
        available_force=strength,
        count=count,
        gas_volume=count * mckibben.volume(one, assumed.design_ratio * resting),
        slenderness=resting / (2.0 * one.bladder_radius),
        is_sufficient=enough <= count,
    )
