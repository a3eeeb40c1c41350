"""A hose: size of its resistance, volume and delay against closed forms, limits, and direction of the flow."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.device.device import load_device
from klute_sim.device.dynamics import ZERO_INTERNAL_STATE, DeviceParameters, apply_supply_effects, get_dead_time
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.effects.families.hose import attach_hose
from klute_sim.errors import InputError
from klute_sim.laws import mckibben, valve
from klute_sim.laws.pneumatics import AIR_GAS_CONSTANT, ATMOSPHERIC_PRESSURE
from klute_sim.units import BAR
from tests.effects.devices import activate

SLOT = catalogue.find_slot("hose", "tube")
BARE = load_device("klute-3-4").parameters
BARE = BARE._replace(supply=BARE.supply._replace(max_pressure_rate=1e12))
STEP = 1e-4
SOUND = 343.2
"""Speed of sound in air of 20 degrees Celsius [m/s], from tables."""


def attach(length: float, diameter_mm: float, device: DeviceParameters = BARE) -> DeviceParameters:
    return activate(SLOT, {"length_m": length, "inner_diameter_mm": diameter_mm}, device)


def measure_pressure(device: DeviceParameters, start: float, command: float, time: float) -> np.ndarray:
    """Return the absolute pressure [Pa] of a clamped muscle, one sample per step."""
    length = 0.9 * BARE.muscle.resting_length
    count = round(time / STEP)
    state = compute_taut_state(device, length, start)
    trace = simulate_rollouts(
        device, np.full(count, length), np.full(count, command), STEP, initial_state=state, backend="python"
    )
    return np.asarray(trace.pressure) + ATMOSPHERIC_PRESSURE


@pytest.mark.parametrize(("length", "diameter_mm"), [(2.0, 4.0), (4.0, 4.0), (2.0, 2.5)])
def test_muscle_fills_and_empties_in_the_time_that_friction_demands(length: float, diameter_mm: float) -> None:
    """Isothermal pipe: ``dp/dt = (A/V) sqrt(R T d/(f L)) sqrt(p1^2 - p2^2)``, whose solutions are sine and cosh."""
    diameter, f = 1e-3 * diameter_mm, 0.02
    bore = math.pi / 4 * diameter**2
    gas = AIR_GAS_CONSTANT * BARE.supply.temperature
    room = mckibben.gas_volume(BARE.muscle, 0.9 * BARE.muscle.resting_length) + BARE.supply.dead_volume + bore * length
    rate = bore / room * math.sqrt(gas * diameter / (f * length))
    device, source = attach(length, diameter_mm), BARE.supply.max_pressure + ATMOSPHERIC_PRESSURE
    end = 0.8 * source
    expected = (math.asin(end / source) - math.asin(ATMOSPHERIC_PRESSURE / source)) / rate
    pressure = measure_pressure(device, 0.0, BARE.supply.max_pressure, 1.5 * expected)
    crossed = np.interp(end, pressure, STEP * np.arange(1, len(pressure) + 1))
    assert crossed == pytest.approx(expected, rel=0.02)
    low = 1.5 * ATMOSPHERIC_PRESSURE
    expected = (math.acosh(source / ATMOSPHERIC_PRESSURE) - math.acosh(low / ATMOSPHERIC_PRESSURE)) / rate
    pressure = measure_pressure(device, BARE.supply.max_pressure, 0.0, 1.5 * expected)
    crossed = np.interp(-low, -pressure, STEP * np.arange(1, len(pressure) + 1))
    assert crossed == pytest.approx(expected, rel=0.02)


@given(st.floats(0.01, 20.0), st.floats(1.0, 20.0))
def test_volume_is_that_of_a_cylinder_and_delay_that_of_sound(length: float, diameter_mm: float) -> None:
    device = attach(length, diameter_mm)
    added = apply_supply_effects(device, ZERO_INTERNAL_STATE).dead_volume - BARE.supply.dead_volume
    assert added == pytest.approx(math.pi * (0.5e-3 * diameter_mm) ** 2 * length, rel=1e-9)
    assert get_dead_time(device) == pytest.approx(length / SOUND, rel=1e-3)


def test_step_arrives_late_by_the_travel_of_sound() -> None:
    """Two hoses of one resistance and, but for their own volumes, one filling; the longer one starts later."""
    length = 0.9 * BARE.muscle.resting_length
    for hose in (2.0, 8.0):
        device = attach(hose, 6.0)
        command = np.where(np.arange(600) < 100, 0.0, 4.0 * BAR)
        trace = simulate_rollouts(
            device,
            np.full(600, length),
            command,
            STEP,
            initial_state=compute_taut_state(device, length, 0.0),
            backend="python",
        )
        began = STEP * int(np.argmax(np.asarray(trace.pressure) > 1.0)) - 100 * STEP
        assert began == pytest.approx(hose / SOUND, abs=1.5 * STEP)


def test_delay_adds_to_that_of_the_valve() -> None:
    values = catalogue.pack_effects(
        {
            ("hose", "tube"): {"length_m": 3.0, "inner_diameter_mm": 4.0},
            ("pressure_delay", "dead_time"): {"delay_s": 0.04},
        }
    )
    assert get_dead_time(BARE._replace(effects=values)) == pytest.approx(0.04 + 3.0 / SOUND, rel=1e-4)


@pytest.mark.parametrize("preset", ["klute-3-4-pair", "klute-1-1-4-pair"])
def test_hose_without_length_changes_no_bit(preset: str) -> None:
    bare = load_device(preset).parameters
    time = np.arange(400) * 5e-4
    length = bare.tendon.slack_length + bare.muscle.resting_length * (0.95 + 0.03 * np.sin(12.0 * time))
    command = 2.0 * BAR + 1.5 * BAR * np.sin(7.0 * time)
    plain, neutral = (
        simulate_rollouts(device, length, command, 5e-4, backend="python") for device in (bare, attach(0.0, 4.0, bare))
    )
    for field in ("tension", "pressure", "length"):
        assert (getattr(plain, field) == getattr(neutral, field)).all()


def test_hose_of_the_smallest_number_is_none() -> None:
    """A bounded fit tries such lengths, whose resistance is zero in rounding."""
    bare = load_device("klute-3-4-pair").parameters
    supply = apply_supply_effects(bare, ZERO_INTERNAL_STATE)
    assert attach_hose(SimpleNamespace(length=1e-323, inner_diameter=4e-3), None, supply) == supply


def test_resistance_vanishes_with_length_and_with_a_wide_bore() -> None:
    """Flow over sonic flow of the bore grows without limit; twice the length lets 1/sqrt(2) of the air through."""
    near = valve.hose_restriction(1e-6, 4e-3).conductance
    assert near > 500.0 * valve.hose_restriction(2.0, 4e-3).conductance
    ratio = valve.hose_restriction(4.0, 4e-3).conductance / valve.hose_restriction(2.0, 4e-3).conductance
    assert ratio == pytest.approx(math.sqrt(0.5))
    wider = valve.hose_restriction(2.0, 8e-3).conductance / valve.hose_restriction(2.0, 4e-3).conductance
    assert wider == pytest.approx(2.0**2.5)
    short = measure_pressure(attach(1e-6, 20.0), 0.0, 4.0 * BAR, 2e-3)
    assert short[-1] - ATMOSPHERIC_PRESSURE == pytest.approx(4.0 * BAR, rel=1e-6)


def test_friction_agrees_with_the_fit_for_long_tubes() -> None:
    for diameter in (4e-3, 6e-3, 8e-3):
        fit = valve.tube_restriction(20.0, diameter).conductance
        assert valve.hose_restriction(20.0, diameter).conductance == pytest.approx(fit, rel=0.15)


def test_hose_in_series_with_a_valve_lets_less_through_than_either() -> None:
    values = catalogue.pack_effects(
        {
            ("choked_valve", "symmetric"): {"resistance_s_bar_per_dm3": 1.0, "critical_ratio": 0.4},
            ("hose", "tube"): {"length_m": 2.0, "inner_diameter_mm": 4.0},
        }
    )
    both = apply_supply_effects(BARE._replace(effects=values), ZERO_INTERNAL_STATE)
    hose = valve.hose_restriction(2.0, 4e-3).conductance
    assert both.fill_conductance == pytest.approx((hose**-3 + (1e-8) ** -3) ** (-1 / 3))
    assert both.exhaust_conductance == both.fill_conductance
    assert 0.0 < both.fill_critical_ratio < 0.4


def test_air_flows_from_high_to_low_pressure_only() -> None:
    """The hose only throttles: no pressure passes that of source or room."""
    device = attach(3.0, 3.0)
    for start, command in ((0.0, 5.0 * BAR), (5.0 * BAR, 0.0), (2.0 * BAR, 3.0 * BAR)):
        pressure = measure_pressure(device, start, command, 0.05) - ATMOSPHERIC_PRESSURE
        slope = np.diff(pressure)
        assert (np.sign(command - start) * slope >= -1e-6).all()
        assert pressure.min() >= -1e-6
        assert pressure.max() <= 5.0 * BAR + 1e-6


def test_hose_and_line_are_one_cause() -> None:
    with pytest.raises(InputError, match=r"\[effects.hose\] and \[line\] describe the same cause"):
        load_device("klute-1-1-4-pair-valve").with_effect("hose", length_m=1.0, inner_diameter_mm=4.0)
