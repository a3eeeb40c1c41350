"""Chapter 4: the damper that is to make a McKibben actuator move like a muscle."""

import math

import numpy as np

from klute_sim.design.velocity import curves, misfit, needed_orifice
from klute_sim.device.files import Device
from klute_sim.device.schema import DamperSection
from klute_sim.errors import InputError
from klute_sim.laws import damper, hill, mckibben
from klute_sim.laws import hill_tables as tables
from klute_sim.laws.damper import Damper
from klute_sim.reproduce import printed
from klute_sim.reproduce.chapter3 import stop
from klute_sim.reproduce.item import Found
from klute_sim.reproduce.picture import Array, Chapter, Line, Picture, Surface
from klute_sim.units import BAR

RATIO, PRESSURE = 0.96, 5.0
"""Muscle length over resting length, and gauge pressure [bar], of F0 (Fig. 3.9)."""
FASTEST = 0.3
"""Vmax [m/s] (assumed: the fastest test of chapter 3)."""
SPEEDS = np.linspace(0.0, 1.0, 101)
"""Shortening velocities [Vmax]."""
NEAR = 0.5
"""Error over that of the actuator alone, up to which fixed orifices are near Hill's curve (assumed: the text gives no
number)."""
IDEAL = 1.0
"""Discharge coefficient that orifices are designed with."""


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
    found["fig-4.9.stop"] = stop(device)
    for share in (25, 50, 75):
        found[f"figs-4.10-4.11.ideal-{share}"] = Found(float(target[share]))
        found[f"figs-4.10-4.11.fixed-{share}"] = Found(float(1.0 - fixed[share] / f0))
    found["figs-4.10-4.11.passive"] = passive(parameters.damper)

    alone, ideal, orifices = (misfit(drawn, each).concentric for each in (drawn.alone, drawn.ideal, drawn.fixed))
    assumed = "From rest to Vmax, at 0.96 of resting length and 5 bar; Vmax and the orifices are assumed."
    found["fig-4.12.alone"] = Found(alone, note=assumed)
    found["fig-4.12.ideal"] = Found(ideal, note="By definition (4.1).")
    found["fig-4.12.fixed"] = Found(orifices, note=assumed)
    shape = SPEEDS * SPEEDS
    best = _rms(desired - shape * float(shape @ desired) / float(shape @ shape)) / f0
    found["fig-4.12.best"] = Found(best, note="Of all fixed orifices, the one that comes closest.")
    found["fig-4.12.near"] = Found(
        orifices / alone,
        orifices < NEAR * alone,
        f"{orifices:.2f} F0 rms are left of {alone:.2f}, and the best of all orifices would leave {best:.2f}: force "
        f"that grows with v² cannot follow Hill's steep fall from rest. Vmax and orifices are assumed; taken for near: "
        f"below {NEAR:g}.",
    )
    _equations(found, spec.damper, parameters.damper)
    return Chapter(found, tuple(_pictures(device, f0, target, desired, fixed, needed)))


def passive(law: Damper) -> Found:
    """The greatest power [W] out of a damper, both ways."""
    rates = np.linspace(-FASTEST, FASTEST, 201)
    power = max(-damper.force(law, float(rate)) * float(rate) for rate in rates)
    return Found(power, power <= 0.0)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


def _equations(found: dict[str, Found], spec: DamperSection, law: Damper) -> None:
    bore, density = 1e-3 * spec.bore_mm, spec.oil_density_kg_m3
    found["eq-4.density"] = Found(density)
    ratio = spec.bore_mm / spec.orifice_concentric_mm
    per_area = law.concentric / (0.25 * math.pi * bore * bore * 0.5 * density)
    found["eq-4.ideal"] = Found(math.sqrt(ratio**4 / (per_area + 1.0)), note="Recovered from the damper's force.")
    errors = []
    for force in (100.0, 400.0, 1500.0):
        for speed in (0.05, 0.3):
            orifice = damper.orifice_for(force, speed, bore, density, IDEAL)
            errors.append(damper.coefficient(bore, orifice, density, IDEAL) * speed * speed / force - 1.0)
    most = max(map(abs, errors))
    found["eq-4.round-trip"] = Found(most, most < 1e-9)
    real = printed.numbers()["eq-4.real"]
    orifice = 1e-3 * spec.orifice_concentric_mm
    forces = [damper.coefficient(bore, orifice, density, discharge) for discharge in (real, IDEAL)]
    found["eq-4.loss"] = Found(forces[0] / forces[1])
    found["eq-4.real"] = Found(
        math.sqrt(forces[1] / forces[0]),
        note="What effect discharge_loss needs for (4.6)'s force with the printed one.",
    )


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
