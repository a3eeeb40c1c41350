"""Selection of the actuator of Table 3.1, the number of actuators and their resting length.

A longer actuator has the same braid: N and B grow in proportion to L0, so force over L/L0 does not change.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from klute_sim.device.device import load_device
from klute_sim.device.schema.muscle import Muscle
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.sizing.choices import ACTUATOR_LABELS, MAX_ACTUATORS, DesignChoices
from klute_sim.units import BAR

MIN_TESTED_SLENDERNESS = 14.0
"""Smallest ratio of length to diameter among the tested actuators (Table 3.1)."""


@cache
def load_muscle_section(preset: str) -> Muscle:
    """Return the muscle section of an actuator preset of Table 3.1."""
    muscle = load_device(preset).spec.muscle
    assert muscle is not None, f"preset {preset} is an actuator"
    return muscle


def build_muscle(preset: str, count: int, resting_length: float) -> MuscleParameters:
    """Return ``count`` parallel actuators of a preset, cut to ``resting_length`` [m]."""
    return (
        load_muscle_section(preset)
        .model_copy(update={"count": count, "resting_length_mm": 1e3 * resting_length})
        .to_parameters()
    )


def compute_isometric_force(muscle: MuscleParameters, pressure: float, length_ratio: float) -> float:
    """Return the isometric force [N] at gauge ``pressure`` [Pa] and ``length_ratio`` L/L0."""
    return mckibben.force(muscle, pressure, length_ratio * muscle.resting_length)


def compute_required_pressure(
    muscle: MuscleParameters, force: float, length: float, max_pressure: float = 20e5
) -> float:
    """Return the gauge pressure [Pa] at which ``muscle`` pulls with ``force`` [N] at ``length`` [m], to 1 Pa by
    bisection.

    Return NaN above ``max_pressure``. Below 2 bar, where friction fades in, the force of a strongly shortened muscle
    may fall with pressure.
    """
    if force <= mckibben.force(muscle, 0.0, length):
        return 0.0
    if force > mckibben.force(muscle, max_pressure, length):
        return math.nan
    low, high = 0.0, max_pressure
    while high - low > 1.0:
        midpoint = 0.5 * (low + high)
        low, high = (low, midpoint) if mckibben.force(muscle, midpoint, length) >= force else (midpoint, high)
    return high


@dataclass(frozen=True)
class ActuatorRequirement:
    """Force, length and travel that the actuators must provide."""

    force: float
    """Required isometric force [N]; 0 accepts any actuator."""
    length_ratio: Callable[[float], float]
    """Function of L0 [m] that returns the ratio L/L0 at which the force is required."""
    resting_length: float | None = None
    """Fixed resting length L0 [m]; None takes that of the preset, or a longer one where the excursion requires it."""
    excursion: float = 0.0
    """Travel of the ankle end of the tendon [m]."""


@dataclass(frozen=True)
class ActuatorOption:
    """One actuator of Table 3.1 with the number of units that the requirement needs."""

    actuator: str
    """Name of the preset."""
    resting_length: float
    """Resting length L0 [m]."""
    isometric_force: float
    """Isometric force F0 of one actuator at the design ratio [N]."""
    length_ratio: float
    """Ratio L/L0 at which the force is required."""
    available_force: float
    """Isometric force of one actuator at that ratio [N]."""
    count: int
    """Number of actuators that reach the force; the chosen number where the user fixed it."""
    gas_volume: float
    """Gas volume of all actuators at the design ratio [m3]."""
    slenderness: float
    """Length over diameter [1]."""
    is_sufficient: bool
    """Whether this number of actuators reaches the required force."""

    @property
    def total_force(self) -> float:
        """Return F0 of all actuators together [N]."""
        return self.count * self.isometric_force


def select_actuators(
    requirement: ActuatorRequirement, choices: DesignChoices
) -> tuple[ActuatorOption, list[ActuatorOption]]:
    """Return the selected option and the options of all presets in order of preference.

    Order of preference (assumed): sufficient force, fewest actuators, smallest gas volume. With a fixed count and no
    sufficient preset, the strongest preset is selected. Raises InputError when the count is free and no preset is
    sufficient.
    """
    options = [_evaluate_option(preset, requirement, choices) for preset in ACTUATOR_LABELS]
    options.sort(key=lambda o: (not o.is_sufficient, o.count, o.gas_volume))
    if choices.actuator is not None:
        return next(o for o in options if o.actuator == choices.actuator), options
    if options[0].is_sufficient:
        return options[0], options
    if choices.count is None:
        raise InputError(
            f"no actuator of Table 3.1 reaches {requirement.force:.0f} N with {MAX_ACTUATORS} in parallel at "
            f"{choices.supply_pressure / BAR:g} bar"
        )
    return max(options, key=lambda o: o.available_force), options


def _evaluate_option(preset: str, requirement: ActuatorRequirement, choices: DesignChoices) -> ActuatorOption:
    assumptions, pressure = choices.assumptions, choices.supply_pressure
    preset_length = load_muscle_section(preset).get_si("resting_length_mm")
    # Actuators are cut to whole millimetres.
    min_length = math.ceil(1e3 * requirement.excursion / assumptions.excursion_fraction - 1e-9) * 1e-3
    resting_length = (
        max(preset_length, min_length) if requirement.resting_length is None else requirement.resting_length
    )
    muscle, ratio = build_muscle(preset, 1, resting_length), requirement.length_ratio(resting_length)
    available_force = compute_isometric_force(muscle, pressure, ratio)
    required_count = (
        math.ceil(requirement.force / available_force - 1e-9) if available_force > 0.0 else MAX_ACTUATORS + 1
    )
    count = min(max(1, required_count), MAX_ACTUATORS) if choices.count is None else choices.count
    return ActuatorOption(
        actuator=preset,
        resting_length=resting_length,
        isometric_force=compute_isometric_force(muscle, pressure, assumptions.design_ratio),
        length_ratio=ratio,
        available_force=available_force,
        count=count,
        gas_volume=count * mckibben.gas_volume(muscle, assumptions.design_ratio * resting_length),
        slenderness=resting_length / (2.0 * muscle.bladder_radius),
        is_sufficient=required_count <= count,
    )
