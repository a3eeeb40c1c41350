"""Filling and emptying: closed forms, limits, the gas law; what regulator, valve and pulses make of a command."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from klute_sim.laws import pneumatic_step, valve
from klute_sim.laws.pneumatic_step import GasState
from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT, ATMOSPHERIC_PRESSURE, Supply, air_mass
from klute_sim.laws.valve import Restriction

BAR = 1e5
VOLUME = 2e-4
VALVE = Supply(5e5, 100e5, 293.15, 1e-8, 0.4, 0.7e-8, 0.3, valve_gain=50 / BAR)
OPENED = VALVE._replace(valve_gain=0.0, command_is_opening=1.0)
IDEAL = Supply(5e5, 100e5, 293.15)


def flows(
    supply: Supply, command: float, start: float, time: float, step: float = 1e-4, volume: float = VOLUME
) -> tuple[np.ndarray, GasState]:
    """Pressures [Pa] after each step in a muscle that does not move, and what is remembered at the end."""
    pressure, gas, found = start, pneumatic_step.equilibrium_gas(supply, start, volume, volume), []
    for _ in range(round(time / step)):
        air = pneumatic_step.charge(supply, gas, pressure, command, volume, volume, step)
        pressure = pneumatic_step.pressure_after_motion(air, volume)
        gas = pneumatic_step.update_gas(supply, gas, air, pressure, volume, volume)
        found.append(pressure)
    return np.array(found), gas


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
def test_choked_filling_and_venting_take_as_long_as_their_closed_forms(exponent: float) -> None:
    supply = OPENED._replace(max_pressure=19e5, polytropic_exponent=exponent, dead_volume=0.3e-4)
    whole, air = VOLUME + 0.3e-4, (exponent, 293.15)
    fill = valve.filling_time(
        Restriction(1e-8, 0.4),
        *air,
        whole,
        19e5 + ATMOSPHERIC_PRESSURE,
        ATMOSPHERIC_PRESSURE,
        6e5 + ATMOSPHERIC_PRESSURE,
    )
    found, _ = flows(supply, 1.0, 0.0, fill, fill / 1000)
    assert found[-1] == pytest.approx(6e5, rel=1e-9)  # sonic all the way: a straight line, which the step follows
    assert np.ptp(np.diff(found)) < 1e-6 * np.diff(found).mean()
    low = ATMOSPHERIC_PRESSURE / 0.3 - ATMOSPHERIC_PRESSURE
    vent = valve.venting_time(
        Restriction(0.7e-8, 0.3), *air, whole, 6e5 + ATMOSPHERIC_PRESSURE, low + ATMOSPHERIC_PRESSURE
    )
    errors = [abs(flows(supply, -1.0, 6e5, vent, vent / n)[0][-1] / low - 1.0) for n in (200, 400, 800)]
    assert errors[2] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.05)  # first order
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.05)


def test_from_sonic_to_subsonic_it_follows_an_adaptive_integrator() -> None:
    def rate(_: float, state: list[float]) -> list[float]:
        inflow = valve.mass_flow(Restriction(1e-8, 0.4), 5e5 + ATMOSPHERIC_PRESSURE, state[0], 293.15)
        return [AIR_GAS_CONSTANT * 293.15 * inflow / VOLUME]

    times = np.arange(1, 3001) * 1e-4
    exact = (
        solve_ivp(rate, (0.0, 0.3), [ATMOSPHERIC_PRESSURE], t_eval=times, rtol=1e-10, atol=1e-2).y[0]
        - ATMOSPHERIC_PRESSURE
    )
    found, _ = flows(OPENED, 1.0, 0.0, 0.3)
    assert np.abs(found - exact).max() < 2e-3 * 5e5
    critical = 0.4 * (5e5 + ATMOSPHERIC_PRESSURE) - ATMOSPHERIC_PRESSURE
    sonic = np.diff(found)[found[1:] < critical]
    assert np.ptp(sonic) < 1e-6 * sonic.mean()
    assert found[-1] == pytest.approx(5e5, rel=1e-3)
    assert (np.diff(found) >= 0).all()


@given(st.floats(0.0, 5e5), st.floats(-1.0, 1.0), st.floats(1e-5, 1.0), st.floats(1.0, 1.4))
def test_any_step_ends_between_room_and_supply(start: float, opened: float, step: float, exponent: float) -> None:
    supply = OPENED._replace(polytropic_exponent=exponent)
    air = pneumatic_step.charge(
        supply, pneumatic_step.equilibrium_gas(supply, start, VOLUME, VOLUME), start, opened, VOLUME, VOLUME, step
    )
    assert -1e-6 <= air.pressure <= 5e5 + 1e-6
    assert (air.pressure - start) * opened >= -1e-6
    assert air.leaked_mass == 0.0


@given(st.floats(0.5, 2.0), st.floats(1.0, 1.4), st.floats(0.0, 5e5))
def test_closed_air_obeys_its_closed_form(share: float, exponent: float, pressure: float) -> None:
    supply = OPENED._replace(polytropic_exponent=exponent)
    gas = pneumatic_step.equilibrium_gas(supply, pressure, VOLUME, VOLUME)
    air = pneumatic_step.charge(supply, gas, pressure, 0.0, VOLUME, VOLUME, 1e-3)
    moved = pneumatic_step.pressure_after_motion(air, share * VOLUME)
    wanted = (pressure + ATMOSPHERIC_PRESSURE) * share**-exponent - ATMOSPHERIC_PRESSURE
    assert moved == pytest.approx(wanted, rel=1e-12, abs=1e-5)
    after = pneumatic_step.update_gas(supply, gas, air, moved, share * VOLUME, VOLUME)
    assert after == gas  # no air came or went


def pump(supply: Supply, command: np.ndarray, step: float) -> tuple[list[float], list[GasState], list[float]]:
    """Pressures, memories and volumes while the volume swings by a third."""
    volume = VOLUME * (1.0 - np.cos(12.0 * np.arange(len(command) + 1) * step) / 3.0)
    pressure = 0.0
    gas = pneumatic_step.equilibrium_gas(supply, pressure, float(volume[0]), VOLUME)
    pressures, remembered = [pressure], [gas]
    for k, asked in enumerate(command.tolist()):
        air = pneumatic_step.charge(supply, gas, pressure, asked, float(volume[k]), VOLUME, step)
        pressure = pneumatic_step.pressure_after_motion(air, float(volume[k + 1]))
        gas = pneumatic_step.update_gas(supply, gas, air, pressure, float(volume[k + 1]), VOLUME)
        pressures.append(pressure)
        remembered.append(gas)
    return pressures, remembered, volume.tolist()


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
def test_at_constant_temperature_air_obeys_the_gas_law_and_none_is_lost(supply: Supply) -> None:
    command = np.where(np.arange(4000) % 1000 < 500, 4e5, 0.5e5)
    pressures, remembered, volumes = pump(supply, command, 5e-4)
    vented = air_mass(0.0, VOLUME + supply.dead_volume, 293.15)
    for pressure, gas, volume in zip(pressures, remembered, volumes, strict=True):
        held = air_mass(pressure, volume + supply.dead_volume, 293.15)
        assert vented + gas.surplus_mass == pytest.approx(held, rel=1e-9)
    drawn = [gas.drawn_mass for gas in remembered]
    assert all(b >= a for a, b in itertools.pairwise(drawn))
    assert drawn[-1] > 1e-4


def test_warm_air_cools_down_to_the_walls() -> None:
    supply = OPENED._replace(polytropic_exponent=1.4, thermal_time_constant=0.1)
    found, gas = flows(supply, 1.0, 0.0, 0.05)
    hot = found[-1]
    pressure = hot
    for _ in range(20_000):
        air = pneumatic_step.charge(supply, gas, pressure, 0.0, VOLUME, VOLUME, 1e-4)
        pressure = pneumatic_step.pressure_after_motion(air, VOLUME)
        gas = pneumatic_step.update_gas(supply, gas, air, pressure, VOLUME, VOLUME)
    mass = air_mass(0.0, VOLUME, 293.15) + gas.surplus_mass
    assert pressure == pytest.approx(mass * AIR_GAS_CONSTANT * 293.15 / VOLUME - ATMOSPHERIC_PRESSURE, rel=1e-6)
    assert pressure < 0.8 * hot


def test_a_valve_with_a_gain_follows_a_pressure_and_a_leak_leaves_it_short() -> None:
    tight, _ = flows(VALVE, 3e5, 0.0, 0.5)
    assert tight[-1] == pytest.approx(3e5, rel=1e-6)
    leaky, gas = flows(VALVE._replace(leak_conductance=2e-10), 3e5, 0.0, 0.5)
    # At rest the valve is open by what the leak takes: gain times what is missing.
    lost = pneumatic_step.leak_flow(VALVE._replace(leak_conductance=2e-10), leaky[-1], 293.15)
    opened = VALVE.valve_gain * (3e5 - leaky[-1])
    assert pneumatic_step.valve_flow(VALVE, 5e5, leaky[-1], opened, 293.15) == pytest.approx(lost, rel=1e-6)
    assert 10.0 < 3e5 - leaky[-1] < 3e3
    assert gas.drawn_mass == pytest.approx(gas.surplus_mass + 0.5 * lost, rel=0.2)


def test_a_sealed_leak_empties_the_muscle() -> None:
    found, gas = flows(OPENED._replace(leak_conductance=2e-10), 0.0, 5e5, 60.0, 1e-2)
    assert (np.diff(found) <= 0).all()
    assert found[-1] < 1e3
    assert gas.drawn_mass == 0.0


def test_a_tank_gives_what_it_has() -> None:
    supply = OPENED._replace(tank_volume=1e-3, tank_pressure=4e5)
    found, gas = flows(supply, 1.0, 0.0, 2.0)
    # Tank and muscle end at one pressure, at constant temperature.
    together = (4e5 * 1e-3 + 0.0 * VOLUME) / (1e-3 + VOLUME)
    assert found[-1] == pytest.approx(together, rel=2e-3)
    assert pneumatic_step.supply_pressure(supply, gas.drawn_mass) == pytest.approx(together, rel=2e-3)
    ideal = IDEAL._replace(tank_volume=1e-3, tank_pressure=4e5)
    emptied, _ = flows(ideal, 5e5, 0.0, 1.0)
    assert emptied[-1] == pytest.approx(together, rel=5e-2)
    assert pneumatic_step.supply_pressure(IDEAL, 1.0) == IDEAL.max_pressure


@pytest.mark.parametrize("duty", [0.0, 0.13, 0.5, 0.99, 1.0, -0.4])
def test_pulses_are_open_for_their_duty_whatever_the_step(duty: float) -> None:
    supply = VALVE._replace(pwm_period=0.02, min_pulse=0.0)
    for step in (0.02, 3e-3, 5e-4, 0.05):
        told, phase, opened = 0.0, 0.0, 0.0
        for _ in range(2000):
            pulse = pneumatic_step.step_pwm(supply, duty, told, phase, step)
            told, phase = pulse.duty, pulse.phase
            assert 0.0 <= pulse.open_fraction * math.copysign(1.0, duty) <= 1.0 + 1e-9
            opened += pulse.open_fraction * step
        assert opened / (2000 * step) == pytest.approx(duty, abs=1.1 * 0.02 / (2000 * step))


def test_pulses_too_short_are_none_and_pauses_too_short_neither() -> None:
    supply = VALVE._replace(pwm_period=0.02, min_pulse=0.003)
    for asked, share in ((0.1, 0.0), (0.2, 0.2), (-0.9, -1.0)):
        assert pneumatic_step.step_pwm(supply, asked, 0.0, 0.0, 0.02).open_fraction == pytest.approx(share)


def test_a_pulse_is_as_wide_as_was_asked_when_it_began() -> None:
    supply, phase, duty, opened = VALVE._replace(pwm_period=0.02, min_pulse=0.004), 0.0, 0.0, []
    for k in range(40):  # 1 ms each; what is asked turns round in the middle of the first period
        pulse = pneumatic_step.step_pwm(supply, 0.5 if k < 8 else -0.75, duty, phase, 1e-3)
        phase, duty = pulse.phase, pulse.duty
        opened.append(pulse.open_fraction)
    assert opened[:20] == pytest.approx([1.0] * 10 + [0.0] * 10, abs=1e-9)
    assert opened[20:] == pytest.approx([-1.0] * 15 + [0.0] * 5, abs=1e-9)


def test_on_off_pulses_reach_the_same_pressure_with_a_ripple() -> None:
    smooth, _ = flows(VALVE._replace(valve_gain=2 / BAR), 3e5, 0.0, 1.0)
    pulses, _ = flows(VALVE._replace(valve_gain=2 / BAR, pwm_period=0.02, min_pulse=0.001), 3e5, 0.0, 1.0)
    assert pulses[-2000:].mean() == pytest.approx(smooth[-1], rel=0.05)
    rise = slice(0, 500)
    assert np.diff(pulses[rise]).max() > 1.5 * np.diff(smooth[rise]).max() or np.ptp(np.diff(pulses[rise])) > 0.0
    slow, _ = flows(VALVE._replace(valve_gain=0.1 / BAR, pwm_period=0.02, min_pulse=0.001), 3e5, 0.0, 0.2)
    steps = np.diff(slow)
    assert (steps[200:] == 0.0).any()  # shut
    assert steps[200:].max() > 3 * steps[200:].mean()  # or open


def test_a_perfect_pilot_arrives_and_stays() -> None:
    supply = VALVE._replace(valve_gain=0.0)
    found, _ = flows(supply, 3e5, 0.0, 0.2)
    assert found.max() == 3e5 == found[-1]
    down, _ = flows(supply, 1e5, 3e5, 0.3)
    assert down.min() == 1e5 == down[-1]


def test_a_regulator_that_is_slow_to_recover_lags_behind_the_volume() -> None:
    supply = IDEAL._replace(regulator_time_constant=0.05, polytropic_exponent=1.2)
    step = 1e-4
    volume, pressure, gas = VOLUME, 3e5, pneumatic_step.equilibrium_gas(IDEAL, 3e5, VOLUME, VOLUME)
    for _ in range(20_000):
        air = pneumatic_step.charge(supply, gas, pressure, 3e5, volume, VOLUME, step)
        volume *= 1.0 - 2.0 * step  # V'/V = -2 1/s
        pressure = pneumatic_step.pressure_after_motion(air, volume)
        gas = pneumatic_step.update_gas(supply, gas, air, pressure, volume, VOLUME)
    # At rest of the disturbance d: 0 = n (p + d) 2 - d/tau
    squeeze = 1.2 * 2.0 * 0.05
    assert pressure - 3e5 == pytest.approx((3e5 + ATMOSPHERIC_PRESSURE) * squeeze / (1.0 - squeeze), rel=2e-3)


def test_a_regulator_on_a_sunken_tank_creates_no_air() -> None:
    supply = IDEAL._replace(tank_volume=2e-4, tank_pressure=5e5)
    had = 5e5 * 2e-4 / (AIR_GAS_CONSTANT * 293.15)
    command = np.full(8000, 5e5)
    pressures, remembered, volumes = pump(supply, command, 5e-4)
    assert remembered[-1].drawn_mass <= 1.001 * had
    assert min(pressures[4000:]) < 3.5e5
    vented = air_mass(0.0, VOLUME, 293.15)
    for pressure, gas, volume in zip(pressures, remembered, volumes, strict=True):
        assert vented + gas.surplus_mass == pytest.approx(air_mass(pressure, volume, 293.15), rel=1e-9)


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.4])
def test_air_that_comes_and_goes_stays_near_the_rooms_temperature(exponent: float) -> None:
    """The first law keeps mass and pressure together for ever, whatever the exponent; no walls help here."""
    supply = VALVE._replace(polytropic_exponent=exponent, thermal_time_constant=0.0)
    command = np.where(np.arange(40_000) % 2000 < 900, 4e5, 0.5e5)
    pressures, remembered, volumes = pump(supply, command, 1e-3)
    mass = air_mass(0.0, VOLUME, 293.15) + np.array([gas.surplus_mass for gas in remembered])
    warmth = (np.array(pressures) + ATMOSPHERIC_PRESSURE) * np.array(volumes) / (AIR_GAS_CONSTANT * mass)
    assert (mass > 0.0).all()
    assert warmth.min() > 293.15 * (1.0 if exponent == 1.0 else 0.6) - 1e-6
    assert warmth.max() < 293.15 * (1.0 if exponent == 1.0 else 1.5) + 1e-6
    early, late = mass[2000:20_000], mass[20_000:]
    assert late.max() == pytest.approx(early.max(), rel=0.02)
    assert late.min() == pytest.approx(early.min(), rel=0.02)


def test_being_squeezed_takes_no_air_from_a_slow_regulator() -> None:
    supply = IDEAL._replace(regulator_time_constant=1e3, polytropic_exponent=1.2)
    gas, pressure = pneumatic_step.equilibrium_gas(supply, 3e5, VOLUME, VOLUME), 3e5
    air = pneumatic_step.charge(supply, gas, pressure, 3e5, VOLUME, VOLUME, 1e-3)
    pressure = pneumatic_step.pressure_after_motion(air, 0.99 * VOLUME)
    assert pressure == pytest.approx((3e5 + ATMOSPHERIC_PRESSURE) * 0.99**-1.2 - ATMOSPHERIC_PRESSURE, rel=1e-4)
    after = pneumatic_step.update_gas(supply, gas, air, pressure, 0.99 * VOLUME, VOLUME)
    assert after.drawn_mass < 0.02 * 0.01 * air_mass(3e5, VOLUME, 293.15)


def test_emptying_has_its_own_critical_ratio() -> None:
    first, second = (
        flows(OPENED._replace(exhaust_critical_ratio=b), -1.0, 0.5e5, 0.05)[0][-1]
        for b in (0.1, 0.6)  # subsonic all the way
    )
    assert second < 0.9 * first
    assert (
        flows(OPENED._replace(fill_critical_ratio=0.9), -1.0, 0.5e5, 0.05)[0][-1]
        == flows(OPENED, -1.0, 0.5e5, 0.05)[0][-1]
    )


def test_a_perfect_pilot_is_no_faster_than_its_rate() -> None:
    found, _ = flows(
        VALVE._replace(valve_gain=0.0, max_pressure_rate=2e5, fill_conductance=1e-6, exhaust_conductance=1e-6),
        3e5,
        0.0,
        0.5,
    )
    assert np.diff(found).max() == pytest.approx(2e5 * 1e-4, rel=1e-9)


def test_a_leak_empties_as_fast_as_its_closed_form() -> None:
    low = ATMOSPHERIC_PRESSURE / 0.5
    time = valve.venting_time(Restriction(2e-9, 0.5), 1.0, 293.15, VOLUME, 6e5 + ATMOSPHERIC_PRESSURE, low)
    found, gas = flows(OPENED._replace(leak_conductance=2e-9), 0.0, 6e5, time, time / 4000)
    assert found[-1] == pytest.approx(low - ATMOSPHERIC_PRESSURE, rel=2e-3)
    assert gas.leaked_mass == pytest.approx(
        air_mass(6e5, VOLUME, 293.15) - air_mass(found[-1], VOLUME, 293.15), rel=1e-9
    )


def test_a_leak_larger_than_the_regulators_rate_wins() -> None:
    found, _ = flows(IDEAL._replace(leak_conductance=1e-8, max_pressure_rate=1e5), 5e5, 4e5, 0.5)
    assert found[-1] < 3e5


def test_a_full_bottle_gives_no_more_than_the_supply() -> None:
    found, _ = flows(OPENED._replace(tank_volume=1e-3, tank_pressure=200e5), 1.0, 0.0, 3.0)
    assert found.max() <= 5e5 + 1e-6


def test_warming_counts_the_dead_volume() -> None:
    supply = OPENED._replace(polytropic_exponent=1.4, thermal_time_constant=0.01, dead_volume=1e-4)
    found, gas = flows(supply, 0.0, 2e5, 0.5)
    assert found == pytest.approx(np.full(len(found), 2e5), rel=1e-9)  # it has the walls' temperature already
    assert gas.drawn_mass == 0.0


def test_no_air_goes_back_into_a_sunken_tank() -> None:
    supply = OPENED._replace(tank_volume=1e-3, tank_pressure=2e5)
    found, gas = flows(supply, 1.0, 4e5, 0.5)
    assert found == pytest.approx(np.full(len(found), 4e5), rel=1e-9)
    assert gas.drawn_mass == 0.0
