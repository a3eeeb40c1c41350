"""Chapter 3: the McKibben actuator, from the geometric model to the one with friction, at rest.

What moves is in :mod:`klute_sim.reproduction.chapters.chapter3_dynamic`.
"""

import math

import numpy as np
from scipy.optimize import brentq

from klute_sim.device.device import Device, load_device
from klute_sim.device.dynamics import advance_state, compute_taut_state
from klute_sim.laws import hill, mckibben, pneumatics
from klute_sim.laws import hill_tables as tables
from klute_sim.laws.hill import DESIGN_ENVELOPE
from klute_sim.laws.mckibben import Muscle
from klute_sim.reproduction import printed
from klute_sim.reproduction.curves import Array, ChapterResult, FigureData, PlotLine
from klute_sim.reproduction.implied_values import MAX_PROPORTIONAL_RATIO
from klute_sim.reproduction.item import Finding
from klute_sim.sizing.evaluation.isometric import fit_parabola
from klute_sim.units import BAR

PRESETS = ("klute-1-1-4", "klute-3-4", "klute-1-2")
"""Presets of Table 3.1."""
PRESSURES_BAR = (2.0, 3.0, 4.0, 5.0)
"""[bar]"""
LENGTH_RATIOS = np.linspace(0.6, 1.0, 161)
"""Muscle length over resting length, the abscissa of Figs. 3.4 and 3.5."""
FIT_LENGTH_RATIOS = np.linspace(0.65, 1.0, 141)
"""Ratios over which the actuator's parabola is fitted (assumed: its curve ends at the lock length, near 0.61)."""
COMMON_LENGTH_RATIOS = np.linspace(0.75, 1.0, 51)
"""Lengths over resting length that muscles and actuator have in common."""
MIN_SLENDERNESS = 14.0
"""Length over diameter that the text gives."""


def without_bladder_and_friction(muscle: Muscle) -> Muscle:
    """``muscle`` without bladder and friction."""
    return without_friction(muscle)._replace(c10=0.0, c01=0.0)


def without_friction(muscle: Muscle) -> Muscle:
    """``muscle`` without friction."""
    return muscle._replace(friction_slope=0.0, friction_offset=0.0)


def force_at_ratios(muscle: Muscle, pressure: float, length_ratios: Array = LENGTH_RATIOS) -> Array:
    """Force [N] at gauge ``pressure`` [bar] over muscle length over resting length."""
    return np.array([mckibben.force(muscle, pressure * BAR, r * muscle.resting_length) for r in length_ratios])


def compute() -> ChapterResult:
    """Everything of chapter 3 that stands still."""
    found: dict[str, Finding] = {}
    for name in PRESETS:
        _add_actuator(found, load_device(name), name.removeprefix("klute-"))
    found["table-3.1.c10"] = Finding(1e-3 * load_device("klute-3-4").parameters.muscle.c10)
    found["table-3.1.c01"] = Finding(1e-3 * load_device("klute-3-4").parameters.muscle.c01)
    slender = {name: _slenderness(load_device(name)) for name in PRESETS}
    told = ", ".join(f"{name.removeprefix('klute-')} in: {value:.1f}" for name, value in slender.items())
    found["table-3.1.slender"] = Finding(
        min(slender.values()), min(slender.values()) >= MIN_SLENDERNESS, f"L0/(2 R0): {told}."
    )
    _add_vessel(found)
    _add_overestimates(found)
    one = load_device("klute-3-4").parameters.muscle
    for pressure in PRESSURES_BAR:
        big = load_device("klute-1-1-4").parameters.muscle
        found[f"fig-3.5.force-{pressure:g}"] = Finding(float(force_at_ratios(big, pressure, np.array([0.96]))[0]))
    _add_parabola(found, one)
    found["fig-3.3.ratio"] = Finding()
    found["fig-3.5.fit"] = Finding()
    found["fig-3.6.stop"] = check_stop(load_device("klute-3-4-pair"))
    found["fig-3.7.rest"] = Finding(1e3 * one.resting_length)
    pair = load_device("klute-3-4-pair").parameters.muscle
    found["fig-3.8.rest"] = Finding(1e3 * pair.resting_length)
    ratios = [
        force_at_ratios(pair, p, COMMON_LENGTH_RATIOS) / force_at_ratios(one, p, COMMON_LENGTH_RATIOS)
        for p in PRESSURES_BAR
    ]
    found["fig-3.8.twice"] = Finding(float(np.ravel(ratios)[np.argmax(np.abs(np.ravel(ratios) - 2.0))]))
    return ChapterResult(found, tuple(_build_figures()))


def _add_actuator(findings: dict[str, Finding], device: Device, size: str) -> None:
    """One actuator's constants, recovered from what its law does where it can be."""
    muscle, rest = device.parameters.muscle, device.parameters.muscle.resting_length
    lock = brentq(lambda length: mckibben.gas_force(muscle, BAR, length), 0.4 * rest, rest, xtol=1e-12)
    braid = math.sqrt(3.0) * lock
    volume = mckibben.volume(muscle, 0.8 * rest)
    turns = math.sqrt(0.8 * rest * (braid**2 - (0.8 * rest) ** 2) / (4.0 * math.pi * volume))
    friction = [-mckibben.friction_force(muscle, pressure * BAR) for pressure in PRESSURES_BAR]
    slope, offset = np.polyfit(PRESSURES_BAR, friction, 1)
    if offset > 100.0:
        findings[f"table-3.1.{size}.empty"] = Finding(float(offset))
    elif offset < 0.0:
        findings[f"table-3.1.{size}.turns-round"] = Finding(float(-offset / slope))
    values = {
        "turns": turns,
        "l0": 1e3 * rest,
        "braid": 1e3 * braid,
        "r0": 1e3 * muscle.bladder_radius,
        "t0": 1e3 * muscle.bladder_thickness,
        "m": float(slope),
        "b": float(offset),
        "radius": 1e3 * math.sqrt(braid**2 - rest**2) / (2.0 * math.pi * turns),
    }
    findings.update({f"table-3.1.{size}.{key}": Finding(value) for key, value in values.items()})


def _slenderness(device: Device) -> float:
    muscle = device.parameters.muscle
    return 0.5 * muscle.resting_length / muscle.bladder_radius


def _add_vessel(findings: dict[str, Finding]) -> None:
    muscle = load_device("klute-1-1-4").parameters.muscle
    most = mckibben.volume(muscle, mckibben.lock_length(muscle))
    change = (most - mckibben.volume(muscle, muscle.resting_length)) / (
        printed.published_numbers()["fig-3.3.ratio"] * most
    )
    pressure = 5.0 * BAR + pneumatics.ATMOSPHERIC_PRESSURE
    findings["fig-3.3.vessel"] = Finding(
        1e3 * pressure * change / BAR, note="Isothermal, at 5 bar, from resting length to lock: 1-1/4 in actuator."
    )
    findings["fig-3.3.highest"] = Finding(
        max(load_device(name).parameters.supply.max_pressure for name in PRESETS) / BAR
    )


def _add_overestimates(findings: dict[str, Finding]) -> None:
    """How much too high the models without friction are, with Table 3.1's friction for the lost measurement."""
    muscle = load_device("klute-1-1-4").parameters.muscle
    plain, rubber = (force_at_ratios(model(muscle), 5.0) for model in (without_bladder_and_friction, without_friction))
    measured = force_at_ratios(muscle, 5.0)
    stands = "Measured values are lost; the model with Table 3.1's own friction stands for them."
    findings["fig-3.4.geometric"] = Finding(
        float(np.mean(plain - measured)), note=f"Mean over 0.6-1 of resting length. {stands}"
    )
    findings["fig-3.4.bladder"] = Finding(float(np.mean(rubber - measured)), note=f"The same at every length. {stands}")
    apart = plain - rubber
    findings["fig-3.4.difference"] = Finding(float(np.mean(apart)), note="Mean over 0.6-1 of resting length.")
    findings["fig-3.4.everywhere"] = Finding(
        float(apart[-1]),
        bool(apart.min() > 0.5 * np.mean(apart)),
        f"Geometric less bladder model: {apart.max():.0f} N at most, {abs(apart[-1]):.0f} N at resting length.",
    )
    high = {p: -mckibben.friction_force(muscle, p * BAR) for p in PRESSURES_BAR}
    ratios = {p: (high[p] / high[5.0]) / (p / 5.0) for p in PRESSURES_BAR[:-1]}
    told = ", ".join(f"{high[p]:.0f} N at {p:g} bar" for p in PRESSURES_BAR)
    findings["fig-3.4.proportional"] = Finding(
        max(ratios.values()),
        max(ratios.values()) <= MAX_PROPORTIONAL_RATIO,
        f"Bladder model less friction model: {told}.",
    )


def _add_parabola(findings: dict[str, Finding], muscle: Muscle) -> None:
    """Whether the actuator meets (2.5a-c): the constants of (2.3) from its own curve, over F0 at resting length."""
    for letter, key, value in zip("abc", ("k5", "k6", "k7"), fit_parabola(muscle, 5.0 * BAR), strict=True):
        span = getattr(DESIGN_ENVELOPE, key)
        findings[f"fig-3.6.2.5{letter}"] = Finding(
            float(value),
            hill.is_in_interval(span, float(value)),
            f"{key} of a parabola through the 3/4 in actuator's curve at 5 bar; asked for are {span.low:g} to "
            f"{span.high:g}.",
        )
    findings["fig-3.6.first-order"] = check_first_order(relative_force_over_length(muscle))


def relative_force_over_length(muscle: Muscle) -> Array:
    """Force at 5 bar over that at resting length, over :data:`SHARED`."""
    force = force_at_ratios(muscle, 5.0, COMMON_LENGTH_RATIOS)
    return np.asarray(force / force[-1])


def check_first_order(relative_force: Array) -> Finding:
    """Whether the line through an ``actuator``'s force over :data:`SHARED` is as steep as one through a muscle's."""
    laws = [tables.CONTRACTILE_ELEMENTS[name].constants for name in ("rat", "cat", "frog", "human")]
    muscles = [[max(0.0, hill.isometric_force(law, x)) for x in COMMON_LENGTH_RATIOS] for law in laws]
    slopes = [float(np.polyfit(COMMON_LENGTH_RATIOS, force, 1)[0]) for force in muscles]
    own = float(np.polyfit(COMMON_LENGTH_RATIOS, relative_force, 1)[0])
    return Finding(
        own,
        min(slopes) <= own <= max(slopes),
        f"Slope of force over length from 0.75 to 1 of resting length, by F0 and l0; muscles have {min(slopes):.2f} to "
        f"{max(slopes):.2f}, which is taken for first order. The shape is another matter: see (2.5).",
    )


def check_stop(device: Device) -> Finding:
    """Pull a unit far beyond its muscle's resting length: the muscle must not follow."""
    parameters, rest = device.parameters, device.parameters.muscle.resting_length
    unit = rest + parameters.tendon.slack_length + 0.02
    state = compute_taut_state(parameters, unit - 0.02, 5.0 * BAR)
    for k in range(2000):
        state = advance_state(parameters, state, unit - 0.02 + 1e-5 * k, 5.0 * BAR, 1e-3)
    return Finding(state.length / rest, state.length <= rest, "Over resting length, at 10 mm/s, 20 mm beyond.")


def _build_figures() -> list[FigureData]:
    big, one = load_device("klute-1-1-4").parameters.muscle, load_device("klute-3-4").parameters.muscle
    ladder = (
        ("geometric", without_bladder_and_friction(big)),
        ("with bladder", without_friction(big)),
        ("with bladder and friction", big),
    )
    at_rest = float(force_at_ratios(one, 5.0, np.array([1.0]))[0])
    wide = np.linspace(0.6, 1.4, 161)
    muscles = [(name, tables.CONTRACTILE_ELEMENTS[name].constants) for name in ("rat", "cat", "frog", "human")]
    return [
        FigureData(
            "3.4",
            "1-1/4 in actuator at 5 bar: the models",
            "λ1 = L/L0",
            "force [N]",
            tuple(PlotLine(name, LENGTH_RATIOS, force_at_ratios(muscle, 5.0)) for name, muscle in ladder),
            (0.6, 1.0),
            (0.0, 2500.0),
            assumption_note="the measured curve is lost and not drawn",
        ),
        FigureData(
            "3.5",
            "1-1/4 in actuator: the model with friction at 2 to 5 bar",
            "λ1 = L/L0",
            "force [N]",
            tuple(PlotLine(f"{p:g} bar", LENGTH_RATIOS, force_at_ratios(big, p)) for p in PRESSURES_BAR),
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
                    PlotLine(name, wide, np.array([hill.isometric_force(law, x) for x in wide]), "dashed")
                    for name, law in muscles
                ),
                PlotLine("McKibben, 5 bar", FIT_LENGTH_RATIOS, force_at_ratios(one, 5.0, FIT_LENGTH_RATIOS) / at_rest),
            ),
            (0.6, 1.4),
            (0.0, 1.2),
            assumption_note="F0 of the actuator is its force at resting length",
        ),
    ]
