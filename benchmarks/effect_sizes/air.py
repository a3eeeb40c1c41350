"""Sizes of the effects of valve, hose, chamber, leak and tank: times, pressures and stiffness of a clamped muscle.

The room for air, the gas and the flow are written here from the drawing and from textbooks.
"""

import math
from collections.abc import Mapping

import numpy as np
from benchmarks.effect_sizes.size import EffectSize, make_clamped_muscle, make_device, simulate

from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.types import Array
from klute_sim.units import BAR

ROOM_PRESSURE = 101_325.0
"""Pressure of the room [Pa]."""
GAS_ENERGY = 287.05 * 293.15
"""R T of air at 20 degrees Celsius [J/kg]."""
SOUND = 343.2
"""Speed of sound in air of 20 degrees Celsius [m/s], from tables."""
SOURCE = 5.0 * BAR + ROOM_PRESSURE
"""Absolute pressure of the supply [Pa]."""
LENGTH = 0.225
"""Length of the clamped muscle [m]."""
REFERENCE_DENSITY = 1.185
"""Density of air at 20 degrees Celsius and 100 kPa after ISO 8778 [kg/m3]."""
HOSE = {"length_m": 4.0, "inner_diameter_mm": 4.0}
VALVE = {"resistance_s_bar_per_dm3": 4.0, "critical_ratio": 0.5}
COUPLING = {"recovery_s": 0.05, "exponent": 1.2}
LEAK = {"conductance_dm3_per_s_bar": 0.1}
TANK = {"inverse_volume_per_l": 4.0}


def compute_room(length: float = LENGTH) -> float:
    """Return the room for air [m3]: bores of the bladders at ``length`` [m], and fittings."""
    numbers = load_device("klute-3-4-pair").spec
    muscle, at_rest = numbers.muscle, 1e-3 * numbers.muscle.resting_length_mm
    circumference = math.sqrt((muscle.braid_length_ratio * at_rest) ** 2 - length**2) / (muscle.turns_per_m * at_rest)
    outer, inner = 1e-3 * muscle.bladder_radius_mm, 1e-3 * (muscle.bladder_radius_mm - muscle.bladder_thickness_mm)
    rubber = math.pi * (outer**2 - inner**2) * at_rest
    bore = circumference**2 / (4.0 * math.pi) * length - rubber
    return muscle.count * bore + 1e-6 * numbers.supply.dead_volume_cm3


def make_supplied_muscle() -> DeviceParameters:
    """Return a clamped muscle on a regulator of the pressure :data:`SOURCE`."""
    muscle = make_clamped_muscle()
    return muscle._replace(supply=muscle.supply._replace(max_pressure=SOURCE - ROOM_PRESSURE))


def make_clamp() -> DeviceParameters:
    """Return a clamped muscle on a regulator without a rate limit."""
    muscle = make_supplied_muscle()
    return muscle._replace(supply=muscle.supply._replace(max_pressure_rate=1e12))


def measure_pressure(
    effect: str, form: str, parameters: Mapping[str, float], command: Array, dt: float, length: Array | None = None
) -> Array:
    """Return the absolute pressure [Pa] after each step; the first command [Pa] has acted for long."""
    device = make_device(effect, form, parameters, make_clamp())
    path = np.full(len(command), LENGTH) if length is None else length
    start = compute_taut_state(device, float(path[0]), float(command[0]))
    return np.asarray(simulate(device, path, command, dt, start).pressure) + ROOM_PRESSURE


def measure_rise(effect: str, form: str, parameters: Mapping[str, float], low: float, high: float) -> float:
    """Return the time [s] in which the pressure rises from ``low`` to ``high`` [Pa] after the supply is commanded."""
    dt, count = 1e-4, 3000
    command = np.where(np.arange(count) < 1, 0.0, 5.0 * BAR)
    pressure = measure_pressure(effect, form, parameters, command, dt)
    time = dt * np.arange(1, count + 1)
    return float(np.interp(high, pressure, time) - np.interp(low, pressure, time))


def measure_level_rise(effect: str, form: str, parameters: Mapping[str, float], level: float) -> float:
    """Return the rate [bar/s] at which the pressure rises first after ``level`` [Pa] is commanded."""
    dt, count = 1e-4, 200
    command = np.where(np.arange(count) < 1, 0.0, level)
    pressure = measure_pressure(effect, form, parameters, command, dt)
    return float((pressure[-1] - pressure[1]) / (dt * (count - 2)) / BAR)


def measure_overshoot(effect: str, form: str, parameters: Mapping[str, float]) -> float:
    """Return the part of a step of the command to 3 bar by which the pressure exceeds it [1]."""
    dt, count, height = 1e-5, 20000, 3.0 * BAR
    command = np.where(np.arange(count) < 1, 0.0, height)
    pressure = measure_pressure(effect, form, parameters, command, dt)
    return float((pressure.max() - ROOM_PRESSURE) / height - 1.0)


def measure_delay(effect: str, form: str, parameters: Mapping[str, float]) -> float:
    """Return the time [s] between a step of the command and the first rise of the pressure."""
    dt, count, start = 1e-4, 800, 100
    command = np.where(np.arange(count) < start, 0.0, 5.0 * BAR)
    pressure = measure_pressure(effect, form, parameters, command, dt)
    return dt * float(np.argmax(pressure > ROOM_PRESSURE + 1.0) - start + 0.5)


def measure_compression() -> float:
    """Return the pressure per motion [bar/mm] of a muscle that moves too fast for its regulator, at 3 bar."""
    dt, count = 1e-6, 21
    path = LENGTH + np.linspace(0.0, 1e-4, count)
    pressure = measure_pressure("volume_coupling", "polytropic", COUPLING, np.full(count, 3.0 * BAR), dt, path)
    return float((pressure[-1] - pressure[0]) / BAR / (1e3 * (path[-1] - path[0])))


def measure_recovery() -> float:
    """Return the time constant [s] with which the regulator compensates a sudden motion."""
    dt, count = 1e-4, 1000
    path = np.where(np.arange(count) < 1, LENGTH, LENGTH + 1e-3)
    pressure = measure_pressure("volume_coupling", "polytropic", COUPLING, np.full(count, 3.0 * BAR), dt, path)
    excess = np.log(pressure[1:] - 3.0 * BAR - ROOM_PRESSURE)
    return float(-dt * (len(excess) - 1) / (excess[-1] - excess[0]))


def measure_leak() -> float:
    """Return the time [s] in which a sealed muscle falls from 4 to 2.5 bar; it is filled through a valve before."""
    clamp = make_clamp()
    valve = clamp.supply._replace(fill_conductance=1e-7, exhaust_conductance=1e-7, command_is_opening=1.0)
    device = make_device("leak", "orifice", LEAK, clamp._replace(supply=valve))
    dt, count, filled = 2e-4, 6000, 1000
    opening = np.where(np.arange(count) < filled, 1.0, 0.0)
    trace = simulate(device, np.full(count, LENGTH), opening, dt, compute_taut_state(device, LENGTH, 0.0))
    pressure, time = np.asarray(trace.pressure)[filled:], dt * np.arange(count - filled)
    return float(np.interp(-2.5 * BAR, -pressure, time) - np.interp(-4.0 * BAR, -pressure, time))


def measure_tank() -> float:
    """Return the gauge pressure [bar] after a vented muscle has been filled from a tank without refill.

    The regulator fills at its rate: the pressure of the tank is looked up once in a step.
    """
    device = make_device("supply_droop", "tank", TANK, make_supplied_muscle())
    path, command = np.full(1000, LENGTH), np.where(np.arange(1000) < 1, 0.0, 5.0 * BAR)
    trace = simulate(device, path, command, 1e-4, compute_taut_state(device, LENGTH, 0.0))
    return float(trace.pressure[-1]) / BAR


def _state_hose_filling() -> float:
    diameter, bore = 4e-3, math.pi / 4.0 * 16e-6
    rate = bore / (compute_room() + 4.0 * bore) * math.sqrt(GAS_ENERGY * diameter / (0.02 * 4.0))
    return (math.asin(0.8) - math.asin(0.4)) / rate


def _state_compression() -> float:
    growth = (compute_room(LENGTH + 1e-6) - compute_room(LENGTH - 1e-6)) / 2e-6 / compute_room()
    return -1.2 * (3.0 * BAR + ROOM_PRESSURE) * growth / BAR * 1e-3


ROWS = (
    EffectSize(
        effect="choked_valve",
        form="symmetric",
        parameters=VALVE,
        quantity="time from 1.5 to 3 bar (absolute) [s]",
        stated=1.5 * BAR * compute_room() / (GAS_ENERGY * 0.25e-8 * REFERENCE_DENSITY * SOURCE),
        measure=lambda: measure_rise("choked_valve", "symmetric", VALVE, 1.5 * BAR, 3.0 * BAR),
    ),
    *(
        EffectSize(
            effect="choked_valve",
            form="downstream",
            parameters=VALVE,
            quantity=f"first rise at a command of {level:g} bar [bar/s]",
            stated=GAS_ENERGY * 0.25e-8 * REFERENCE_DENSITY * (level + ROOM_PRESSURE / BAR) / compute_room(),
            measure=lambda level=level: measure_level_rise("choked_valve", "downstream", VALVE, level * BAR),
        )
        for level in (2.0, 3.0, 4.0)
    ),
    EffectSize(
        effect="hose",
        form="tube",
        parameters=HOSE,
        quantity="time from 40 to 80 % of the supply (absolute) [s]",
        stated=_state_hose_filling(),
        measure=lambda: measure_rise("hose", "tube", HOSE, 0.4 * SOURCE, 0.8 * SOURCE),
    ),
    EffectSize(
        effect="hose",
        form="tube",
        parameters=HOSE,
        quantity="delay [s]",
        stated=4.0 / SOUND,
        measure=lambda: measure_delay("hose", "tube", HOSE),
    ),
    EffectSize(
        effect="pressure_delay",
        form="dead_time",
        parameters={"delay_s": 0.04},
        quantity="delay [s]",
        stated=0.04,
        measure=lambda: measure_delay("pressure_delay", "dead_time", {"delay_s": 0.04}),
    ),
    EffectSize(
        effect="pressure_lag",
        form="first_order",
        parameters={"time_constant_s": 0.05},
        quantity="time from 20 to 80 % [s]",
        stated=0.05 * math.log(4.0),
        measure=lambda: measure_rise(
            "pressure_lag", "first_order", {"time_constant_s": 0.05}, BAR + ROOM_PRESSURE, 4.0 * BAR + ROOM_PRESSURE
        ),
    ),
    *(
        EffectSize(
            effect="pressure_lag",
            form="second_order",
            parameters={"time_constant_s": 0.02, "damping_ratio": damping_ratio},
            quantity="overshoot after a step [1]",
            stated=math.exp(-math.pi * damping_ratio / math.sqrt(1.0 - damping_ratio**2)),
            measure=lambda ratio=damping_ratio: measure_overshoot(
                "pressure_lag", "second_order", {"time_constant_s": 0.02, "damping_ratio": ratio}
            ),
        )
        for damping_ratio in (0.4, 0.7)
    ),
    EffectSize(
        effect="volume_coupling",
        form="polytropic",
        parameters=COUPLING,
        quantity="pressure per motion [bar/mm]",
        stated=_state_compression(),
        measure=measure_compression,
    ),
    EffectSize(
        effect="volume_coupling",
        form="polytropic",
        parameters=COUPLING,
        quantity="recovery time constant [s]",
        stated=0.05,
        measure=measure_recovery,
    ),
    EffectSize(
        effect="leak",
        form="orifice",
        parameters=LEAK,
        quantity="time from 4 to 2.5 bar [s]",
        stated=compute_room()
        / (GAS_ENERGY * 0.1e-8 * REFERENCE_DENSITY)
        * math.log((4.0 * BAR + ROOM_PRESSURE) / (2.5 * BAR + ROOM_PRESSURE)),
        measure=measure_leak,
    ),
    EffectSize(
        effect="supply_droop",
        form="tank",
        parameters=TANK,
        quantity="pressure after filling [bar]",
        stated=5.0 / (1.0 + compute_room() / 0.25e-3),
        measure=measure_tank,
    ),
)
"""Sizes of the effects of the air."""
