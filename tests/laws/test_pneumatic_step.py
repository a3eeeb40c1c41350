"""Filling and emptying: closed forms, limits, the gas law, and the response of regulator, valve and pulses."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from klute_sim.laws import pneumatic_step, supply_valve, valve
from klute_sim.laws.pneumatic_step import GasState
from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT, ATMOSPHERIC_PRESSURE, SupplyParameters, air_mass
from klute_sim.laws.valve import Restriction

BAR = 1e5
VOLUME = 2e-4
VALVE = SupplyParameters(5e5, 100e5, 293.15, 1e-8, 0.4, 0.7e-8, 0.3, valve_gain=50 / BAR)
OPENED = VALVE._replace(valve_gain=0.0, command_is_opening=1.0)
IDEAL = SupplyParameters(5e5, 100e5, 293.15)


def simulate_fixed_volume(
    supply: SupplyParameters, command: float, start: float, time: float, dt: float = 1e-4, volume: float = VOLUME
) -> tuple[np.ndarray, GasState]:
    """Return the pressures [Pa] after each step in a muscle of constant volume, and the final gas state."""
    pressure, gas, pressures = start, pneumatic_step.equilibrium_gas(supply, start, volume, volume), []
    for _ in range(round(time / dt)):
        air = pneumatic_step.charge(supply, gas, pressure, command, volume, volume, dt)
        pressure = pneumatic_step.pressure_after_motion(air, volume)
        gas = pneumatic_step.update_gas(supply, gas, air, pressure, volume, volume)
        pressures.append(pressure)
    return np.array(pressures), gas


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
def test_choked_filling_and_venting_match_their_closed_forms(exponent: float) -> None:
    supply = OPENED._replace(max_pressure=19e5, polytropic_exponent=exponent, dead_volume=0.3e-4)
    total_volume, air = VOLUME + 0.3e-4, (exponent, 293.15)
    fill = valve.filling_time(
        Restriction(1e-8, 0.4),
        *air,
        total_volume,
        19e5 + ATMOSPHERIC_PRESSURE,
        ATMOSPHERIC_PRESSURE,
        6e5 + ATMOSPHERIC_PRESSURE,
    )
    pressures, _ = simulate_fixed_volume(supply, 1.0, 0.0, fill, fill / 1000)
    assert pressures[-1] == pytest.approx(6e5, rel=1e-9)  # sonic throughout: the pressure rises linearly
    assert np.ptp(np.diff(pressures)) < 1e-6 * np.diff(pressures).mean()
    low = ATMOSPHERIC_PRESSURE / 0.3 - ATMOSPHERIC_PRESSURE
    vent = valve.venting_time(
        Restriction(0.7e-8, 0.3), *air, total_volume, 6e5 + ATMOSPHERIC_PRESSURE, low + ATMOSPHERIC_PRESSURE
    )
    errors = [abs(simulate_fixed_volume(supply, -1.0, 6e5, vent, vent / n)[0][-1] / low - 1.0) for n in (200, 400, 800)]
    assert errors[2] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.05)  # first order
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.05)


def test_filling_matches_an_adaptive_integrator() -> None:
    def rate(_: float, state: list[float]) -> list[float]:
        inflow = valve.mass_flow(Restriction(1e-8, 0.4), 5e5 + ATMOSPHERIC_PRESSURE, state[0], 293.15)
        return [AIR_GAS_CONSTANT * 293.15 * inflow / VOLUME]

    times = np.arange(1, 3001) * 1e-4
    exact = (
        solve_ivp(rate, (0.0, 0.3), [ATMOSPHERIC_PRESSURE], t_eval=times, rtol=1e-10, atol=1e-2).y[0]
        - ATMOSPHERIC_PRESSURE
    )
    pressures, _ = simulate_fixed_volume(OPENED, 1.0, 0.0, 0.3)
    assert np.abs(pressures - exact).max() < 2e-3 * 5e5
    critical = 0.4 * (5e5 + ATMOSPHERIC_PRESSURE) - ATMOSPHERIC_PRESSURE
    sonic = np.diff(pressures)[pressures[1:] < critical]
    assert np.ptp(sonic) < 1e-6 * sonic.mean()
    assert pressures[-1] == pytest.approx(5e5, rel=1e-3)
    assert (np.diff(pressures) >= 0).all()


@given(st.floats(0.0, 5e5), st.floats(-1.0, 1.0), st.floats(1e-5, 1.0), st.floats(1.0, 1.4))
def test_pressure_stays_between_room_and_supply_for_any_step(
    start: float, opening: float, dt: float, exponent: float
) -> None:
    supply = OPENED._replace(polytropic_exponent=exponent)
    air = pneumatic_step.charge(
        supply, pneumatic_step.equilibrium_gas(supply, start, VOLUME, VOLUME), start, opening, VOLUME, VOLUME, dt
    )
    assert -1e-6 <= air.pressure <= 5e5 + 1e-6
    assert (air.pressure - start) * opening >= -1e-6
    assert air.leaked_mass == 0.0


@given(st.floats(0.5, 2.0), st.floats(1.0, 1.4), st.floats(0.0, 5e5))
def test_enclosed_air_matches_its_closed_form(fraction: float, exponent: float, pressure: float) -> None:
    supply = OPENED._replace(polytropic_exponent=exponent)
    gas = pneumatic_step.equilibrium_gas(supply, pressure, VOLUME, VOLUME)
    air = pneumatic_step.charge(supply, gas, pressure, 0.0, VOLUME, VOLUME, 1e-3)
    pressure_after = pneumatic_step.pressure_after_motion(air, fraction * VOLUME)
    expected = (pressure + ATMOSPHERIC_PRESSURE) * fraction**-exponent - ATMOSPHERIC_PRESSURE
    assert pressure_after == pytest.approx(expected, rel=1e-12, abs=1e-5)
    after = pneumatic_step.update_gas(supply, gas, air, pressure_after, fraction * VOLUME, VOLUME)
    assert after == gas  # no air came or went


def simulate_pumping(
    supply: SupplyParameters, command: np.ndarray, dt: float
) -> tuple[list[float], list[GasState], list[float]]:
    """Return pressures, gas states and volumes while the volume oscillates by a third."""
    volume = VOLUME * (1.0 - np.cos(12.0 * np.arange(len(command) + 1) * dt) / 3.0)
    pressure = 0.0
    gas = pneumatic_step.equilibrium_gas(supply, pressure, float(volume[0]), VOLUME)
    pressures, gas_states = [pressure], [gas]
    for k, commanded in enumerate(command.tolist()):
        air = pneumatic_step.charge(supply, gas, pressure, commanded, float(volume[k]), VOLUME, dt)
        pressure = pneumatic_step.pressure_after_motion(air, float(volume[k + 1]))
        gas = pneumatic_step.update_gas(supply, gas, air, pressure, float(volume[k + 1]), VOLUME)
        pressures.append(pressure)
        gas_states.append(gas)
    return pressures, gas_states, volume.tolist()


@pytest.mark.parametrize(
    "supply",
    [
        VALVE,
        VALVE._replace(dead_volume=3e-5, leak_conductance=2e-10),
        VALVE._replace(tank_volume=1e-3, tank_pressure=6e5, leak_conductance=2e-10),
        VALVE._replace(pwm_period=0.02, min_pulse=0.002),
        IDEAL._replace(leak_conductance=2e-10),
        IDEAL._replace(regulator_time_constant=0.05, polytropic_exponent=1.0),
    ],
    ids=["valve", "leak", "tank", "pulses", "regulator", "slow regulator"],
)
def test_isothermal_air_satisfies_the_gas_law_and_mass_is_conserved(supply: SupplyParameters) -> None:
    command = np.where(np.arange(4000) % 1000 < 500, 4e5, 0.5e5)
    pressures, gas_states, volumes = simulate_pumping(supply, command, 5e-4)
    vented = air_mass(0.0, VOLUME + supply.dead_volume, 293.15)
    for pressure, gas, volume in zip(pressures, gas_states, volumes, strict=True):
        held = air_mass(pressure, volume + supply.dead_volume, 293.15)
        assert vented + gas.surplus_mass == pytest.approx(held, rel=1e-9)
    drawn = [gas.drawn_mass for gas in gas_states]
    assert all(b >= a for a, b in itertools.pairwise(drawn))
    assert drawn[-1] > 1e-4


def test_warm_air_cools_to_the_wall_temperature() -> None:
    supply = OPENED._replace(polytropic_exponent=1.4, thermal_time_constant=0.1)
    pressures, gas = simulate_fixed_volume(supply, 1.0, 0.0, 0.05)
    hot = pressures[-1]
    pressure = hot
    for _ in range(20_000):
        air = pneumatic_step.charge(supply, gas, pressure, 0.0, VOLUME, VOLUME, 1e-4)
        pressure = pneumatic_step.pressure_after_motion(air, VOLUME)
        gas = pneumatic_step.update_gas(supply, gas, air, pressure, VOLUME, VOLUME)
    mass = air_mass(0.0, VOLUME, 293.15) + gas.surplus_mass
    assert pressure == pytest.approx(mass * AIR_GAS_CONSTANT * 293.15 / VOLUME - ATMOSPHERIC_PRESSURE, rel=1e-6)
    assert pressure < 0.8 * hot


def test_proportional_valve_follows_a_pressure_with_an_error_under_leakage() -> None:
    tight, _ = simulate_fixed_volume(VALVE, 3e5, 0.0, 0.5)
    assert tight[-1] == pytest.approx(3e5, rel=1e-6)
    leaky, gas = simulate_fixed_volume(VALVE._replace(leak_conductance=2e-10), 3e5, 0.0, 0.5)
    # At rest the valve is open by what the leak takes: gain times what is missing.
    lost = supply_valve.leak_flow(VALVE._replace(leak_conductance=2e-10), leaky[-1], 293.15)
    opening = VALVE.valve_gain * (3e5 - leaky[-1])
    assert supply_valve.valve_flow(VALVE, 5e5, 0.0, leaky[-1], opening, 293.15) == pytest.approx(lost, rel=1e-6)
    assert 10.0 < 3e5 - leaky[-1] < 3e3
    assert gas.drawn_mass == pytest.approx(gas.surplus_mass + 0.5 * lost, rel=0.2)


def test_leak_empties_a_sealed_muscle() -> None:
    pressures, gas = simulate_fixed_volume(OPENED._replace(leak_conductance=2e-10), 0.0, 5e5, 60.0, 1e-2)
    assert (np.diff(pressures) <= 0).all()
    assert pressures[-1] < 1e3
    assert gas.drawn_mass == 0.0


def test_tank_and_muscle_equalize() -> None:
    supply = OPENED._replace(tank_volume=1e-3, tank_pressure=4e5)
    pressures, gas = simulate_fixed_volume(supply, 1.0, 0.0, 2.0)
    # Tank and muscle end at one pressure, at constant temperature.
    together = (4e5 * 1e-3 + 0.0 * VOLUME) / (1e-3 + VOLUME)
    assert pressures[-1] == pytest.approx(together, rel=2e-3)
    assert pneumatic_step.supply_pressure(supply, gas.drawn_mass) == pytest.approx(together, rel=2e-3)
    ideal = IDEAL._replace(tank_volume=1e-3, tank_pressure=4e5)
    emptied, _ = simulate_fixed_volume(ideal, 5e5, 0.0, 1.0)
    assert emptied[-1] == pytest.approx(together, rel=5e-2)
    assert pneumatic_step.supply_pressure(IDEAL, 1.0) == IDEAL.max_pressure


@pytest.mark.parametrize("duty", [0.0, 0.13, 0.5, 0.99, 1.0, -0.4])
def test_pulses_are_open_for_their_duty_at_any_step(duty: float) -> None:
    supply = VALVE._replace(pwm_period=0.02, min_pulse=0.0)
    for dt in (0.02, 3e-3, 5e-4, 0.05):
        duty_at_start, phase, opening = 0.0, 0.0, 0.0
        for _ in range(2000):
            pulse = supply_valve.step_pwm(supply, duty, duty_at_start, phase, dt)
            duty_at_start, phase = pulse.duty, pulse.phase
            assert 0.0 <= pulse.open_fraction * math.copysign(1.0, duty) <= 1.0 + 1e-9
            opening += pulse.open_fraction * dt
        assert opening / (2000 * dt) == pytest.approx(duty, abs=1.1 * 0.02 / (2000 * dt))


def test_short_pulses_are_omitted_and_short_pauses_closed() -> None:
    supply = VALVE._replace(pwm_period=0.02, min_pulse=0.003)
    for commanded, fraction in ((0.1, 0.0), (0.2, 0.2), (-0.9, -1.0)):
        assert supply_valve.step_pwm(supply, commanded, 0.0, 0.0, 0.02).open_fraction == pytest.approx(fraction)


def test_pulse_has_the_width_commanded_at_its_start() -> None:
    supply, phase, duty, opening = VALVE._replace(pwm_period=0.02, min_pulse=0.004), 0.0, 0.0, []
    for k in range(40):  # 1 ms each; the command reverses in the middle of the first period
        pulse = supply_valve.step_pwm(supply, 0.5 if k < 8 else -0.75, duty, phase, 1e-3)
        phase, duty = pulse.phase, pulse.duty
        opening.append(pulse.open_fraction)
    assert opening[:20] == pytest.approx([1.0] * 10 + [0.0] * 10, abs=1e-9)
    assert opening[20:] == pytest.approx([-1.0] * 15 + [0.0] * 5, abs=1e-9)


def test_pulses_reach_the_same_pressure_with_a_ripple() -> None:
    smooth, _ = simulate_fixed_volume(VALVE._replace(valve_gain=2 / BAR), 3e5, 0.0, 1.0)
    pulses, _ = simulate_fixed_volume(
        VALVE._replace(valve_gain=2 / BAR, pwm_period=0.02, min_pulse=0.001), 3e5, 0.0, 1.0
    )
    assert pulses[-2000:].mean() == pytest.approx(smooth[-1], rel=0.05)
    rise = slice(0, 500)
    assert np.diff(pulses[rise]).max() > 1.5 * np.diff(smooth[rise]).max() or np.ptp(np.diff(pulses[rise])) > 0.0
    slow, _ = simulate_fixed_volume(
        VALVE._replace(valve_gain=0.1 / BAR, pwm_period=0.02, min_pulse=0.001), 3e5, 0.0, 0.2
    )
    steps = np.diff(slow)
    assert (steps[200:] == 0.0).any()  # shut
    assert steps[200:].max() > 3 * steps[200:].mean()  # or open


def test_ideal_pilot_stage_reaches_and_holds_the_target() -> None:
    supply = VALVE._replace(valve_gain=0.0)
    pressures, _ = simulate_fixed_volume(supply, 3e5, 0.0, 0.2)
    assert pressures.max() == 3e5 == pressures[-1]
    down, _ = simulate_fixed_volume(supply, 1e5, 3e5, 0.3)
    assert down.min() == 1e5 == down[-1]


@pytest.mark.parametrize("command", [1e5, 2.9e5, 3e5, 4.5e5])
@pytest.mark.parametrize("leak", [0.0, 1e-10, 1e-8, 1e-6])
def test_pilot_stage_adds_no_more_air_to_a_leak_than_its_valve_passes(leak: float, command: float) -> None:
    """The rate limits the valve, not the fall that a leak causes: missing air would look like supplied air."""
    supply = VALVE._replace(valve_gain=0.0, max_pressure_rate=2e6, leak_conductance=leak)
    pressure, gas, dt = 3e5, pneumatic_step.equilibrium_gas(supply, 3e5, VOLUME, VOLUME), 1e-3
    for _ in range(200):
        air = pneumatic_step.charge(supply, gas, pressure, command, VOLUME, VOLUME, dt)
        if air.valve_mass > 0.0:
            capacity = supply_valve.valve_flow(supply, 5e5, 0.0, air.pressure, 1.0, 293.15) * dt
        else:
            capacity = -supply_valve.valve_flow(supply, 5e5, 0.0, air.pressure, -1.0, 293.15) * dt
        assert abs(air.valve_mass) <= capacity * (1.0 + 1e-6) + 1e-15
        pressure = pneumatic_step.pressure_after_motion(air, VOLUME)
        gas = pneumatic_step.update_gas(supply, gas, air, pressure, VOLUME, VOLUME)
    if leak == 1e-6:
        assert pressure < 1e4  # burst
    elif leak <= 1e-10:
        assert pressure == pytest.approx(command, abs=1e-6)


def test_slow_regulator_lags_behind_the_volume() -> None:
    supply = IDEAL._replace(regulator_time_constant=0.05, polytropic_exponent=1.2)
    dt = 1e-4
    volume, pressure, gas = VOLUME, 3e5, pneumatic_step.equilibrium_gas(IDEAL, 3e5, VOLUME, VOLUME)
    for _ in range(20_000):
        air = pneumatic_step.charge(supply, gas, pressure, 3e5, volume, VOLUME, dt)
        volume *= 1.0 - 2.0 * dt  # V'/V = -2 1/s
        pressure = pneumatic_step.pressure_after_motion(air, volume)
        gas = pneumatic_step.update_gas(supply, gas, air, pressure, volume, VOLUME)
    # At rest of the disturbance d: 0 = n (p + d) 2 - d/tau
    squeeze = 1.2 * 2.0 * 0.05
    assert pressure - 3e5 == pytest.approx((3e5 + ATMOSPHERIC_PRESSURE) * squeeze / (1.0 - squeeze), rel=2e-3)


def test_regulator_on_an_empty_tank_creates_no_air() -> None:
    supply = IDEAL._replace(tank_volume=2e-4, tank_pressure=5e5)
    had = 5e5 * 2e-4 / (AIR_GAS_CONSTANT * 293.15)
    command = np.full(8000, 5e5)
    pressures, gas_states, volumes = simulate_pumping(supply, command, 5e-4)
    assert gas_states[-1].drawn_mass <= 1.001 * had
    assert min(pressures[4000:]) < 3.5e5
    vented = air_mass(0.0, VOLUME, 293.15)
    for pressure, gas, volume in zip(pressures, gas_states, volumes, strict=True):
        assert vented + gas.surplus_mass == pytest.approx(air_mass(pressure, volume, 293.15), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
def test_cycled_air_stays_near_room_temperature(exponent: float) -> None:
    """The first law keeps mass and pressure together for ever, whatever the exponent; no walls help here."""
    supply = VALVE._replace(polytropic_exponent=exponent, thermal_time_constant=0.0)
    command = np.where(np.arange(40_000) % 2000 < 900, 4e5, 0.5e5)
    pressures, gas_states, volumes = simulate_pumping(supply, command, 1e-3)
    mass = air_mass(0.0, VOLUME, 293.15) + np.array([gas.surplus_mass for gas in gas_states])
    warmth = (np.array(pressures) + ATMOSPHERIC_PRESSURE) * np.array(volumes) / (AIR_GAS_CONSTANT * mass)
    assert (mass > 0.0).all()
    assert warmth.min() > 293.15 * (1.0 if exponent == 1.0 else 0.6) - 1e-6
    assert warmth.max() < 293.15 * (1.0 if exponent == 1.0 else 1.5) + 1e-6
    early, late = mass[2000:20_000], mass[20_000:]
    assert late.max() == pytest.approx(early.max(), rel=0.02)
    assert late.min() == pytest.approx(early.min(), rel=0.02)


def test_compression_draws_no_air_from_a_slow_regulator() -> None:
    supply = IDEAL._replace(regulator_time_constant=1e3, polytropic_exponent=1.2)
    gas, pressure = pneumatic_step.equilibrium_gas(supply, 3e5, VOLUME, VOLUME), 3e5
    air = pneumatic_step.charge(supply, gas, pressure, 3e5, VOLUME, VOLUME, 1e-3)
    pressure = pneumatic_step.pressure_after_motion(air, 0.99 * VOLUME)
    assert pressure == pytest.approx((3e5 + ATMOSPHERIC_PRESSURE) * 0.99**-1.2 - ATMOSPHERIC_PRESSURE, rel=1e-4)
    after = pneumatic_step.update_gas(supply, gas, air, pressure, 0.99 * VOLUME, VOLUME)
    assert after.drawn_mass < 0.02 * 0.01 * air_mass(3e5, VOLUME, 293.15)


def test_exhaust_has_its_own_critical_ratio() -> None:
    first, second = (
        simulate_fixed_volume(OPENED._replace(exhaust_critical_ratio=b), -1.0, 0.5e5, 0.05)[0][-1]
        for b in (0.1, 0.6)  # subsonic all the way
    )
    assert second < 0.9 * first
    assert (
        simulate_fixed_volume(OPENED._replace(fill_critical_ratio=0.9), -1.0, 0.5e5, 0.05)[0][-1]
        == simulate_fixed_volume(OPENED, -1.0, 0.5e5, 0.05)[0][-1]
    )


def test_ideal_pilot_stage_respects_the_maximum_rate() -> None:
    pressures, _ = simulate_fixed_volume(
        VALVE._replace(valve_gain=0.0, max_pressure_rate=2e5, fill_conductance=1e-6, exhaust_conductance=1e-6),
        3e5,
        0.0,
        0.5,
    )
    assert np.diff(pressures).max() == pytest.approx(2e5 * 1e-4, rel=1e-9)


def test_leak_matches_its_closed_form() -> None:
    low = ATMOSPHERIC_PRESSURE / 0.5
    time = valve.venting_time(Restriction(2e-9, 0.5), 1.0, 293.15, VOLUME, 6e5 + ATMOSPHERIC_PRESSURE, low)
    pressures, gas = simulate_fixed_volume(OPENED._replace(leak_conductance=2e-9), 0.0, 6e5, time, time / 4000)
    assert pressures[-1] == pytest.approx(low - ATMOSPHERIC_PRESSURE, rel=2e-3)
    assert gas.leaked_mass == pytest.approx(
        air_mass(6e5, VOLUME, 293.15) - air_mass(pressures[-1], VOLUME, 293.15), rel=1e-9
    )


def test_large_leak_exceeds_the_regulator_rate() -> None:
    pressures, _ = simulate_fixed_volume(IDEAL._replace(leak_conductance=1e-8, max_pressure_rate=1e5), 5e5, 4e5, 0.5)
    assert pressures[-1] < 3e5


def test_full_tank_does_not_exceed_the_supply_pressure() -> None:
    pressures, _ = simulate_fixed_volume(OPENED._replace(tank_volume=1e-3, tank_pressure=200e5), 1.0, 0.0, 3.0)
    assert pressures.max() <= 5e5 + 1e-6


def test_thermal_exchange_includes_the_dead_volume() -> None:
    supply = OPENED._replace(polytropic_exponent=1.4, thermal_time_constant=0.01, dead_volume=1e-4)
    pressures, gas = simulate_fixed_volume(supply, 0.0, 2e5, 0.5)
    assert pressures == pytest.approx(
        np.full(len(pressures), 2e5), rel=1e-9
    )  # the air has the wall temperature already
    assert gas.drawn_mass == 0.0


def test_no_air_flows_back_into_an_empty_tank() -> None:
    supply = OPENED._replace(tank_volume=1e-3, tank_pressure=2e5)
    pressures, gas = simulate_fixed_volume(supply, 1.0, 4e5, 0.5)
    assert pressures == pytest.approx(np.full(len(pressures), 4e5), rel=1e-9)
    assert gas.drawn_mass == 0.0


def test_full_tank_makes_up_for_a_leak_at_the_largest_command() -> None:
    supply = IDEAL._replace(tank_volume=1e-3, tank_pressure=200e5, leak_conductance=2e-10)
    pressures, gas = simulate_fixed_volume(supply, IDEAL.max_pressure, IDEAL.max_pressure, 0.5)
    assert pressures == pytest.approx(np.full(len(pressures), IDEAL.max_pressure), rel=1e-3)
    assert gas.drawn_mass == pytest.approx(gas.leaked_mass, rel=0.05)
    assert gas.leaked_mass > 0.0


@pytest.mark.parametrize("exponent", [1.0, 1.2])
def test_air_above_the_pressure_of_a_slow_regulator_leaks(exponent: float) -> None:
    """Compressed air leaks at its own pressure, and no air is drawn until that of the regulator is reached."""
    supply = IDEAL._replace(leak_conductance=5e-9, regulator_time_constant=1e6, polytropic_exponent=exponent)
    gas = pneumatic_step.equilibrium_gas(supply, 1e5, VOLUME, VOLUME)
    air = pneumatic_step.charge(supply, gas, 1e5, 1e5, 1.5 * VOLUME, VOLUME, 1e-6)
    pressure = pneumatic_step.pressure_after_motion(air, VOLUME)
    gas = pneumatic_step.update_gas(supply, gas, air, pressure, VOLUME, VOLUME)
    first, drawn, leaked = pressure, gas.drawn_mass, gas.leaked_mass
    assert first > 1.5e5
    while pressure > 1.2e5:
        air = pneumatic_step.charge(supply, gas, pressure, 1e5, VOLUME, VOLUME, 1e-4)
        pressure = pneumatic_step.pressure_after_motion(air, VOLUME)
        gas = pneumatic_step.update_gas(supply, gas, air, pressure, VOLUME, VOLUME)
    assert gas.drawn_mass == pytest.approx(drawn, abs=1e-9 * leaked + 1e-15)
    lost = (first - pressure) * VOLUME / (AIR_GAS_CONSTANT * 293.15 * exponent)
    assert gas.leaked_mass - leaked == pytest.approx(lost, rel=1e-6)
