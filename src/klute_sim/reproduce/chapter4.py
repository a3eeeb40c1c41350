"""Chapter 4: the damper that is to make a McKibben actuator move like a muscle."""

import math

import numpy as np

from klute_sim.design.velocity import curves, misfit, needed_orifice
from klute_sim.device.files import Device
from klute_sim.device.step import advance, taut
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.laws import damper, hill, mckibben
from klute_sim.laws import hill_tables as tables
from klute_sim.reproduce.item import Found
from klute_sim.reproduce.picture import Array, Chapter, Line, Picture, Surface
from klute_sim.units import BAR

RATIO, PRESSURE = 0.96, 5.0
"""Muscle length over resting length, and gauge pressure [bar], of F0 (Fig. 3.9)."""
FASTEST, FASTEST_ECCENTRIC = 0.3, 0.15
"""Vmax [m/s] (assumed: the fastest test of chapter 3), and the fastest eccentric test."""
SPEEDS = np.linspace(0.0, 1.0, 101)
"""Shortening velocities [Vmax]."""
NEAR = 0.5
"""Error over that of the actuator alone, up to which fixed orifices are near Hill's curve (assumed: the text gives no
number)."""
IDEAL, LOW = 1.0, 0.61
"""Discharge coefficients of the design and, as low as, of real orifices."""


def compute(device: Device) -> Chapter:
    """Everything of chapter 4, of ``device``; raises InputError if it has no damper."""
    spec, parameters = device.spec, device.parameters
    if spec.damper is None:
        raise InputError(f"device '{device.name}' has no damper, which chapter 4 is about")
    bore, density = 1e-3 * spec.damper.bore_mm, spec.damper.oil_density_kg_m3
    drawn = curves(
        parameters.muscle, parameters.damper, tables.GENERIC_HILL, FASTEST, SPEEDS * FASTEST, PRESSURE * BAR, RATIO
    )
    f0, target, desired, fixed = drawn.isometric, drawn.hill / drawn.isometric, drawn.damping, drawn.alone - drawn.fixed
    found: dict[str, Found] = {}

    needed = needed_orifice(drawn, bore, density, IDEAL)[1:]
    for share in (10, 50, 100):
        found[f"fig-4.3.needed-{share}"] = Found(1e3 * float(needed[share - 1]))
    found["fig-4.3.varies"] = Found(float(needed[-1] / needed[9]))

    found["table-4.1.bore"] = Found(spec.damper.bore_mm)
    found["table-4.1.concentric"] = Found(spec.damper.orifice_concentric_mm)
    found["table-4.1.eccentric"] = Found(spec.damper.orifice_eccentric_mm)
    found["table-4.1.pressure"] = Found(1e-6 * float(fixed[-1]) / (0.25 * math.pi * bore * bore))
    for speed in (100, 300):
        found[f"figs-4.4-4.7.concentric-{speed}"] = Found(-damper.force(parameters.damper, -1e-3 * speed))
    for speed in (50, 150):
        found[f"figs-4.4-4.7.eccentric-{speed}"] = Found(damper.force(parameters.damper, 1e-3 * speed))

    exponent = np.polyfit(np.log(SPEEDS[1:]), np.log(fixed[1:]), 1)[0]
    found["fig-4.8.exponent"] = Found(float(exponent))
    found["fig-4.8.error"] = Found(_rms(fixed - desired) / f0)
    found["fig-4.9.stop"] = _stop(device)
    for share in (25, 50, 75):
        found[f"figs-4.10-4.11.ideal-{share}"] = Found(float(target[share]))
        found[f"figs-4.10-4.11.fixed-{share}"] = Found(float(1.0 - fixed[share] / f0))
    both = np.linspace(-FASTEST, FASTEST, 201)
    power = max(-damper.force(parameters.damper, float(rate)) * float(rate) for rate in both)
    found["figs-4.10-4.11.passive"] = Found(power, power <= 0.0)

    alone, ideal, orifices = (misfit(drawn, each).concentric for each in (drawn.alone, drawn.ideal, drawn.fixed))
    assumed = "From rest to Vmax, at 0.96 of resting length and 5 bar; Vmax and the orifices are assumed."
    found["fig-4.12.alone"] = Found(alone, note=assumed)
    found["fig-4.12.ideal"] = Found(ideal, note="By definition (4.1).")
    found["fig-4.12.fixed"] = Found(orifices, note=assumed)
    shape = SPEEDS * SPEEDS
    best = _rms(desired - shape * float(shape @ desired) / float(shape @ shape)) / f0
    found["fig-4.12.near"] = Found(
        best / alone,
        best < NEAR * alone,
        f"With the orifice that comes closest, because the source's is lost: {best:.2f} F0 rms are left of "
        f"{alone:.2f}, with the assumed one {orifices:.2f}. Force that grows with v² cannot follow Hill's steep fall "
        f"from rest. Taken for near: below {NEAR:g}.",
    )
    _equations(found, bore, density)
    return Chapter(found, tuple(_pictures(device, f0, target, desired, fixed, needed)))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


def _equations(found: dict[str, Found], bore: float, density: float) -> None:
    found["eq-4.density"], found["eq-4.ideal"] = Found(density), Found(IDEAL)
    loss = next(p for p in catalogue.form_of("discharge_loss", None)[1].parameters if p.neutral == IDEAL)
    found["eq-4.real"] = Found(
        loss.low, loss.low <= LOW <= loss.high, "Effect discharge_loss, least; the design's is 1."
    )
    errors = []
    for force in (100.0, 400.0, 1472.0):
        for speed in (0.05, 0.3):
            orifice = damper.orifice_for(force, speed, bore, density, IDEAL)
            errors.append(damper.coefficient(bore, orifice, density, IDEAL) * speed * speed / force - 1.0)
    most = max(map(abs, errors))
    found["eq-4.round-trip"] = Found(most, most < 1e-9)
    orifice = damper.orifice_for(1472.0, 0.3, bore, density, IDEAL)
    ratio = damper.coefficient(bore, orifice, density, LOW) / damper.coefficient(bore, orifice, density, IDEAL)
    found["eq-4.loss"] = Found(ratio)


def _stop(device: Device) -> Found:
    """Pull the unit far beyond its muscle's resting length, slowly: the muscle must not follow."""
    parameters, rest = device.parameters, device.parameters.muscle.resting_length
    begin = rest + parameters.tendon.slack_length
    state = taut(parameters, begin, PRESSURE * BAR)
    for k in range(2000):
        state = advance(parameters, state, begin + 1e-5 * k, PRESSURE * BAR, 1e-3)
    return Found(state.length / rest, state.length <= rest, "Over resting length, at 10 mm/s, 20 mm beyond.")


def _pictures(device: Device, f0: float, target: Array, desired: Array, fixed: Array, needed: Array) -> list[Picture]:
    muscle = device.parameters.muscle
    assumed = "bore, orifices, Vmax = 300 mm/s and a/F0 = b/Vmax = 0.28"
    lengths, velocities = np.linspace(0.8, 1.05, 26), np.linspace(-0.5, 1.0, 31)
    pull = np.array([mckibben.force(muscle, PRESSURE * BAR, min(x, 1.0) * muscle.resting_length) for x in lengths])
    lost = np.array([damper.force(device.parameters.damper, -float(v) * FASTEST) for v in velocities])
    skeletal = np.array([[_muscle(x, v) for x in lengths] for v in velocities])
    beside_ideal = np.array([pull / f0 * hill.force_velocity(tables.GENERIC_HILL, 1.0, float(v)) for v in velocities])
    beside_fixed = (pull[np.newaxis, :] + lost[:, np.newaxis]) / f0
    x, y, z = "l/l0", "V/Vmax", "F/F0"
    return [
        Picture(
            "4.3",
            "Orifice that Hill-like damping needs",
            "V/Vmax",
            "orifice [mm]",
            (Line("needed", SPEEDS[1:], 1e3 * needed),),
            (0.0, 1.0),
            assumed=assumed,
        ),
        Picture(
            "4.8",
            "Damping over velocity",
            "V/Vmax",
            "damping [N]",
            (Line("desired (4.1)", SPEEDS, desired), Line("fixed orifice", SPEEDS, fixed)),
            (0.0, 1.0),
            assumed=assumed,
        ),
        Picture(
            "4.9",
            "Skeletal muscle with a stop at resting length",
            x,
            y,
            surface=Surface(lengths, velocities, skeletal),
            assumed="the generic muscle of Fig. 2.8",
            z_label=z,
        ),
        Picture(
            "4.10",
            "Actuator beside an ideal damper",
            x,
            y,
            surface=Surface(lengths, velocities, beside_ideal),
            assumed=assumed,
            z_label=z,
        ),
        Picture(
            "4.11",
            "Actuator beside fixed orifices",
            x,
            y,
            surface=Surface(lengths, velocities, beside_fixed),
            assumed=assumed,
            z_label=z,
        ),
        Picture(
            "4.12",
            "Force over velocity at 0.96 of resting length, 5 bar",
            "V/Vmax",
            "F/F0",
            (
                Line("muscle (Hill)", SPEEDS, target),
                Line("actuator alone", SPEEDS, np.ones_like(SPEEDS)),
                Line("artificial muscle: fixed orifices", SPEEDS, 1.0 - fixed / f0),
            ),
            (0.0, 1.0),
            (0.0, 1.2),
            assumed=assumed,
        ),
    ]


def _muscle(length: float, velocity: float) -> float:
    return hill.contractile_force(tables.GENERIC_CONTRACTILE, tables.GENERIC_HILL, min(length, 1.0), velocity)
