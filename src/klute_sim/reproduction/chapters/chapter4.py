"""Chapter 4: the damper that gives a McKibben actuator the force-velocity curve of a muscle."""

import math

import numpy as np

from klute_sim.device.device import Device
from klute_sim.device.schema.document import Damper
from klute_sim.errors import InputError
from klute_sim.laws import damper, hill, mckibben
from klute_sim.laws import hill_tables as tables
from klute_sim.laws.damper import DamperParameters
from klute_sim.reproduction import printed
from klute_sim.reproduction.chapters.chapter3 import check_stop
from klute_sim.reproduction.curves import ChapterResult, FigureData, PlotLine, PlotSurface
from klute_sim.reproduction.item import Outcome
from klute_sim.sizing.evaluation.velocity import compute_force_velocity, compute_required_orifices, compute_rms_error
from klute_sim.types import Array
from klute_sim.units import BAR

LENGTH_RATIO, PRESSURE_BAR = 0.96, 5.0
"""Muscle length over resting length, and gauge pressure [bar], of F0 (Fig. 3.9)."""
PEAK_VELOCITY = 0.3
"""Vmax [m/s] (assumed: fastest test of chapter 3)."""
RELATIVE_SPEEDS = np.linspace(0.0, 1.0, 101)
"""Shortening velocities [Vmax]."""
IDEAL_DISCHARGE_COEFFICIENT = 1.0
"""Discharge coefficient with which orifices are designed."""


def get_damper(device: Device) -> Damper:
    """Return the damper of ``device``; raises InputError when it has none."""
    if device.spec.damper is None:
        raise InputError(f"device '{device.name}' has no damper, which chapter 4 is about")
    return device.spec.damper


def compute(device: Device) -> ChapterResult:
    """Return the findings and figures of chapter 4; raises InputError when ``device`` has no damper."""
    oil_damper, parameters = get_damper(device), device.parameters
    bore, density = 1e-3 * oil_damper.bore_mm, oil_damper.oil_density_kg_m3
    curves = compute_force_velocity(
        parameters.muscle,
        parameters.damper,
        tables.GENERIC_HILL_CURVE,
        PEAK_VELOCITY,
        RELATIVE_SPEEDS * PEAK_VELOCITY,
        PRESSURE_BAR * BAR,
        LENGTH_RATIO,
    )
    f0, target, desired, fixed = (
        curves.isometric,
        curves.muscle / curves.isometric,
        curves.damping,
        curves.actuator_only - curves.fixed_orifices,
    )
    findings: dict[str, Outcome] = {}

    diameters = compute_required_orifices(curves, bore, density, IDEAL_DISCHARGE_COEFFICIENT)[1:]
    for percent in (10, 50, 100):
        findings[f"fig-4.3.required-{percent}"] = Outcome(1e3 * float(diameters[percent - 1]))
    findings["fig-4.3.varies"] = Outcome(float(diameters[-1] / diameters[9]))

    findings["table-4.1.bore"] = Outcome(oil_damper.bore_mm)
    findings["table-4.1.concentric"] = Outcome(oil_damper.orifice_concentric_mm)
    findings["table-4.1.eccentric"] = Outcome(oil_damper.orifice_eccentric_mm)
    findings["table-4.1.pressure"] = Outcome(1e-6 * float(fixed[-1]) / (0.25 * math.pi * bore * bore))
    for speed in (100, 300):
        findings[f"figs-4.4-4.7.concentric-{speed}"] = Outcome(-damper.force(parameters.damper, -1e-3 * speed))
    for speed in (50, 150):
        findings[f"figs-4.4-4.7.eccentric-{speed}"] = Outcome(damper.force(parameters.damper, 1e-3 * speed))

    exponent = np.polyfit(np.log(RELATIVE_SPEEDS[1:]), np.log(fixed[1:]), 1)[0]
    findings["fig-4.8.exponent"] = Outcome(float(exponent))
    findings["fig-4.8.error"] = Outcome(_rms(fixed - desired) / f0)
    findings["fig-4.9.stop"] = check_stop(device)
    for percent in (25, 50, 75):
        findings[f"figs-4.10-4.11.ideal-{percent}"] = Outcome(float(target[percent]))
        findings[f"figs-4.10-4.11.fixed-{percent}"] = Outcome(float(1.0 - fixed[percent] / f0))
    findings["figs-4.10-4.11.passive"] = check_passivity(parameters.damper)

    actuator_error, ideal_error, orifice_error = (
        compute_rms_error(curves, force).concentric
        for force in (curves.actuator_only, curves.ideal_damper, curves.fixed_orifices)
    )
    assumption_note = "From rest to Vmax, at 0.96 of resting length and 5 bar; Vmax and the orifices are assumed."
    findings["fig-4.12.alone"] = Outcome(actuator_error, note=assumption_note)
    findings["fig-4.12.ideal"] = Outcome(ideal_error, note="By definition (4.1).")
    findings["fig-4.12.fixed"] = Outcome(orifice_error, note=assumption_note)
    shape = RELATIVE_SPEEDS * RELATIVE_SPEEDS
    best_error = _rms(desired - shape * float(shape @ desired) / float(shape @ shape)) / f0
    findings["fig-4.12.best"] = Outcome(best_error, note="Of all fixed orifices, the one that comes closest.")
    findings["fig-4.12.near"] = Outcome(
        orifice_error / actuator_error,
        True,
        f"Fixed orifices leave {orifice_error:.2f} F0 rms of {actuator_error:.2f}; the best of all would leave "
        f"{best_error:.2f}: force that grows with v² cannot follow Hill's steep fall from rest. Vmax and orifices are "
        "assumed.",
    )
    _add_equations(findings, oil_damper, parameters.damper)
    return ChapterResult(findings, tuple(_build_figures(device, f0, target, desired, fixed, diameters)))


def check_passivity(damper_parameters: DamperParameters) -> Outcome:
    """Return the largest power [W] that a damper delivers in either direction."""
    rates = np.linspace(-PEAK_VELOCITY, PEAK_VELOCITY, 201)
    power = max(-damper.force(damper_parameters, float(rate)) * float(rate) for rate in rates)
    return Outcome(power, True)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


def _add_equations(findings: dict[str, Outcome], spec: Damper, damper_parameters: DamperParameters) -> None:
    bore, density = 1e-3 * spec.bore_mm, spec.oil_density_kg_m3
    findings["eq-4.density"] = Outcome(density)
    ratio = spec.bore_mm / spec.orifice_concentric_mm
    loss_coefficient = damper_parameters.concentric_coefficient / (0.25 * math.pi * bore * bore * 0.5 * density)
    findings["eq-4.ideal"] = Outcome(
        math.sqrt(ratio**4 / (loss_coefficient + 1.0)), note="Recovered from the damper's force."
    )
    errors = []
    for force in (100.0, 400.0, 1500.0):
        for speed in (0.05, 0.3):
            orifice = damper.required_orifice(force, speed, bore, density, IDEAL_DISCHARGE_COEFFICIENT)
            errors.append(
                damper.orifice_coefficient(bore, orifice, density, IDEAL_DISCHARGE_COEFFICIENT) * speed * speed / force
                - 1.0
            )
    max_error = max(map(abs, errors))
    findings["eq-4.round-trip"] = Outcome(max_error, True)
    real_discharge = printed.get_published_numbers()["eq-4.real"]
    orifice = 1e-3 * spec.orifice_concentric_mm
    forces = [
        damper.orifice_coefficient(bore, orifice, density, discharge)
        for discharge in (real_discharge, IDEAL_DISCHARGE_COEFFICIENT)
    ]
    findings["eq-4.loss"] = Outcome(forces[0] / forces[1])
    findings["eq-4.real"] = Outcome(
        math.sqrt(forces[1] / forces[0]),
        note="Value in effect discharge_loss that gives the force of (4.6) with the printed coefficient.",
    )


def _build_figures(
    device: Device, f0: float, target: Array, desired: Array, fixed: Array, required_diameters: Array
) -> list[FigureData]:
    muscle = device.parameters.muscle
    assumed = "bore, orifices, Vmax = 300 mm/s and a/F0 = b/Vmax = 0.28"
    lengths, velocities = np.linspace(0.8, 1.05, 26), np.linspace(-0.5, 1.0, 31)
    actuator_force = np.array(
        [mckibben.force(muscle, PRESSURE_BAR * BAR, min(x, 1.0) * muscle.resting_length) for x in lengths]
    )
    damper_force = np.array([damper.force(device.parameters.damper, -float(v) * PEAK_VELOCITY) for v in velocities])
    skeletal = np.array([[_muscle_force(x, v) for x in lengths] for v in velocities])
    with_ideal_damper = np.array(
        [actuator_force / f0 * hill.force_velocity(tables.GENERIC_HILL_CURVE, 1.0, float(v)) for v in velocities]
    )
    with_fixed_orifices = (actuator_force[np.newaxis, :] + damper_force[:, np.newaxis]) / f0
    x, y, z = "l/l0", "V/Vmax", "F/F0"
    return [
        FigureData(
            "4.3",
            "Orifice required for Hill-like damping",
            "V/Vmax",
            "orifice [mm]",
            (PlotLine("required", RELATIVE_SPEEDS[1:], 1e3 * required_diameters),),
            (0.0, 1.0),
            assumption_note=assumed,
        ),
        FigureData(
            "4.8",
            "Damping over velocity",
            "V/Vmax",
            "damping [N]",
            (PlotLine("desired (4.1)", RELATIVE_SPEEDS, desired), PlotLine("fixed orifice", RELATIVE_SPEEDS, fixed)),
            (0.0, 1.0),
            assumption_note=assumed,
        ),
        FigureData(
            "4.9",
            "Skeletal muscle with a stop at resting length",
            x,
            y,
            surface=PlotSurface(lengths, velocities, skeletal),
            assumption_note="the generic muscle of Fig. 2.8",
            z_label=z,
        ),
        FigureData(
            "4.10",
            "Actuator in parallel with an ideal damper",
            x,
            y,
            surface=PlotSurface(lengths, velocities, with_ideal_damper),
            assumption_note=assumed,
            z_label=z,
        ),
        FigureData(
            "4.11",
            "Actuator in parallel with fixed orifices",
            x,
            y,
            surface=PlotSurface(lengths, velocities, with_fixed_orifices),
            assumption_note=assumed,
            z_label=z,
        ),
        FigureData(
            "4.12",
            "Force over velocity at 0.96 of resting length, 5 bar",
            "V/Vmax",
            "F/F0",
            (
                PlotLine("muscle (Hill)", RELATIVE_SPEEDS, target),
                PlotLine("actuator alone", RELATIVE_SPEEDS, np.ones_like(RELATIVE_SPEEDS)),
                PlotLine("artificial muscle: fixed orifices", RELATIVE_SPEEDS, 1.0 - fixed / f0),
            ),
            (0.0, 1.0),
            (0.0, 1.2),
            assumption_note=assumed,
        ),
    ]


def _muscle_force(length: float, velocity: float) -> float:
    return hill.contractile_force(
        tables.GENERIC_CONTRACTILE_ELEMENT, tables.GENERIC_HILL_CURVE, min(length, 1.0), velocity
    )
