"""The effect ``choked_valve`` (``downstream``) of a device: with other effects of the supply, and in equilibrium."""

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.device.dynamics import ZERO_INTERNAL_STATE, DeviceParameters, apply_supply_effects
from klute_sim.device.equilibrium import compute_equilibrium_state, compute_taut_state
from klute_sim.device.recorded_rollout import record_rollout
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.laws import valve
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE
from klute_sim.types import Array
from klute_sim.units import BAR

BARE = load_device("klute-3-4").parameters
BARE = BARE._replace(supply=BARE.supply._replace(max_pressure_rate=1e12))
LENGTH = 0.9 * BARE.muscle.resting_length
NEEDLE = {"resistance_s_bar_per_dm3": 8.0, "critical_ratio": 0.3}
LAG = {("pressure_lag", "first_order"): {"time_constant_s": 0.1}}
LEAK = {("leak", "orifice"): {"conductance_dm3_per_s_bar": 0.02}}


def restrict(
    others: dict[tuple[str, str], dict[str, float]] | None = None,
    form: str = "downstream",
    device: DeviceParameters = BARE,
) -> DeviceParameters:
    """Return ``device`` behind the needle, with ``others`` of its effects."""
    return device._replace(effects=catalogue.pack_effects({("choked_valve", form): NEEDLE, **(others or {})}))


def measure_pressure(device: DeviceParameters, command: Array, dt: float, start: float = 0.0) -> Array:
    """Return the pressure [Pa] of the clamped muscle after each step of ``command`` [Pa]."""
    state = compute_taut_state(device, LENGTH, start)
    path = np.full(len(command), LENGTH)
    return np.asarray(simulate_rollouts(device, path, command, dt, initial_state=state).pressure)


def test_each_level_is_approached_from_its_side() -> None:
    levels = np.repeat([2.0, 4.0, 3.0, 5.0, 1.0, 0.0], 3000) * BAR
    pressure = measure_pressure(restrict(), levels, 1e-3)
    for level, response in zip(levels[::3000], np.split(pressure, 6), strict=True):
        assert response[-1] == pytest.approx(level, abs=1e-3)
        assert (np.sign(level - response[0]) * np.diff(response) >= -1e-6).all()


def test_filling_to_the_full_supply_is_that_of_the_symmetric_form_and_others_are_not() -> None:
    for level, is_equal in ((BARE.supply.max_pressure, True), (0.5 * BARE.supply.max_pressure, False)):
        command = np.full(1000, level)
        fillings = [measure_pressure(restrict(form=form), command, 1e-3) for form in ("downstream", "symmetric")]
        assert (np.abs(fillings[0] - fillings[1]).max() < 1e-6) == is_equal


def test_lag_of_the_regulator_acts_upstream_of_the_restriction_and_converges() -> None:
    """The filling begins as the regulator rises: a filling through the needle from an exponential."""
    end, responses = 0.6, []
    for dt in (4e-3, 2e-3, 1e-3):
        responses.append(measure_pressure(restrict(LAG), np.full(round(end / dt), 4.0 * BAR), dt))
    fine = 1e-4
    rising = 4.0 * BAR * (1.0 - np.exp(-fine * np.arange(1, round(end / fine) + 1) / 0.1))
    exact = measure_pressure(restrict(), rising, fine)
    errors = [
        np.abs(response - exact[round(dt / fine) - 1 :: round(dt / fine)]).max()
        for response, dt in zip(responses, (4e-3, 2e-3, 1e-3), strict=True)
    ]
    assert errors[2] < 0.01 * 4.0 * BAR
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.3)


@pytest.mark.parametrize("others", [{}, LAG], ids=["alone", "with lag"])
def test_needle_without_resistance_leaves_the_regulator_with_its_rate(others: dict) -> None:
    slow = BARE._replace(supply=BARE.supply._replace(max_pressure_rate=10.0 * BAR))
    command = np.repeat([4.0, 1.0], 600) * BAR
    plain = measure_pressure(slow._replace(effects=catalogue.pack_effects(others)), command, 1e-3)
    wide = {("choked_valve", "downstream"): NEEDLE | {"resistance_s_bar_per_dm3": 1e-3}}
    behind = measure_pressure(slow._replace(effects=catalogue.pack_effects(others | wide)), command, 1e-3)
    assert behind == pytest.approx(plain, abs=1e-3 * BAR)
    assert np.abs(np.diff(plain)).max() > 0.9e-3 * 10.0 * BAR


def test_second_order_lag_oscillates_upstream_of_a_wide_restriction_only() -> None:
    lag = {("pressure_lag", "second_order"): {"time_constant_s": 0.02, "damping_ratio": 0.3}}
    wide = {("choked_valve", "downstream"): {"resistance_s_bar_per_dm3": 0.01, "critical_ratio": 0.3}}
    command = np.full(8000, 3.0 * BAR)
    overshoots = [
        measure_pressure(d, command, 1e-4).max() / (3.0 * BAR) - 1.0
        for d in (BARE._replace(effects=catalogue.pack_effects({**wide, **lag})), restrict(lag))
    ]
    assert overshoots[0] == pytest.approx(np.exp(-np.pi * 0.3 / np.sqrt(1.0 - 0.09)), rel=0.05)
    assert overshoots[1] < 1e-3


def test_motion_does_not_move_the_pressure_of_a_lagging_regulator() -> None:
    """Under a constant command a lag has nothing to follow, also behind a restriction."""
    pair = load_device("klute-3-4-pair").parameters
    time = 1e-3 * np.arange(1500)
    length, command = 0.338 + 8e-3 * np.sin(9.0 * time), np.full(1500, 3.0 * BAR)
    responses = [simulate_rollouts(restrict(o, device=pair), length, command, 1e-3).pressure for o in ({}, LAG)]
    assert np.ptp(responses[0]) > 1e3
    assert responses[1] == pytest.approx(responses[0], abs=1e-3)


@pytest.mark.parametrize("others", [LEAK, LEAK | LAG], ids=["leak", "leak and lag"])
def test_equilibrium_with_a_leak_is_below_the_command_and_steady(others: dict) -> None:
    device = restrict(others)
    state = compute_equilibrium_state(device, LENGTH, 4.0 * BAR)
    needle, leak = valve.Restriction(1e-8 / 8.0, 0.3), valve.Restriction(0.02e-8, 0.5)
    inside, temperature = state.pressure + ATMOSPHERIC_PRESSURE, device.supply.temperature
    inflow = valve.mass_flow(needle, 4.0 * BAR + ATMOSPHERIC_PRESSURE, inside, temperature)
    assert state.pressure < 4.0 * BAR - 1e3
    assert inflow == pytest.approx(valve.mass_flow(leak, inside, ATMOSPHERIC_PRESSURE, temperature), rel=1e-6)
    steady = simulate_rollouts(device, np.full(200, LENGTH), np.full(200, 4.0 * BAR), 1e-3, initial_state=state)
    assert np.asarray(steady.pressure) == pytest.approx(state.pressure, rel=1e-8)


def test_regulator_error_moves_the_level_and_a_dead_time_the_filling() -> None:
    error = {("regulator_error", "offset"): {"offset_bar": -0.2}}
    command = np.full(3000, 3.0 * BAR)
    assert measure_pressure(restrict(error), command, 1e-3)[-1] == pytest.approx(2.8 * BAR, abs=1e-3)
    delay = {("pressure_delay", "dead_time"): {"delay_s": 0.05}}
    step = np.where(np.arange(1000) < 100, 0.0, 3.0 * BAR)
    late, prompt = (measure_pressure(restrict(o), step, 1e-3) for o in (delay, {}))
    assert late[50:] == pytest.approx(prompt[:-50])


def test_tank_falls_by_the_air_of_each_filling() -> None:
    tank = {("supply_droop", "tank"): {"inverse_volume_per_l": 4.0}}
    command = np.tile(np.repeat([4.0, 0.0], 1500), 4) * BAR
    device = restrict(tank)
    state = compute_taut_state(device, LENGTH, 0.0)
    record = record_rollout(device, np.full(len(command), LENGTH), command, 1e-3, initial_state=state)
    tops = np.asarray(record.pressure)[1499::3000]
    assert (np.diff(tops) <= 1e-3).all()
    assert tops[-1] < 3.9 * BAR
    drawn = np.asarray(record.energy_balance.air_drawn)
    assert np.diff(drawn).min() >= 0.0


def test_hose_after_the_needle_is_in_series_downstream() -> None:
    hose = {("hose", "tube"): {"length_m": 2.0, "inner_diameter_mm": 4.0}}
    supply = apply_supply_effects(restrict(hose), ZERO_INTERNAL_STATE)
    plain = apply_supply_effects(restrict(hose, "symmetric"), ZERO_INTERNAL_STATE)
    assert supply.regulator_is_upstream == 1.0
    assert supply == plain._replace(regulator_is_upstream=1.0)
    assert supply.fill_conductance < 1e-8 / 8.0


def test_regulator_behind_a_needle_compensates_no_motion() -> None:
    coupling = {("volume_coupling", "polytropic"): {"recovery_s": 0.05, "exponent": 1.2}}
    assert apply_supply_effects(restrict(coupling), ZERO_INTERNAL_STATE) == apply_supply_effects(
        restrict(), ZERO_INTERNAL_STATE
    )


@pytest.mark.parametrize("others", [{}, LAG | LEAK], ids=["alone", "with lag and leak"])
def test_backends_agree_to_the_last_bit(others: dict) -> None:
    pair = load_device("klute-3-4-pair").parameters
    time = 1e-3 * np.arange(300)
    length, command = 0.338 + 8e-3 * np.sin(9.0 * time), np.where(time % 0.1 < 0.05, 4e5, 1e5)
    device = restrict(others, device=pair)
    compiled, python = (simulate_rollouts(device, length, command, 1e-3, backend=b) for b in ("compiled", "python"))
    assert np.array_equal(compiled.pressure, python.pressure)
    assert np.array_equal(compiled.tension, python.tension)


def test_resistance_of_zero_changes_no_bit() -> None:
    command = np.repeat([3.0, 1.0], 200) * BAR
    neutral = catalogue.pack_effects({("choked_valve", "downstream"): NEEDLE | {"resistance_s_bar_per_dm3": 0.0}})
    pair = load_device("klute-3-4-pair").parameters
    length = np.full(400, 0.338)
    with_effect, without = (simulate_rollouts(d, length, command, 1e-3) for d in (pair._replace(effects=neutral), pair))
    assert np.array_equal(with_effect.pressure, without.pressure)
    assert np.array_equal(with_effect.tension, without.tension)


def test_device_with_a_valve_of_its_own_refuses_the_restriction() -> None:
    with pytest.raises(InputError, match=r"\[effects.choked_valve\] and \[valve\] describe the same cause"):
        load_device("klute-1-1-4-pair-valve").with_effect("choked_valve", form="downstream", **NEEDLE)
