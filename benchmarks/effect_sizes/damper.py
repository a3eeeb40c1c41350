"""Sizes of the damper's effects, on the clamped muscle with and without its damper."""

import math
from collections.abc import Mapping
from functools import partial

import numpy as np
from benchmarks.effect_sizes.size import (
    PRESET,
    EffectSize,
    compute_work,
    make_clamped_muscle,
    make_device,
    select_last_cycle,
    simulate,
    triangle,
)

from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.types import Array

BORE, ORIFICE_IN, ORIFICE_OUT, DENSITY = (
    getattr(load_device(PRESET).spec.damper, key)
    for key in ("bore_mm", "orifice_concentric_mm", "orifice_eccentric_mm", "oil_density_kg_m3")
)
"""Numbers of the preset's drawing [mm, kg/m3]."""
AREA = math.pi / 4.0 * (1e-3 * BORE) ** 2
"""Area of the bore [m2]."""
ATMOSPHERE = 101325.0
"""Pressure of the air at which its volume is stated [Pa]."""
SHORT, LONG, SPEED = 0.225, 0.235, 0.2
"""Muscle lengths between which a loop is measured [m], and its speed [m/s]."""
LINEAR_DAMPING = 500.0
"""Damping [N s/m] of an orifice that is laminar throughout, for the loop of a Maxwell element."""


def compute_orifice_force(orifice: float, speed: float) -> float:
    """Return the force [N] of an ideal ``orifice`` [mm] at ``speed`` [m/s], eq. (4.6)."""
    return AREA * DENSITY / 2.0 * speed**2 * ((BORE / orifice) ** 4 - 1.0)


def simulate_damper(device: DeviceParameters, path: Array, dt: float) -> Array:
    """Return the tension [N] that the damper adds while the unpressurised muscle moves along ``path`` [m]."""
    start = compute_taut_state(device, float(path[0]), 0.0)
    bare = make_clamped_muscle()
    without = simulate(bare, path, 0.0, dt, compute_taut_state(bare, float(path[0]), 0.0))
    return simulate(device, path, 0.0, dt, start).tension - without.tension


def measure_loop(effect: str, form: str, parameters: Mapping[str, float], dt: float = 2e-5) -> float:
    """Return the energy [J] that a cycle between :data:`SHORT` and :data:`LONG` loses at :data:`SPEED`."""
    path = triangle(SHORT, LONG, SPEED, dt)
    tension = simulate_damper(make_device(effect, form, parameters, make_clamped_muscle(damper=True)), path, dt)
    return compute_work(select_last_cycle(path), select_last_cycle(tension))


def measure_maxwell_loop(effect: str, form: str, parameters: Mapping[str, float], omega: float) -> float:
    """Return the energy [mJ] that a sine of 10 um at ``omega`` [rad/s] loses where the orifice is laminar."""
    base, fast = make_clamped_muscle(damper=True), 100.0
    linear = base.damper._replace(
        concentric_coefficient=LINEAR_DAMPING / fast, eccentric_coefficient=LINEAR_DAMPING / fast, transition_speed=fast
    )
    n = 1500
    dt = 2.0 * math.pi / omega / n
    path = SHORT + 1e-5 * np.sin(omega * dt * np.arange(4 * n + 1))
    tension = simulate_damper(make_device(effect, form, parameters, base._replace(damper=linear)), path, dt)
    return 1e3 * compute_work(select_last_cycle(path, 4), select_last_cycle(tension, 4))


def measure_sudden_force(effect: str, form: str, parameters: Mapping[str, float]) -> float:
    """Return the force [N] after a stroke of 3 mm in 3 us, in which the orifice passes little."""
    device = make_device(effect, form, parameters, make_clamped_muscle(damper=True))
    closed = device.damper._replace(concentric_coefficient=1e9, eccentric_coefficient=1e9)
    path = SHORT + 3e-3 * np.linspace(0.0, 1.0, 31)
    return float(simulate_damper(device._replace(damper=closed), path, 1e-7)[-1])


def make_air_rows() -> list[EffectSize]:
    """Return the loop of a Maxwell element, and the force of a gas and oil that a stroke compresses."""
    rows = []
    for volume in (0.5, 1.0, 2.0):
        parameters = {"air_volume_cm3": volume}
        oil = 0.04 / (1.5e9 * AREA)  # m/N: a column of 40 mm
        stiffness = 1.0 / (1e-6 * volume / (AREA**2 * ATMOSPHERE) + oil)
        for ratio in (0.3, 1.0, 3.0):
            omega = ratio * stiffness / LINEAR_DAMPING
            rows.append(
                EffectSize(
                    effect="trapped_air",
                    form="isothermal",
                    parameters=parameters,
                    quantity=f"loop area of a sine of 10 um with a linear orifice, omega tau = {ratio:g} [mJ]",
                    stated=1e3 * math.pi * 1e-5**2 * stiffness * ratio / (1.0 + ratio**2),
                    measure=partial(measure_maxwell_loop, "trapped_air", "isothermal", parameters, omega),
                )
            )
    # Boyle: the air of 2 cm3 has left V - A (x - oil F) and the absolute pressure pa V / that.
    force = np.linspace(0.0, 1000.0, 200_001)
    pressure = ATMOSPHERE + force / AREA
    stroke = 2e-6 * (1.0 - ATMOSPHERE / pressure) / AREA + oil * force
    rows.append(
        EffectSize(
            effect="trapped_air",
            form="isothermal",
            parameters={"air_volume_cm3": 2.0},
            quantity="force after a sudden stroke of 3 mm [N]",
            stated=float(np.interp(3e-3, stroke, force)),
            measure=partial(measure_sudden_force, "trapped_air", "isothermal", {"air_volume_cm3": 2.0}),
        )
    )
    return rows


def make_loop_rows() -> list[EffectSize]:
    """Return loop areas at constant speed, for the effects without elastic chambers and for cavitation."""
    stroke = LONG - SHORT
    force_in, force_out = (compute_orifice_force(orifice, SPEED) for orifice in (ORIFICE_IN, ORIFICE_OUT))
    cases: list[tuple[str, str, dict[str, float], float]] = []
    for discharge in (0.6, 0.8):
        cases.append(
            (
                "discharge_loss",
                "constant",
                {"discharge_coefficient": discharge},
                stroke * (force_in + force_out) / discharge**2,
            )
        )
    for speed in (50.0, 200.0):
        gain = math.hypot(1.0, 1e-3 * speed / SPEED)
        cases.append(
            (
                "laminar_orifice",
                "smooth",
                {"transition_speed_mm_per_s": speed},
                stroke * gain * (force_in + force_out),
            )
        )
    for rod in (6.0, 12.0):
        share = (1.0 - (rod / BORE) ** 2) ** 3
        cases.append(("rod_side_area", "single_rod", {"rod_diameter_mm": rod}, stroke * (force_in + share * force_out)))
    for inverse in (0.2, 0.4, 0.8):
        limit = AREA * 1e5 / inverse
        orifice_speed = SPEED * math.sqrt(limit / force_in)
        dead = stroke * (SPEED - orifice_speed) / (SPEED + orifice_speed)
        cases.append(
            ("cavitation", "charge", {"inverse_charge_per_bar": inverse}, (limit + force_out) * (stroke - dead))
        )
    # Kinematic viscosities of ISO VG 32 by ASTM D341 [mm2/s], worked out separately: 86.28 at 20 degrees Celsius.
    for temperature, viscosity in ((0.0, 336.00), (5.0, 229.02), (15.0, 116.39)):
        density = 1.0 - 6.5e-4 * (temperature - 20.0)
        laminar = (0.06 / SPEED) ** 2 * ((viscosity / 86.28) ** 2 - 1.0)
        parameters = {"temperature_c": temperature, "transition_speed_mm_per_s": 60.0}
        stated = stroke * density * math.sqrt(1.0 + laminar) * (force_in + force_out)
        cases.append(("oil_temperature", "walther", parameters, stated))
    return [
        EffectSize(
            effect=effect,
            form=form,
            parameters=parameters,
            quantity=f"loop area, {1e3 * stroke:g} mm at {SPEED:g} m/s [J]",
            stated=stated,
            measure=partial(measure_loop, effect, form, parameters),
        )
        for effect, form, parameters, stated in cases
    ]


ROWS = (*make_air_rows(), *make_loop_rows())
"""All rows."""
