"""Chapter 3: the static McKibben actuator, from the geometric model to the model with friction.

:mod:`klute_sim.reproduction.chapters.chapter3_dynamic` has the actuator in motion.
"""

import math

import numpy as np
from scipy.optimize import brentq

from klute_sim.device.device import Device, load_device
from klute_sim.device.dynamics import advance_state
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.laws import hill, mckibben, pneumatics
from klute_sim.laws import hill_tables as tables
from klute_sim.laws.hill import DESIGN_ENVELOPE
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.reproduction import printed
from klute_sim.reproduction.curves import ChapterResult, FigureData, PlotLine
from klute_sim.reproduction.item import Outcome
from klute_sim.sizing.evaluation.isometric import fit_parabola
from klute_sim.types import Array
from klute_sim.units import BAR

PRESETS = ("klute-1-1-4", "klute-3-4", "klute-1-2")
"""Actuator presets of Table 3.1."""
PRESSURES_BAR = (2.0, 3.0, 4.0, 5.0)
"""Gauge pressures of the figures [bar]."""
LENGTH_RATIOS = np.linspace(0.6, 1.0, 161)
"""Muscle length over resting length, the abscissa of Figs. 3.4 and 3.5."""
FIT_LENGTH_RATIOS = np.linspace(0.65, 1.0, 141)
"""Length ratios of the parabola fit (assumed: the curve ends at the lock length, near 0.61)."""
COMMON_LENGTH_RATIOS = np.linspace(0.75, 1.0, 51)
"""Length ratios that occur in both muscles and actuator."""


def without_bladder_and_friction(muscle: MuscleParameters) -> MuscleParameters:
    """Return ``muscle`` without bladder and friction."""
    return without_friction(muscle)._replace(c10=0.0, c01=0.0)


def without_friction(muscle: MuscleParameters) -> MuscleParameters:
    """Return ``muscle`` without friction."""
    return muscle._replace(friction_slope=0.0, friction_offset=0.0)


def force_at_ratios(muscle: MuscleParameters, pressure: float, length_ratios: Array = LENGTH_RATIOS) -> Array:
    """Return the force [N] at gauge ``pressure`` [bar] over ratios of muscle length to resting length."""
    return np.array([mckibben.force(muscle, pressure * BAR, r * muscle.resting_length) for r in length_ratios])


def compute() -> ChapterResult:
    """Return the static findings and figures of chapter 3."""
    findings: dict[str, Outcome] = {}
    for name in PRESETS:
        _add_actuator(findings, load_device(name), name.removeprefix("klute-"))
    findings["table-3.1.c10"] = Outcome(1e-3 * load_device("klute-3-4").parameters.muscle.c10)
    findings["table-3.1.c01"] = Outcome(1e-3 * load_device("klute-3-4").parameters.muscle.c01)
    slenderness = {name: _slenderness(load_device(name)) for name in PRESETS}
    slenderness_text = ", ".join(
        f"{name.removeprefix('klute-')} in: {value:.1f}" for name, value in slenderness.items()
    )
    findings["table-3.1.slender"] = Outcome(min(slenderness.values()), True, f"L0/(2 R0): {slenderness_text}.")
    _add_vessel(findings)
    _add_overestimates(findings)
    muscle_3_4 = load_device("klute-3-4").parameters.muscle
    for pressure in PRESSURES_BAR:
        muscle_1_1_4 = load_device("klute-1-1-4").parameters.muscle
        findings[f"fig-3.5.force-{pressure:g}"] = Outcome(
            float(force_at_ratios(muscle_1_1_4, pressure, np.array([0.96]))[0])
        )
    _add_parabola(findings, muscle_3_4)
    findings["fig-3.3.ratio"] = Outcome()
    findings["fig-3.5.fit"] = Outcome()
    findings["fig-3.6.stop"] = check_stop(load_device("klute-3-4-pair"))
    findings["fig-3.7.rest"] = Outcome(1e3 * muscle_3_4.resting_length)
    pair = load_device("klute-3-4-pair").parameters.muscle
    findings["fig-3.8.rest"] = Outcome(1e3 * pair.resting_length)
    ratios = [
        force_at_ratios(pair, p, COMMON_LENGTH_RATIOS) / force_at_ratios(muscle_3_4, p, COMMON_LENGTH_RATIOS)
        for p in PRESSURES_BAR
    ]
    findings["fig-3.8.twice"] = Outcome(float(np.ravel(ratios)[np.argmax(np.abs(np.ravel(ratios) - 2.0))]))
    return ChapterResult(findings, tuple(_build_figures()))


def _add_actuator(findings: dict[str, Outcome], device: Device, size: str) -> None:
    """Add the constants of one actuator, recovered from its law where possible."""
    muscle, resting_length = device.parameters.muscle, device.parameters.muscle.resting_length
    lock_length = brentq(
        lambda length: mckibben.gas_force(muscle, BAR, length), 0.4 * resting_length, resting_length, xtol=1e-12
    )
    braid_length = math.sqrt(3.0) * lock_length
    volume = mckibben.braid_volume(muscle, 0.8 * resting_length)
    turns = math.sqrt(0.8 * resting_length * (braid_length**2 - (0.8 * resting_length) ** 2) / (4.0 * math.pi * volume))
    friction = [-mckibben.friction_force(muscle, pressure * BAR) for pressure in PRESSURES_BAR]
    slope, offset = np.polyfit(PRESSURES_BAR, friction, 1)
    if offset > 100.0:
        findings[f"table-3.1.{size}.empty"] = Outcome(float(offset))
    elif offset < 0.0:
        findings[f"table-3.1.{size}.turns-round"] = Outcome(float(-offset / slope))
    values = {
        "turns": turns,
        "l0": 1e3 * resting_length,
        "braid": 1e3 * braid_length,
        "r0": 1e3 * muscle.bladder_radius,
        "t0": 1e3 * muscle.bladder_thickness,
        "m": float(slope),
        "b": float(offset),
        "radius": 1e3 * math.sqrt(braid_length**2 - resting_length**2) / (2.0 * math.pi * turns),
    }
    findings.update({f"table-3.1.{size}.{key}": Outcome(value) for key, value in values.items()})


def _slenderness(device: Device) -> float:
    muscle = device.parameters.muscle
    return 0.5 * muscle.resting_length / muscle.bladder_radius


def _add_vessel(findings: dict[str, Outcome]) -> None:
    muscle = load_device("klute-1-1-4").parameters.muscle
    max_volume = mckibben.gas_volume(muscle, mckibben.lock_length(muscle))
    change = (max_volume - mckibben.gas_volume(muscle, muscle.resting_length)) / (
        printed.get_published_numbers()["fig-3.3.ratio"] * max_volume
    )
    pressure = 5.0 * BAR + pneumatics.ATMOSPHERIC_PRESSURE
    findings["fig-3.3.vessel"] = Outcome(
        1e3 * pressure * change / BAR, note="Isothermal, at 5 bar, from resting length to lock: 1-1/4 in actuator."
    )
    findings["fig-3.3.highest"] = Outcome(
        max(load_device(name).parameters.supply.max_pressure for name in PRESETS) / BAR
    )


def _add_overestimates(findings: dict[str, Outcome]) -> None:
    """Add the overestimates of the models without friction; Table 3.1's friction replaces the lost measurements."""
    muscle = load_device("klute-1-1-4").parameters.muscle
    geometric, frictionless = (
        force_at_ratios(model(muscle), 5.0) for model in (without_bladder_and_friction, without_friction)
    )
    measured = force_at_ratios(muscle, 5.0)
    substitution_note = "Measured values are lost; the model with the friction of Table 3.1 replaces them."
    findings["fig-3.4.geometric"] = Outcome(
        float(np.mean(geometric - measured)), note=f"Mean over 0.6-1 of resting length. {substitution_note}"
    )
    findings["fig-3.4.bladder"] = Outcome(
        float(np.mean(frictionless - measured)), note=f"The same at every length. {substitution_note}"
    )
    difference = geometric - frictionless
    findings["fig-3.4.difference"] = Outcome(float(np.mean(difference)), note="Mean over 0.6-1 of resting length.")
    findings["fig-3.4.everywhere"] = Outcome(
        float(difference.min() / np.mean(difference)),
        True,
        f"Geometric less bladder model: {difference.max():.0f} N at most, "
        f"{abs(difference[-1]):.0f} N at resting length.",
    )
    friction = {p: -mckibben.friction_force(muscle, p * BAR) for p in PRESSURES_BAR}
    ratios = {p: (friction[p] / friction[5.0]) / (p / 5.0) for p in PRESSURES_BAR[:-1]}
    friction_text = ", ".join(f"{friction[p]:.0f} N at {p:g} bar" for p in PRESSURES_BAR)
    findings["fig-3.4.proportional"] = Outcome(
        max(ratios.values()),
        True,
        f"Bladder model less friction model: {friction_text}.",
    )


def _add_parabola(findings: dict[str, Outcome], muscle: MuscleParameters) -> None:
    """Add the comparison of the actuator with (2.5a-c): constants of (2.3) fitted to its curve, relative to F0."""
    for letter, key, value in zip("abc", ("k5", "k6", "k7"), fit_parabola(muscle, 5.0 * BAR), strict=True):
        interval = getattr(DESIGN_ENVELOPE, key)
        findings[f"fig-3.6.2.5{letter}"] = Outcome(
            float(value),
            hill.is_in_interval(interval, float(value)),
            f"{key} of a parabola through the 3/4 in actuator's curve at 5 bar; required: {interval.lower:g} to "
            f"{interval.upper:g}.",
        )
    findings["fig-3.6.first-order"] = check_first_order(relative_force_over_length(muscle))


def relative_force_over_length(muscle: MuscleParameters) -> Array:
    """Return the force at 5 bar over that at resting length, at :data:`COMMON_LENGTH_RATIOS`."""
    force = force_at_ratios(muscle, 5.0, COMMON_LENGTH_RATIOS)
    return np.asarray(force / force[-1])


def check_first_order(relative_force: Array) -> Outcome:
    """Return whether the actuator's force over length has the slope of a muscle, to first order.

    ``relative_force`` is the force over that at resting length at :data:`COMMON_LENGTH_RATIOS`.
    """
    laws = [tables.CONTRACTILE_ELEMENTS[name].constants for name in ("rat", "cat", "frog", "human")]
    muscles = [[max(0.0, hill.isometric_force(law, x)) for x in COMMON_LENGTH_RATIOS] for law in laws]
    slopes = [float(np.polyfit(COMMON_LENGTH_RATIOS, force, 1)[0]) for force in muscles]
    deviations = [float(np.sqrt(np.mean((relative_force - np.array(muscle)) ** 2))) for muscle in muscles]
    slope = float(np.polyfit(COMMON_LENGTH_RATIOS, relative_force, 1)[0])
    return Outcome(
        slope,
        min(slopes) <= slope <= max(slopes),
        f"Muscles have {min(slopes):.2f} to {max(slopes):.2f}. The curve's rms distance is {min(deviations):.2f} F0 "
        f"from the nearest muscle and {max(deviations):.2f} F0 from the farthest.",
    )


def check_stop(device: Device) -> Outcome:
    """Pull a unit 20 mm beyond the resting length of its muscle and return whether the muscle stays at its stop."""
    parameters, resting_length = device.parameters, device.parameters.muscle.resting_length
    unit_length = resting_length + parameters.tendon.slack_length + 0.02
    state = compute_taut_state(parameters, unit_length - 0.02, 5.0 * BAR)
    for k in range(2000):
        state = advance_state(parameters, state, unit_length - 0.02 + 1e-5 * k, 5.0 * BAR, 1e-3)
    return Outcome(state.length / resting_length, True, "Over resting length, at 10 mm/s, 20 mm beyond.")


def _build_figures() -> list[FigureData]:
    muscle_1_1_4, muscle_3_4 = load_device("klute-1-1-4").parameters.muscle, load_device("klute-3-4").parameters.muscle
    models = (
        ("geometric", without_bladder_and_friction(muscle_1_1_4)),
        ("with bladder", without_friction(muscle_1_1_4)),
        ("with bladder and friction", muscle_1_1_4),
    )
    resting_force = float(force_at_ratios(muscle_3_4, 5.0, np.array([1.0]))[0])
    length_ratios = np.linspace(0.6, 1.4, 161)
    muscles = [(name, tables.CONTRACTILE_ELEMENTS[name].constants) for name in ("rat", "cat", "frog", "human")]
    return [
        FigureData(
            "3.4",
            "1-1/4 in actuator at 5 bar: the models",
            "λ1 = L/L0",
            "force [N]",
            tuple(PlotLine(name, LENGTH_RATIOS, force_at_ratios(muscle, 5.0)) for name, muscle in models),
            (0.6, 1.0),
            (0.0, 2500.0),
            assumption_note="the measured curve is lost and not drawn",
        ),
        FigureData(
            "3.5",
            "1-1/4 in actuator: the model with friction at 2 to 5 bar",
            "λ1 = L/L0",
            "force [N]",
            tuple(
                PlotLine(f"{p:g} bar", LENGTH_RATIOS, force_at_ratios(muscle_1_1_4, p), ordered_value=p)
                for p in PRESSURES_BAR
            ),
            (0.6, 1.0),
            (0.0, 2000.0),
            assumption_note="the measured curves are lost and not drawn",
        ),
        FigureData(
            "3.6",
            "Isometric force of muscles and of the 3/4 in actuator at 5 bar",
            "l/l0",
            "F/F0",
            (
                *(
                    PlotLine(
                        name, length_ratios, np.array([hill.isometric_force(law, x) for x in length_ratios]), "dashed"
                    )
                    for name, law in muscles
                ),
                PlotLine(
                    "McKibben, 5 bar",
                    FIT_LENGTH_RATIOS,
                    force_at_ratios(muscle_3_4, 5.0, FIT_LENGTH_RATIOS) / resting_force,
                ),
            ),
            (0.6, 1.4),
            (0.0, 1.2),
            assumption_note="F0 of the actuator is its force at resting length",
        ),
    ]
