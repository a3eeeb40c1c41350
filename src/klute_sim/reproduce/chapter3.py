"""Chapter 3: the McKibben actuator, from the geometric model to the one with friction, at rest.

What moves is in :mod:`klute_sim.reproduce.moving`.
"""

import math

import numpy as np
from scipy.optimize import brentq

from klute_sim.design.isometric import parabola
from klute_sim.device.files import Device, load
from klute_sim.device.step import advance, taut
from klute_sim.laws import hill, mckibben, pneumatics
from klute_sim.laws import hill_tables as tables
from klute_sim.laws.hill import ENVELOPE
from klute_sim.laws.mckibben import Muscle
from klute_sim.reproduce import printed
from klute_sim.reproduce.implied import PROPORTIONAL
from klute_sim.reproduce.item import Found
from klute_sim.reproduce.picture import Array, Chapter, Line, Picture
from klute_sim.units import BAR

ROWS = ("klute-1-1-4", "klute-3-4", "klute-1-2")
"""Presets of Table 3.1."""
PRESSURES = (2.0, 3.0, 4.0, 5.0)
"""[bar]"""
RATIOS = np.linspace(0.6, 1.0, 161)
"""Muscle length over resting length, the abscissa of Figs. 3.4 and 3.5."""
FITTED = np.linspace(0.65, 1.0, 141)
"""Ratios over which the actuator's parabola is fitted (assumed: its curve ends at the lock length, near 0.61)."""
SHARED = np.linspace(0.75, 1.0, 51)
"""Lengths over resting length that muscles and actuator have in common."""
LEAST_SLENDER = 14.0
"""Length over diameter that the text gives."""


def geometric(muscle: Muscle) -> Muscle:
    """``muscle`` without bladder and friction."""
    return with_bladder(muscle)._replace(c10=0.0, c01=0.0)


def with_bladder(muscle: Muscle) -> Muscle:
    """``muscle`` without friction."""
    return muscle._replace(friction_slope=0.0, friction_offset=0.0)


def over_length(muscle: Muscle, pressure: float, ratios: Array = RATIOS) -> Array:
    """Force [N] at gauge ``pressure`` [bar] over muscle length over resting length."""
    return np.array([mckibben.force(muscle, pressure * BAR, r * muscle.resting_length) for r in ratios])


def compute() -> Chapter:
    """Everything of chapter 3 that stands still."""
    found: dict[str, Found] = {}
    for name in ROWS:
        _row(found, load(name), name.removeprefix("klute-"))
    found["table-3.1.c10"] = Found(1e-3 * load("klute-3-4").parameters.muscle.c10)
    found["table-3.1.c01"] = Found(1e-3 * load("klute-3-4").parameters.muscle.c01)
    slender = {name: _slenderness(load(name)) for name in ROWS}
    told = ", ".join(f"{name.removeprefix('klute-')} in: {value:.1f}" for name, value in slender.items())
    found["table-3.1.slender"] = Found(
        min(slender.values()), min(slender.values()) >= LEAST_SLENDER, f"L0/(2 R0): {told}."
    )
    _vessel(found)
    _overestimates(found)
    one = load("klute-3-4").parameters.muscle
    for pressure in PRESSURES:
        big = load("klute-1-1-4").parameters.muscle
        found[f"fig-3.5.force-{pressure:g}"] = Found(float(over_length(big, pressure, np.array([0.96]))[0]))
    _parabola(found, one)
    found["fig-3.3.ratio"] = Found()
    found["fig-3.5.fit"] = Found()
    found["fig-3.6.stop"] = stop(load("klute-3-4-pair"))
    found["fig-3.7.rest"] = Found(1e3 * one.resting_length)
    pair = load("klute-3-4-pair").parameters.muscle
    found["fig-3.8.rest"] = Found(1e3 * pair.resting_length)
    ratios = [over_length(pair, p, SHARED) / over_length(one, p, SHARED) for p in PRESSURES]
    found["fig-3.8.twice"] = Found(float(np.ravel(ratios)[np.argmax(np.abs(np.ravel(ratios) - 2.0))]))
    return Chapter(found, tuple(_pictures()))


def _row(found: dict[str, Found], device: Device, size: str) -> None:
    """One actuator's constants, recovered from what its law does where it can be."""
    muscle, rest = device.parameters.muscle, device.parameters.muscle.resting_length
    lock = brentq(lambda length: mckibben.gas_force(muscle, BAR, length), 0.4 * rest, rest, xtol=1e-12)
    braid = math.sqrt(3.0) * lock
    volume = mckibben.volume(muscle, 0.8 * rest)
    turns = math.sqrt(0.8 * rest * (braid**2 - (0.8 * rest) ** 2) / (4.0 * math.pi * volume))
    friction = [-mckibben.friction_force(muscle, pressure * BAR) for pressure in PRESSURES]
    slope, offset = np.polyfit(PRESSURES, friction, 1)
    if offset > 100.0:
        found[f"table-3.1.{size}.empty"] = Found(float(offset))
    elif offset < 0.0:
        found[f"table-3.1.{size}.turns-round"] = Found(float(-offset / slope))
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
    found.update({f"table-3.1.{size}.{key}": Found(value) for key, value in values.items()})


def _slenderness(device: Device) -> float:
    muscle = device.parameters.muscle
    return 0.5 * muscle.resting_length / muscle.bladder_radius


def _vessel(found: dict[str, Found]) -> None:
    muscle = load("klute-1-1-4").parameters.muscle
    most = mckibben.volume(muscle, mckibben.lock_length(muscle))
    change = (most - mckibben.volume(muscle, muscle.resting_length)) / (printed.numbers()["fig-3.3.ratio"] * most)
    pressure = 5.0 * BAR + pneumatics.ATMOSPHERE
    found["fig-3.3.vessel"] = Found(
        1e3 * pressure * change / BAR, note="Isothermal, at 5 bar, from resting length to lock: 1-1/4 in actuator."
    )
    found["fig-3.3.highest"] = Found(max(load(name).parameters.supply.pressure for name in ROWS) / BAR)


def _overestimates(found: dict[str, Found]) -> None:
    """How much too high the models without friction are, with Table 3.1's friction for the lost measurement."""
    muscle = load("klute-1-1-4").parameters.muscle
    plain, rubber = (over_length(model(muscle), 5.0) for model in (geometric, with_bladder))
    measured = over_length(muscle, 5.0)
    stands = "Measured values are lost; the model with Table 3.1's own friction stands for them."
    found["fig-3.4.geometric"] = Found(
        float(np.mean(plain - measured)), note=f"Mean over 0.6-1 of resting length. {stands}"
    )
    found["fig-3.4.bladder"] = Found(float(np.mean(rubber - measured)), note=f"The same at every length. {stands}")
    apart = plain - rubber
    found["fig-3.4.difference"] = Found(float(np.mean(apart)), note="Mean over 0.6-1 of resting length.")
    found["fig-3.4.everywhere"] = Found(
        float(apart[-1]),
        bool(apart.min() > 0.5 * np.mean(apart)),
        f"Geometric less bladder model: {apart.max():.0f} N at most, {abs(apart[-1]):.0f} N at resting length.",
    )
    high = {p: -mckibben.friction_force(muscle, p * BAR) for p in PRESSURES}
    ratios = {p: (high[p] / high[5.0]) / (p / 5.0) for p in PRESSURES[:-1]}
    told = ", ".join(f"{high[p]:.0f} N at {p:g} bar" for p in PRESSURES)
    found["fig-3.4.proportional"] = Found(
        max(ratios.values()), max(ratios.values()) <= PROPORTIONAL, f"Bladder model less friction model: {told}."
    )


def _parabola(found: dict[str, Found], muscle: Muscle) -> None:
    """Whether the actuator meets (2.5a-c): the constants of (2.3) from its own curve, over F0 at resting length."""
    for letter, key, value in zip("abc", ("k5", "k6", "k7"), parabola(muscle, 5.0 * BAR), strict=True):
        span = getattr(ENVELOPE, key)
        found[f"fig-3.6.2.5{letter}"] = Found(
            float(value),
            hill.in_span(span, float(value)),
            f"{key} of a parabola through the 3/4 in actuator's curve at 5 bar; asked for are {span.low:g} to "
            f"{span.high:g}.",
        )
    found["fig-3.6.first-order"] = first_order(force_over_length(muscle))


def force_over_length(muscle: Muscle) -> Array:
    """Force at 5 bar over that at resting length, over :data:`SHARED`."""
    force = over_length(muscle, 5.0, SHARED)
    return np.asarray(force / force[-1])


def first_order(actuator: Array) -> Found:
    """Whether the line through an ``actuator``'s force over :data:`SHARED` is as steep as one through a muscle's."""
    laws = [tables.CONTRACTILE[name].law for name in ("rat", "cat", "frog", "human")]
    muscles = [[max(0.0, hill.isometric_force(law, x)) for x in SHARED] for law in laws]
    slopes = [float(np.polyfit(SHARED, force, 1)[0]) for force in muscles]
    own = float(np.polyfit(SHARED, actuator, 1)[0])
    return Found(
        own,
        min(slopes) <= own <= max(slopes),
        f"Slope of force over length from 0.75 to 1 of resting length, by F0 and l0; muscles have {min(slopes):.2f} to "
        f"{max(slopes):.2f}, which is taken for first order. The shape is another matter: see (2.5).",
    )


def stop(device: Device) -> Found:
    """Pull a unit far beyond its muscle's resting length: the muscle must not follow."""
    parameters, rest = device.parameters, device.parameters.muscle.resting_length
    unit = rest + parameters.tendon.slack_length + 0.02
    state = taut(parameters, unit - 0.02, 5.0 * BAR)
    for k in range(2000):
        state = advance(parameters, state, unit - 0.02 + 1e-5 * k, 5.0 * BAR, 1e-3)
    return Found(state.length / rest, state.length <= rest, "Over resting length, at 10 mm/s, 20 mm beyond.")


def _pictures() -> list[Picture]:
    big, one = load("klute-1-1-4").parameters.muscle, load("klute-3-4").parameters.muscle
    ladder = (("geometric", geometric(big)), ("with bladder", with_bladder(big)), ("with bladder and friction", big))
    at_rest = float(over_length(one, 5.0, np.array([1.0]))[0])
    wide = np.linspace(0.6, 1.4, 161)
    muscles = [(name, tables.CONTRACTILE[name].law) for name in ("rat", "cat", "frog", "human")]
    return [
        Picture(
            "3.4",
            "1-1/4 in actuator at 5 bar: the models",
            "λ1 = L/L0",
            "force [N]",
            tuple(Line(name, RATIOS, over_length(muscle, 5.0)) for name, muscle in ladder),
            (0.6, 1.0),
            (0.0, 2500.0),
            assumed="the measured curve is lost and not drawn",
        ),
        Picture(
            "3.5",
            "1-1/4 in actuator: the model with friction at 2 to 5 bar",
            "λ1 = L/L0",
            "force [N]",
            tuple(Line(f"{p:g} bar", RATIOS, over_length(big, p)) for p in PRESSURES),
            (0.6, 1.0),
            (0.0, 2000.0),
            assumed="the measured curves are lost and not drawn",
        ),
        Picture(
            "3.6",
            "Isometric force of muscles and of the 3/4 in actuator at 5 bar",
            "l/l0",
            "F/F0",
            (
                *(
                    Line(name, wide, np.array([hill.isometric_force(law, x) for x in wide]), "dashed")
                    for name, law in muscles
                ),
                Line("McKibben, 5 bar", FITTED, over_length(one, 5.0, FITTED) / at_rest),
            ),
            (0.6, 1.4),
            (0.0, 1.2),
            assumed="F0 of the actuator is its force at resting length",
        ),
    ]
