"""Limits of the air's step: positive pressures and masses, a balance of all air, no change of ordinary results."""

import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.laws import pneumatic_step, supply_valve
from klute_sim.laws.pneumatic_step import AirCharge, GasState
from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT, ATMOSPHERIC_PRESSURE, SupplyParameters, air_mass

ROUNDING = 1e-9
"""Relative rounding error of a balance."""


def draw_log(rng: random.Random, lower: float, upper: float) -> float:
    return math.exp(rng.uniform(math.log(lower), math.log(upper)))


def draw_supply(rng: random.Random) -> SupplyParameters:
    """Return a supply with any valve, leak, tank and regulator that a device file allows."""
    supply = SupplyParameters(draw_log(rng, 1e2, 2e6), draw_log(rng, 1e2, 1e12), rng.uniform(213.0, 473.0))
    if rng.random() < 0.6:
        supply = supply._replace(
            fill_conductance=draw_log(rng, 1e-12, 1e-5),
            fill_critical_ratio=rng.uniform(0.0, 0.98),
            exhaust_conductance=draw_log(rng, 1e-12, 1e-5),
            exhaust_critical_ratio=rng.uniform(0.0, 0.98),
            valve_gain=rng.choice([0.0, draw_log(rng, 1e-9, 0.1)]),
            command_is_opening=rng.choice([0.0, 1.0]),
            pwm_period=rng.choice([0.0, 0.001, 0.1]),
            polytropic_exponent=rng.choice([1.0, 1.2, 1.67]),
            thermal_time_constant=rng.choice([0.0, 1e-6, 1.0]),
            dead_volume=rng.choice([0.0, 1e-6]),
            regulator_is_upstream=rng.choice([0.0, 1.0]),
        )
    elif rng.random() < 0.7:
        supply = supply._replace(
            regulator_time_constant=draw_log(rng, 1e-3, 5.0), polytropic_exponent=rng.uniform(1.0, 1.4)
        )
    if rng.random() < 0.6:
        supply = supply._replace(leak_conductance=draw_log(rng, 1e-12, 1e-7))
    if rng.random() < 0.6:
        supply = supply._replace(tank_volume=draw_log(rng, 1e-6, 1.0), tank_pressure=draw_log(rng, 1e2, 5e7))
    return supply


def step_air(
    supply: SupplyParameters,
    gas: GasState,
    pressure: float,
    command: float,
    volumes: tuple[float, float, float],
    dt: float,
) -> tuple[AirCharge, float, GasState]:
    """Return the air after one step; ``volumes`` are those at rest, before and after the motion."""
    at_rest, before, after = volumes
    air = pneumatic_step.charge(supply, gas, pressure, command, before, at_rest, dt)
    pressure = pneumatic_step.pressure_after_motion(air, after)
    return air, pressure, pneumatic_step.update_gas(supply, gas, air, pressure, after, at_rest)


def enclosed_mass(supply: SupplyParameters, gas: GasState, at_rest: float) -> float:
    return gas.surplus_mass + air_mass(0.0, at_rest + supply.dead_volume, supply.temperature)


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32))
def test_pressures_and_masses_stay_positive_and_balance(seed: int) -> None:
    rng = random.Random(seed)
    supply, at_rest = draw_supply(rng), draw_log(rng, 1e-8, 1e-2)
    dt, before = draw_log(rng, 5e-5, 1e-2), at_rest * rng.uniform(1.0, 3.0)
    pressure = rng.choice([0.0, rng.random() * pneumatic_step.supply_pressure(supply, 0.0)])
    gas = pneumatic_step.equilibrium_gas(supply, pressure, before, at_rest)
    full_tank = pneumatic_step.tank_air_mass(supply, 0.0) if supply.tank_volume > 0.0 else math.inf
    for _ in range(30):
        after = rng.choice([before, at_rest * rng.uniform(1.0, 3.0)])
        command = rng.uniform(-1.0, 1.0) if supply.command_is_opening else rng.uniform(0.0, supply.max_pressure)
        mass = enclosed_mass(supply, gas, at_rest)
        air, pressure, new_gas = step_air(supply, gas, pressure, command, (at_rest, before, after), dt)
        new_mass = enclosed_mass(supply, new_gas, at_rest)
        assert pressure + ATMOSPHERIC_PRESSURE > 0.0
        assert new_mass > 0.0
        moved = abs(air.valve_mass) + abs(air.leaked_mass) + mass + new_mass
        drawn = new_gas.drawn_mass - gas.drawn_mass
        if supply.fill_conductance > 0.0:
            assert new_mass == pytest.approx(mass + air.valve_mass - air.leaked_mass, abs=ROUNDING * moved)
        exhausted = mass + drawn - air.leaked_mass - new_mass
        if supply.fill_conductance == 0.0 and supply.polytropic_exponent == 1.0:
            assert exhausted >= -ROUNDING * moved
        assert -ROUNDING * moved <= drawn
        assert new_gas.drawn_mass <= full_tank + ROUNDING * moved
        gas, before = new_gas, after


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32))
def test_limits_do_not_change_a_bit_of_ordinary_results(seed: int) -> None:
    rng = random.Random(seed)
    supply = SupplyParameters(7e5, 50e5, 293.15, leak_conductance=rng.choice([0.0, 1e-11, 2e-10]))
    if rng.random() < 0.5:
        conductance, exponent = rng.uniform(0.2e-8, 3e-8), rng.uniform(1.0, 1.4)
        supply = supply._replace(
            fill_conductance=conductance,
            fill_critical_ratio=0.3,
            exhaust_conductance=conductance,
            exhaust_critical_ratio=0.3,
            valve_gain=5e-5,
            polytropic_exponent=exponent,
            tank_volume=1.5e-3,
            tank_pressure=200e5,
        )
    else:
        supply = supply._replace(regulator_time_constant=rng.choice([0.0, 0.05]), polytropic_exponent=1.2)
    dt, at_rest = rng.choice([1e-4, 5e-4, 2e-3]), rng.uniform(0.5e-4, 3e-4)
    time = np.arange(300) * dt
    volumes = (at_rest * (1.2 - 0.2 * np.cos(rng.uniform(5.0, 15.0) * time))).tolist()
    commands = np.where(time % 0.3 < 0.15, 5e5, 0.3e5).tolist()

    def simulate() -> list[tuple[float, GasState]]:
        pressure, states = 0.0, []
        gas = pneumatic_step.equilibrium_gas(supply, pressure, volumes[0], at_rest)
        for k in range(len(volumes) - 1):
            _, pressure, gas = step_air(supply, gas, pressure, commands[k], (at_rest, volumes[k], volumes[k + 1]), dt)
            states.append((pressure, gas))
        return states

    limited = simulate()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pneumatic_step, "LOWEST_REGULATED_PRESSURE", -math.inf)
        patch.setattr(pneumatic_step, "limit_outflow", lambda outflow, mass, ratio: outflow)
        patch.setattr(pneumatic_step, "tank_air_mass", lambda supply, drawn: math.inf)
        assert simulate() == limited


@pytest.mark.parametrize("ratio", [0.5, 0.99, 1.0, 1.01, 2.0])
def test_air_passing_through_brings_the_muscle_to_the_temperature_of_the_supply(ratio: float) -> None:
    """A leak as large as the valve exchanges the air of a small muscle many times in a step."""
    volume, temperature = 1e-7, 293.15
    supply = SupplyParameters(
        5e5,
        1e12,
        temperature,
        fill_conductance=1e-8,
        exhaust_conductance=1e-8,
        command_is_opening=1.0,
        polytropic_exponent=1.4,
        leak_conductance=1e-8,
    )
    pressure = 2e5
    vented = air_mass(0.0, volume, temperature)
    gas = GasState(air_mass(pressure, volume, temperature) / ratio - vented)
    for _ in range(50):
        air, pressure, gas = step_air(supply, gas, pressure, 1.0, (volume, volume, volume), 5e-3)
        assert air.leaked_mass > 0.0
    reached = (pressure + ATMOSPHERIC_PRESSURE) * volume / (AIR_GAS_CONSTANT * enclosed_mass(supply, gas, volume))
    assert reached == pytest.approx(temperature, rel=1e-3)


def test_regulator_does_not_evacuate_an_expanded_muscle() -> None:
    supply = SupplyParameters(5e5, 1e12, 293.15, regulator_time_constant=5.0, polytropic_exponent=1.2)
    pressure, gas = 5e5, pneumatic_step.equilibrium_gas(supply, 5e5, 1e-4, 1e-4)
    _, pressure, gas = step_air(supply, gas, pressure, 5e5, (1e-4, 1e-4, 2.5e-4), 1e-3)
    assert gas.pressure_disturbance < -3e5
    _, pressure, gas = step_air(supply, gas, pressure, 0.0, (1e-4, 2.5e-4, 2.5e-4), 1e-3)
    assert -0.5 * ATMOSPHERIC_PRESSURE - 1.0 < pressure < 0.0


def test_small_tank_gives_the_air_it_holds_and_no_more() -> None:
    supply = SupplyParameters(5e5, 1e12, 293.15, tank_volume=1e-5, tank_pressure=5e5)
    held = pneumatic_step.tank_air_mass(supply, 0.0)
    assert held == pytest.approx(5e5 * 1e-5 / (AIR_GAS_CONSTANT * 293.15))
    gas = pneumatic_step.equilibrium_gas(supply, 0.0, 2e-4, 2e-4)
    _, pressure, gas = step_air(supply, gas, 0.0, 5e5, (2e-4, 2e-4, 2e-4), 1e-3)
    assert gas.drawn_mass == pytest.approx(held, rel=1e-12)
    assert pressure == pytest.approx(5e5 * 1e-5 / 2e-4, rel=1e-9)  # all of it is in the muscle
    valve = supply._replace(fill_conductance=1e-5, exhaust_conductance=1e-5, command_is_opening=1.0)
    gas = pneumatic_step.equilibrium_gas(valve, 0.0, 2e-4, 2e-4)
    _, pressure, gas = step_air(valve, gas, 0.0, 1.0, (2e-4, 2e-4, 2e-4), 1e-2)
    assert gas.drawn_mass == pytest.approx(held, rel=1e-9)
    assert pressure == pytest.approx(5e5 * 1e-5 / 2e-4, rel=1e-9)


@pytest.mark.parametrize("exponent", [1.0, 1.2])
def test_empty_tank_encloses_the_air_of_an_expanded_muscle(exponent: float) -> None:
    """A regulator at the rate limit must not hold a pressure below the room's by letting air out of the muscle."""
    supply = SupplyParameters(
        1e2,
        1e2,
        293.15,
        tank_volume=1e-6,
        tank_pressure=1e2,
        regulator_time_constant=1e-9,
        polytropic_exponent=exponent,
    )
    gas, pressure = pneumatic_step.equilibrium_gas(supply, 0.0, 1e-6, 1e-6), 0.0
    for _ in range(10):
        for before, after in ((1e-6, 1e-4), (1e-4, 1e-6)):
            _, pressure, gas = step_air(supply, gas, pressure, 1e2, (1e-6, before, after), 1e-3)
    assert enclosed_mass(supply, gas, 1e-6) > 0.9 * air_mass(0.0, 1e-6, 293.15)
    assert pressure > -0.1 * ATMOSPHERIC_PRESSURE


def test_leak_ends_at_room_pressure() -> None:
    supply = SupplyParameters(5e5, 1e12, 293.15, leak_conductance=1e-7, tank_volume=1e-6, tank_pressure=1e2)
    empty = pneumatic_step.tank_air_mass(supply, 0.0)
    for start in (-0.5e5, 0.5e5):
        gas = pneumatic_step.equilibrium_gas(supply, start, 1e-6, 1e-6)._replace(drawn_mass=empty)
        _, pressure, _ = step_air(supply, gas, start, 5e5, (1e-6, 1e-6, 1e-6), 1e-2)
        assert pressure == pytest.approx(0.0, abs=1.0)


def test_limited_outflow_keeps_the_change_of_pressure() -> None:
    assert supply_valve.limit_outflow(1e-6, 2e-6, 0.5) == 1e-6
    assert supply_valve.limit_outflow(3e-6, 2e-6, 0.5) == pytest.approx(2.5e-6)
    assert supply_valve.limit_outflow(-1.0, 2e-6, 0.5) == -1.0
