"""A regulator that feeds the muscle through a fixed restriction: limits, signs, balances of mass and work."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from klute_sim.laws import pneumatic_step, valve
from klute_sim.laws.pneumatic_step import GasState
from klute_sim.laws.pneumatics import (
    AIR_GAS_CONSTANT,
    ATMOSPHERIC_PRESSURE,
    SupplyParameters,
    air_mass,
    has_regulator_upstream,
)
from klute_sim.laws.valve import Restriction

MAX_PRESSURE = 6e5
TEMPERATURE = 293.15
VOLUME = 1e-4
NEEDLE = Restriction(1e-9, 0.3)
SUPPLY = SupplyParameters(MAX_PRESSURE, 1e12, TEMPERATURE, *NEEDLE, *NEEDLE, regulator_is_upstream=1.0)
VALVE = SUPPLY._replace(regulator_is_upstream=0.0)
SLOW = SUPPLY._replace(max_pressure_rate=2e6)
"""A regulator that takes 0.2 s to 4 bar, as long as the needle."""
DT = 1e-3


def step_air(
    supply: SupplyParameters, gas: GasState, pressure: float, command: float, volumes: tuple[float, float], dt: float
) -> tuple[float, GasState]:
    """Return pressure [Pa] and gas state after one step in which the muscle moves between two ``volumes`` [m3]."""
    air = pneumatic_step.charge(supply, gas, pressure, command, volumes[0], VOLUME, dt)
    pressure = pneumatic_step.pressure_after_motion(air, volumes[1])
    return pressure, pneumatic_step.update_gas(supply, gas, air, pressure, volumes[1], VOLUME)


def simulate(
    supply: SupplyParameters, commands: list[float], start: float, dt: float = DT, volumes: list[float] | None = None
) -> tuple[np.ndarray, list[GasState]]:
    """Return the pressures [Pa] and gas states after each step; without ``volumes`` [m3] the muscle is clamped."""
    path = [VOLUME] * (len(commands) + 1) if volumes is None else volumes
    pressure, gas = start, pneumatic_step.equilibrium_gas(supply, start, path[0], VOLUME)
    pressures, states = [], []
    for k, command in enumerate(commands):
        pressure, gas = step_air(supply, gas, pressure, command, (path[k], path[k + 1]), dt)
        pressures.append(pressure)
        states.append(gas)
    return np.array(pressures), states


def check_first_order(supply: SupplyParameters, start: float, command: float) -> None:
    """Check that filling and venting converge to the flow of ISO 6358 from the outlet of the regulator."""

    def rate(time: float, p: list[float]) -> list[float]:
        outlet = ramp(time, start, command, supply.max_pressure_rate) + ATMOSPHERIC_PRESSURE
        flow = valve.mass_flow(NEEDLE, outlet, p[0] + ATMOSPHERIC_PRESSURE, TEMPERATURE)
        return [AIR_GAS_CONSTANT * TEMPERATURE * flow / VOLUME]

    end, errors = 1.5, []
    for dt in (4e-3, 2e-3, 1e-3):
        times = dt * np.arange(1, round(end / dt) + 1)
        exact = solve_ivp(rate, (0.0, end + dt), [start], t_eval=times, rtol=1e-9, atol=1e-3, max_step=2e-3).y[0]
        pressures, states = simulate(supply, [command] * len(times), start, dt)
        errors.append(np.abs(pressures - exact).max())
        outlets = pressures - [s.pressure_disturbance for s in states]
        assert outlets == pytest.approx([ramp(t, start, command, supply.max_pressure_rate) for t in times], abs=1e-3)
    assert errors[2] < 5e-3 * abs(command - start)
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.15)


def ramp(time: float, start: float, command: float, rate: float) -> float:
    """Return the pressure [Pa] of a regulator ``time`` [s] after a step of its command."""
    return start + math.copysign(min(abs(command - start), rate * time), command - start)


@pytest.mark.parametrize(("start", "command"), [(0.0, 2e5), (0.0, 4e5), (5e5, 1e5), (3e5, 0.0)])
def test_clamped_muscle_follows_the_flow_of_iso_6358_and_converges(start: float, command: float) -> None:
    check_first_order(SUPPLY, start, command)


@pytest.mark.parametrize(("start", "command"), [(0.0, 4e5), (5e5, 1e5), (3e5, 0.0)])
def test_rate_is_limited_upstream_of_the_restriction(start: float, command: float) -> None:
    check_first_order(SLOW, start, command)


def test_restriction_without_resistance_leaves_the_ramp_of_the_regulator() -> None:
    commands = [4e5] * 300 + [1e5] * 300
    ideal = SLOW._replace(fill_conductance=0.0)
    pressure, expected = 0.0, []
    for command in commands:
        pressure = pneumatic_step.charge_ideal(ideal, pressure, command, DT).pressure
        expected.append(pressure)
    gaps = []
    for conductance in (1e-6, 1e-5, 1e-4):
        wide = SLOW._replace(fill_conductance=conductance, exhaust_conductance=conductance)
        gaps.append(np.abs(simulate(wide, commands, 0.0)[0] - expected).max())
    assert gaps[0] < 0.01 * 4e5
    assert gaps[1] < 0.15 * gaps[0]
    assert gaps[2] < 0.15 * gaps[1]


def test_rate_that_no_step_exceeds_changes_no_bit() -> None:
    commands = [4e5] * 50 + [1e5] * 50
    runs = [simulate(SUPPLY._replace(max_pressure_rate=rate), commands, 0.0) for rate in (4.1e5 / DT, 1e12, 1e300)]
    for pressures, states in runs[1:]:
        assert pressures.tolist() == runs[0][0].tolist()
        assert states == runs[0][1]


def test_motion_does_not_move_the_outlet_of_the_regulator() -> None:
    volumes = (VOLUME * (1.2 - 0.2 * np.cos(40.0 * DT * np.arange(401)))).tolist()
    supply = SLOW._replace(polytropic_exponent=1.3, thermal_time_constant=0.05, leak_conductance=1e-10)
    pressures, states = simulate(supply, [5e5] * 400, 0.0, volumes=volumes)
    outlets = pressures - [s.pressure_disturbance for s in states]
    assert outlets == pytest.approx([ramp(DT * k, 0.0, 5e5, 2e6) for k in range(1, 401)], abs=1e-3)


@given(
    st.lists(st.floats(0.0, 1.2 * MAX_PRESSURE), min_size=1, max_size=8),
    st.floats(0.0, MAX_PRESSURE),
    st.floats(1e-12, 1e-5),
    st.floats(1e3, 1e9),
    st.floats(1e-5, 1e-1),
)
def test_outlet_approaches_each_command_at_its_rate_and_never_passes_it(
    commands: list[float], start: float, conductance: float, rate: float, dt: float
) -> None:
    supply = SUPPLY._replace(fill_conductance=conductance, exhaust_conductance=conductance, max_pressure_rate=rate)
    pressure, gas = start, pneumatic_step.equilibrium_gas(supply, start, VOLUME, VOLUME)
    outlet = lowest = highest = start
    for command in commands:
        held = min(command, MAX_PRESSURE)
        for _ in range(5):
            before = outlet
            pressure, gas = step_air(supply, gas, pressure, command, (VOLUME, VOLUME), dt)
            outlet = pressure - gas.pressure_disturbance
            assert min(before, held) - 1e-6 <= outlet <= max(before, held) + 1e-6
            assert abs(outlet - before) == pytest.approx(min(rate * dt, abs(held - before)), rel=1e-9, abs=1e-6)
            lowest, highest = min(lowest, outlet), max(highest, outlet)
            assert lowest - 1e-6 <= pressure <= highest + 1e-6


@given(
    st.lists(st.floats(0.0, 1.2 * MAX_PRESSURE), min_size=1, max_size=8),
    st.floats(0.0, MAX_PRESSURE),
    st.floats(1e-12, 1e-5),
    st.floats(0.0, 0.98),
    st.floats(1e-5, 1e-1),
    st.floats(1.0, 1.4),
)
def test_pressure_of_a_clamped_muscle_approaches_each_command_and_never_passes_it(
    commands: list[float], start: float, conductance: float, ratio: float, dt: float, exponent: float
) -> None:
    supply = SUPPLY._replace(
        fill_conductance=conductance,
        fill_critical_ratio=ratio,
        exhaust_conductance=conductance,
        exhaust_critical_ratio=ratio,
        polytropic_exponent=exponent,
    )
    pressure, gas = start, pneumatic_step.equilibrium_gas(supply, start, VOLUME, VOLUME)
    for command in commands:
        held = min(command, MAX_PRESSURE)
        for _ in range(10):
            before, drawn = pressure, gas.drawn_mass
            pressure, gas = step_air(supply, gas, pressure, command, (VOLUME, VOLUME), dt)
            assert min(before, held) - 1e-6 <= pressure <= max(before, held) + 1e-6
            inflow = gas.drawn_mass - drawn
            assert inflow == 0.0 if before > held else inflow >= 0.0


@pytest.mark.parametrize("command", [3e5, 4e5, 5e5])
def test_sonic_flow_grows_with_the_absolute_command(command: float) -> None:
    nozzle = NEEDLE._replace(critical_ratio=0.5)
    pressures, _ = simulate(SUPPLY._replace(fill_critical_ratio=0.5), [command] * 400, 0.0)
    critical = 0.5 * (command + ATMOSPHERIC_PRESSURE) - ATMOSPHERIC_PRESSURE
    rates = np.diff(pressures)[pressures[1:] < critical] / DT
    assert len(rates) > 10
    flow = valve.sonic_mass_flow(nozzle, command + ATMOSPHERIC_PRESSURE, TEMPERATURE)
    assert rates == pytest.approx(AIR_GAS_CONSTANT * TEMPERATURE * flow / VOLUME, rel=1e-9)


@pytest.mark.parametrize("tank", [{}, {"tank_volume": 1e-3, "tank_pressure": MAX_PRESSURE}], ids=["endless", "tank"])
@pytest.mark.parametrize("exponent", [1.0, 1.3])
def test_filling_to_the_full_supply_is_that_of_a_valve(tank: dict[str, float], exponent: float) -> None:
    fillings = [
        simulate(s._replace(polytropic_exponent=exponent, **tank), [MAX_PRESSURE] * 1000, 0.0) for s in (SUPPLY, VALVE)
    ]
    assert fillings[0][0] == pytest.approx(fillings[1][0], rel=1e-12)
    assert fillings[0][1][-1].drawn_mass == pytest.approx(fillings[1][1][-1].drawn_mass, rel=1e-12)


def test_filling_to_a_lower_level_is_slower_than_through_a_valve() -> None:
    restricted, controlled = (simulate(s, [2e5] * 300, 0.0)[0] for s in (SUPPLY, VALVE))
    assert (restricted < controlled)[:100].all()


@pytest.mark.parametrize("exponent", [1.0, 1.3])
def test_air_is_balanced_and_only_supplied_air_is_drawn(exponent: float) -> None:
    time = DT * np.arange(3000)
    commands = np.where(time % 1.0 < 0.5, 4e5, 1e5).tolist()
    volumes = (VOLUME * (1.2 - 0.2 * np.cos(7.0 * DT * np.arange(3001)))).tolist()
    supply = SUPPLY._replace(leak_conductance=2e-11, polytropic_exponent=exponent)
    pressures, states = simulate(supply, commands, 0.0, volumes=volumes)
    drawn, leaked, surplus = (
        np.array([getattr(s, name) for s in states]) for name in ("drawn_mass", "leaked_mass", "surplus_mass")
    )
    relieved = drawn - leaked - surplus  # the muscle starts vented and at rest
    assert np.diff(drawn).min() >= 0.0
    assert np.diff(relieved).min() > -1e-12 * drawn[-1]
    flow = np.diff(drawn) > 0.0
    assert (np.diff(relieved)[flow] < 1e-12 * drawn[-1]).all()  # one direction at a time
    assert flow.any()
    assert (~flow).any()
    if exponent == 1.0:
        held = [air_mass(p, v, TEMPERATURE) for p, v in zip(pressures, volumes[1:], strict=True)]
        assert surplus + air_mass(0.0, VOLUME, TEMPERATURE) == pytest.approx(held, rel=1e-9)


def test_air_returned_to_the_regulator_does_not_refill_the_tank() -> None:
    supply = SUPPLY._replace(tank_volume=1e-3, tank_pressure=MAX_PRESSURE)
    _, states = simulate(supply, [4e5] * 2000 + [0.0] * 2000, 0.0)
    assert states[1999].drawn_mass == pytest.approx(4e5 * VOLUME / (AIR_GAS_CONSTANT * TEMPERATURE), rel=1e-6)
    assert states[-1].drawn_mass == states[1999].drawn_mass
    assert states[-1].surplus_mass == pytest.approx(0.0, abs=1e-3 * states[1999].surplus_mass)


def test_muscle_takes_what_a_low_tank_has_and_keeps_it() -> None:
    """The regulator does not relieve a pressure below the command, and the tank accepts no air."""
    supply = SUPPLY._replace(tank_volume=2e-4, tank_pressure=MAX_PRESSURE)
    steps = 4000
    volumes = [VOLUME] * (steps + 1) + [0.9 * VOLUME] * 200
    pressures, states = simulate(supply, [5e5] * (steps + 200), 0.0, volumes=volumes)
    assert pressures[steps - 1] == pytest.approx(MAX_PRESSURE * 2.0 / 3.0, rel=1e-3)
    compressed = (pressures[steps - 1] + ATMOSPHERIC_PRESSURE) / 0.9 - ATMOSPHERIC_PRESSURE
    assert pressures[-1] == pytest.approx(compressed, rel=1e-6)
    assert states[-1].surplus_mass == states[steps].surplus_mass


def test_air_from_the_room_is_not_drawn() -> None:
    """A muscle that grows at command 0 has less than room pressure, and the open regulator lets in air."""
    volumes = [VOLUME] + [1.3 * VOLUME] * 3000
    pressures, states = simulate(SUPPLY, [0.0] * 3000, 0.0, volumes=volumes)
    assert pressures[0] < -0.2 * ATMOSPHERIC_PRESSURE
    assert pressures[-1] == pytest.approx(0.0, abs=1.0)
    assert states[-1].surplus_mass > 0.0
    assert states[-1].drawn_mass == 0.0


@pytest.mark.slow
@given(st.floats(0.0, 5e5), st.floats(0.5, 30.0), st.floats(1e-11, 1e-7), st.floats(1.0, 1.4))
def test_closed_path_at_constant_command_loses_work(
    command: float, frequency: float, conductance: float, exponent: float
) -> None:
    """The restriction is passive: a muscle that is moved to and fro takes up work."""
    n, dt = 100, 1.0 / (100.0 * frequency)
    supply = SUPPLY._replace(
        fill_conductance=conductance, exhaust_conductance=conductance, polytropic_exponent=exponent
    )
    path = VOLUME * (1.2 + 0.2 * np.sin(2.0 * np.pi * np.arange(4 * n + 1) / n))
    pressures, _ = simulate(supply, [command] * (4 * n), command, dt, path.tolist())
    change, mean = np.diff(path)[-n:], 0.5 * (pressures[-n - 1 : -1] + pressures[-n:])
    work = float(np.sum(mean * change))
    assert work < 2e-3 * float(np.sum(np.abs(mean * change))) + 1e-6


def test_leak_keeps_the_muscle_below_the_command() -> None:
    supply = SUPPLY._replace(leak_conductance=1e-10)
    pressures, states = simulate(supply, [4e5] * 5000, 0.0)
    inflow = valve.mass_flow(NEEDLE, 4e5 + ATMOSPHERIC_PRESSURE, pressures[-1] + ATMOSPHERIC_PRESSURE, TEMPERATURE)
    leak = valve.mass_flow(
        Restriction(1e-10, 0.5), pressures[-1] + ATMOSPHERIC_PRESSURE, ATMOSPHERIC_PRESSURE, TEMPERATURE
    )
    assert pressures[-1] < 4e5 - 100.0
    assert inflow == pytest.approx(leak, rel=1e-6)
    assert (states[-1].drawn_mass - states[-2].drawn_mass) / DT == pytest.approx(leak, rel=1e-6)


def test_valve_of_openings_has_no_regulator_upstream() -> None:
    opened = SUPPLY._replace(command_is_opening=1.0)
    assert has_regulator_upstream(SUPPLY)
    assert not has_regulator_upstream(opened)
    assert not has_regulator_upstream(SUPPLY._replace(fill_conductance=0.0))
    for opening in (1.0, 0.4, -1.0):
        pair = [simulate(opened._replace(regulator_is_upstream=flag), [opening] * 50, 1e5) for flag in (0.0, 1.0)]
        assert pair[0][0].tolist() == pair[1][0].tolist()
        assert pair[0][1] == pair[1][1]


def test_gain_and_pulses_of_a_valve_do_not_move_a_fixed_restriction() -> None:
    driven = SUPPLY._replace(valve_gain=1e-6, pwm_period=0.05, min_pulse=0.01)
    assert simulate(driven, [3e5] * 200, 0.0)[0].tolist() == simulate(SUPPLY, [3e5] * 200, 0.0)[0].tolist()


def test_narrow_restriction_seals_and_wide_one_holds_the_command() -> None:
    for conductance, expected in ((1e-16, 1e5), (1e-3, 3e5)):
        supply = SUPPLY._replace(fill_conductance=conductance, exhaust_conductance=conductance)
        assert simulate(supply, [3e5] * 10, 1e5)[0][-1] == pytest.approx(expected, rel=1e-4)
    assert math.isfinite(simulate(SUPPLY, [3e5], 0.0, dt=1e9)[0][-1])
