"""Effects against their equations and closed forms."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lti, step

from klute_sim.device.device import load_device
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.device.recorded_rollout import record_rollout
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.effects.families.instrument import compute_delay
from klute_sim.effects.smoothing import SIGN_TRANSITION_SPEED
from klute_sim.laws import mckibben, valve
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE, SupplyParameters
from klute_sim.units import BAR
from tests.effects.devices import (
    LENGTH,
    PAIR,
    STEP,
    TIME,
    VALVE_FED,
    activate,
    load_with_effects,
    parameters_of,
    run,
    run_base,
)


def test_regulator_effects_match_their_equations() -> None:
    def pressure(effect: str, form: str, value: float) -> np.ndarray:
        slot = catalogue.find_slot(effect, form)
        return run(activate(slot, {slot.form.parameters[0].key: value})).pressure

    settled = (TIME % 0.25 > 0.2) & (TIME > 0.3)
    assert pressure("regulator_error", "gain", 0.9)[settled] == pytest.approx(0.9 * run_base().pressure[settled])
    assert pressure("regulator_error", "offset", 0.2)[settled] == pytest.approx(run_base().pressure[settled] + 0.2e5)
    late = pressure("pressure_delay", "dead_time", 0.04)
    assert late[200:] == pytest.approx(run_base().pressure[:-200])
    slow = pressure("pressure_lag", "first_order", 0.05)
    rise = slow[round(0.5 / STEP) : round(0.75 / STEP)]
    after = np.arange(1, len(rise) + 1) * STEP
    # The supply's maximum rate does not limit a lag of 50 ms on 3 bar.
    expected = 4e5 + (rise[0] - 4e5) * np.exp(-(after - after[0]) / 0.05)
    assert rise == pytest.approx(expected, abs=0.01 * 3e5)


@pytest.mark.parametrize("damping_ratio", [0.3, 1.5])
def test_second_order_lag_is_the_closed_form_step_response(damping_ratio: float) -> None:
    """Its error falls with the time step, which the supply's maximum rate does not limit here."""
    tau, end, height = 0.02, 0.2, 1e5
    device = activate(
        catalogue.find_slot("pressure_lag", "second_order"), {"time_constant_s": tau, "damping_ratio": damping_ratio}
    )
    device = device._replace(supply=device.supply._replace(max_pressure_rate=1e9))
    step_response = lti([1.0], [tau * tau, 2.0 * damping_ratio * tau, 1.0])
    errors = []
    for dt in (4e-4, 2e-4):
        n = round(end / dt)
        start = compute_taut_state(device, 0.338, 2e5)
        trace = simulate_rollouts(device, np.full(n, 0.338), np.full(n, 2e5 + height), dt, initial_state=start)
        _, expected = step(step_response, T=np.arange(n + 1) * dt)
        errors.append(np.abs(trace.pressure - 2e5 - height * expected[1:]).max() / height)
    assert errors[0] < 0.03
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize(
    ("effect", "form", "parameters"),
    [
        ("volume_coupling", "polytropic", {"recovery_s": 0.05, "exponent": 1.2}),
        ("choked_valve", "symmetric", {"resistance_s_bar_per_dm3": 4.0, "critical_ratio": 0.5}),
    ],
)
def test_second_order_lag_does_not_follow_the_compression_by_the_muscle(
    effect: str, form: str, parameters: dict[str, float]
) -> None:
    """The pressure of a moving muscle under a constant command converges with the time step."""
    lag = {("pressure_lag", "second_order"): {"time_constant_s": 0.02, "damping_ratio": 0.7}}
    changes = []
    for dt in (8e-4, 4e-4, 2e-4):
        time = dt * np.arange(1, round(1.0 / dt) + 1)
        length = 0.338 + 4e-3 * np.sin(2.0 * np.pi * 3.0 * time)
        pressures = [
            simulate_rollouts(
                PAIR.parameters._replace(effects=catalogue.pack_effects({(effect, form): parameters} | added)),
                length,
                np.full(len(time), 3e5),
                dt,
            ).pressure
            for added in ({}, lag)
        ]
        changes.append(np.abs(pressures[1] - pressures[0])[len(time) // 2 :].max())
    # A regulator of a steady command has nothing to follow; behind a valve its aim is the pressure that it measures.
    assert max(changes) < (1.0 if effect == "volume_coupling" else 0.3e5)
    assert changes[2] <= 1.2 * changes[1] + 1.0


def test_second_order_lag_follows_the_command_where_its_time_constant_is_zero() -> None:
    slot = catalogue.find_slot("pressure_lag", "second_order")
    trace = run(activate(slot, {"time_constant_s": 0.0, "damping_ratio": 0.7}))
    assert np.array_equal(trace.pressure, run_base().pressure)


@pytest.mark.parametrize(
    ("effect", "parameters", "expected"),
    [
        ("regulator_error", {"form": "gain", "gain": 0.9}, 2.7),
        ("regulator_error", {"form": "offset", "offset_bar": 0.2}, 3.2),
        ("regulator_error", {"form": "gain", "gain": 1.3}, 3.9),
        ("unknown_pressure", {"offset_bar": 0.1, "command_bar": 0.5, "lag_s": 0.1}, 3.4),
        ("pressure_lag", {"time_constant_s": 0.1}, 3.0),
    ],
)
def test_rollout_starts_at_the_pressure_that_the_regulator_holds(
    effect: str, parameters: dict[str, float | str], expected: float
) -> None:
    device = load_with_effects({effect: parameters}).parameters
    trace = simulate_rollouts(device, np.full(20, 0.338), np.full(20, 3e5), STEP)
    assert trace.pressure == pytest.approx(np.full(20, expected * BAR), abs=1e-3)
    full = device.supply.max_pressure
    assert compute_taut_state(device, 0.338, 1.2 * full).pressure <= full


def test_choked_valve_fills_in_the_closed_form_time() -> None:
    """A clamped muscle, and sonic flow: the closed form of a constant volume."""
    bare = load_device("klute-3-4").parameters
    bare = bare._replace(supply=bare.supply._replace(max_pressure=15e5, max_pressure_rate=1e9))
    slot = catalogue.find_slot("choked_valve", "symmetric")
    device = activate(slot, {"resistance_s_bar_per_dm3": 8.0, "critical_ratio": 0.3}, bare)
    length = 0.9 * bare.muscle.resting_length
    volume = mckibben.gas_volume(bare.muscle, length) + bare.supply.dead_volume
    restriction = valve.Restriction(1.0 / (8.0 * 1e3 * BAR), 0.3)
    high = 15e5 + ATMOSPHERIC_PRESSURE
    time = valve.filling_time(restriction, 1.0, bare.supply.temperature, volume, high, ATMOSPHERIC_PRESSURE, 0.3 * high)
    trace = simulate_rollouts(
        device,
        np.full(4000, length),
        np.full(4000, 14e5),
        STEP,
        initial_state=compute_taut_state(device, length, 0.0),
    )
    assert np.interp(0.3 * high - ATMOSPHERIC_PRESSURE, trace.pressure, STEP * np.arange(1, 4001)) == pytest.approx(
        time, rel=1e-3
    )
    empty = simulate_rollouts(
        device,
        np.full(9000, length),
        np.full(9000, 0.0),
        STEP,
        initial_state=compute_taut_state(device, length, 8e5),
    )
    low = ATMOSPHERIC_PRESSURE / 0.3
    expected = valve.venting_time(restriction, 1.0, bare.supply.temperature, volume, 8e5 + ATMOSPHERIC_PRESSURE, low)
    crossed = STEP * (1 + np.argmax(empty.pressure < low - ATMOSPHERIC_PRESSURE))
    assert crossed == pytest.approx(expected, rel=5e-3)


def test_volume_coupling_raises_the_pressure_of_a_lengthening_muscle() -> None:
    slot = catalogue.find_slot("volume_coupling", "polytropic")
    command = np.full(len(TIME), 3e5)
    trace = simulate_rollouts(activate(slot, parameters_of(slot.form)), LENGTH, command, STEP)
    rate = np.gradient(trace.length, STEP)
    late = TIME > 0.2
    # A lengthening muscle becomes thinner, which compresses its air.
    assert np.corrcoef(trace.pressure[late], rate[late])[0, 1] > 0.8
    assert 0.05e5 < np.ptp(trace.pressure[late]) < 2e5
    fast, slow = (
        np.ptp(
            simulate_rollouts(activate(slot, {"recovery_s": s, "exponent": 1.2}), LENGTH, command, STEP).pressure[late]
        )
        for s in (0.005, 0.05)
    )
    assert slow > 5 * fast


def test_leak_draws_air_and_lowers_the_pressure_behind_a_valve() -> None:
    slot = catalogue.find_slot("leak", "orifice")
    inputs = np.full(len(TIME), 0.338), np.full(len(TIME), 4e5)
    tight, leaky = (
        record_rollout(p, *inputs, STEP) for p in (PAIR.parameters, activate(slot, parameters_of(slot.form)))
    )
    assert leaky.pressure[-1] == tight.pressure[-1]
    lost = 0.02e-8 * 1.185 * (4e5 + ATMOSPHERIC_PRESSURE)  # sonic, at the reference temperature
    assert leaky.energy_balance.air_leaked[-1] == pytest.approx(lost * TIME[-1], rel=1e-3)
    assert leaky.energy_balance.air_drawn[-1] - tight.energy_balance.air_drawn[-1] == pytest.approx(
        lost * TIME[-1], rel=0.02
    )
    sound, sagging = (
        record_rollout(p, *inputs, STEP) for p in (VALVE_FED, activate(slot, parameters_of(slot.form), VALVE_FED))
    )
    assert sagging.pressure[-1] < sound.pressure[-1] - 5e3


def test_tank_pressure_falls_with_each_filling() -> None:
    slot = catalogue.find_slot("supply_droop", "tank")
    command = np.where(TIME % 0.2 < 0.1, 5e5, 0.0)
    trace = simulate_rollouts(activate(slot, parameters_of(slot.form)), np.full(len(TIME), 0.338), command, STEP)
    tops = [trace.pressure[(0.2 * k <= TIME) & (0.2 * k + 0.1 > TIME)].max() for k in range(5)]
    assert np.diff(tops).max() < -0.2e5


def test_maxwell_slip_starts_at_its_stiffness_and_saturates_at_its_friction() -> None:
    slot = catalogue.find_slot("braid_hysteresis", "maxwell_slip")
    laws, p, state = slot.form.laws, slot.form.pack(parameters_of(slot.form)), slot.form.make_zero_state()
    muscle, pressure = PAIR.parameters.muscle, 3e5
    forces = []
    for x in np.linspace(0.0, 5e-3, 500):
        length = muscle.resting_length + x
        state = slot.form.state_type(*laws["next_state"](p, state, muscle, pressure, 0.0, length, 0.0, 1e-3))
        forces.append(laws["muscle_force"](p, state, 0.0, muscle, pressure, length, 0))
    assert forces[1] / 1.002e-5 == pytest.approx(2 * 40e3, rel=0.01)
    assert forces[-1] == pytest.approx(2 * 8.0 * 3.0)
    assert all(b >= a - 1e-9 for a, b in pairwise(forces))


def test_smooth_sign_is_odd_and_saturates() -> None:
    from klute_sim.effects.smoothing import smooth_sign

    assert smooth_sign(0.0) == 0.0
    assert smooth_sign(SIGN_TRANSITION_SPEED) == -smooth_sign(-SIGN_TRANSITION_SPEED) == pytest.approx(math.sqrt(0.5))
    assert smooth_sign(1.0) == pytest.approx(1.0, abs=1e-6)


def test_instrument_laws_match_their_equations() -> None:
    time, value = TIME, np.sin(7 * TIME)

    def read(effect: str, parameter: float, time: np.ndarray = time, value: np.ndarray = value) -> np.ndarray:
        form = catalogue.get_effects()[effect].forms[0]
        return form.laws["reading"](form.parameter_type(parameter), time, value)

    for effect in (e for e in catalogue.get_effects().values() if e.kind == "instrument"):
        assert np.array_equal(read(effect.name, effect.forms[0].parameters[0].neutral), value), effect.name
    assert read("sensor_gain", 1.1) == pytest.approx(1.1 * value)
    assert read("sensor_offset", 0.3) == pytest.approx(value + 0.3)
    assert read("sensor_drift", 0.5, time + 3.0) == pytest.approx(value + 0.5 * time)
    assert read("clock_skew", 0.02)[200:] == pytest.approx(np.sin(7 * (time - 0.02))[200:], abs=1e-5)
    # A ramp lags by the time constant after the initial transient.
    ramp = read("sensor_lag", 0.05, value=3.0 * time)
    assert ramp[3000:] == pytest.approx(3.0 * (time - 0.05)[3000:], abs=1e-3)
    lagged = read("sensor_lag", 0.05)
    assert np.abs(lagged[2500:]).max() == pytest.approx(1 / math.hypot(1, 7 * 0.05), abs=2e-3)


def test_second_order_lag_of_an_instrument_matches_its_closed_forms() -> None:
    first_order, second_order = catalogue.get_effects()["sensor_lag"].forms

    def read(value: np.ndarray, tau: float, damping_ratio: float) -> np.ndarray:
        return second_order.laws["reading"](second_order.parameter_type(tau, damping_ratio), TIME, value)

    sine = np.sin(7 * TIME)
    assert np.array_equal(read(sine, 0.0, 0.7), sine)
    once = first_order.laws["reading"](first_order.parameter_type(0.03), TIME, sine)
    twice = first_order.laws["reading"](first_order.parameter_type(0.03), TIME, once)
    assert read(sine, 0.03, 1.0) == pytest.approx(twice, abs=1e-5)
    ramp = read(3.0 * TIME, 0.02, 0.7)
    delay = compute_delay(second_order, {"time_constant_s": 0.02, "damping_ratio": 0.7})
    assert ramp[3000:] == pytest.approx(3.0 * (TIME - delay)[3000:], abs=1e-6)
    stepped = read(np.where(TIME > 0.1, 1.0, 0.0), 0.02, 0.4)
    assert stepped.max() - 1.0 == pytest.approx(math.exp(-math.pi * 0.4 / math.sqrt(1.0 - 0.4**2)), abs=2e-3)
    assert read(np.full(len(TIME), 5.0), 0.02, 0.7) == pytest.approx(5.0, abs=1e-9)  # at rest, it stays there
    shortest = read(sine, 1e-7, 1.0)
    assert shortest == pytest.approx(sine, abs=1e-5)  # continuous at 0


@pytest.mark.parametrize("effect", ["sensor_lag", "clock_skew"])
def test_delay_of_an_instrument_is_that_of_a_ramp(effect: str) -> None:
    form = catalogue.get_effects()[effect].forms[0]
    ramp = form.laws["reading"](form.parameter_type(0.03), TIME, 2.0 * TIME)
    delay = compute_delay(form, {form.parameters[0].key: 0.03})
    assert ramp[3000:] == pytest.approx(2.0 * (TIME - delay)[3000:], abs=1e-3)


@pytest.mark.parametrize(
    ("effect", "form", "parameters", "changed_fields"),
    [
        ("leak", "orifice", (7.0,), {"leak_conductance": 7.0}),
        ("supply_droop", "tank", (4.0,), {"tank_volume": 0.25, "tank_pressure": 0.5}),
        (
            "choked_valve",
            "symmetric",
            (400.0, 0.3),
            {
                "fill_conductance": 0.0025,
                "fill_critical_ratio": 0.3,
                "exhaust_conductance": 0.0025,
                "exhaust_critical_ratio": 0.3,
                "regulator_is_upstream": 0.0,
            },
        ),
        (
            "choked_valve",
            "asymmetric",
            (400.0, 2.0, 0.3),
            {
                "fill_conductance": 0.0025,
                "fill_critical_ratio": 0.3,
                "exhaust_conductance": 0.00125,
                "exhaust_critical_ratio": 0.3,
                "regulator_is_upstream": 0.0,
            },
        ),
        (
            "choked_valve",
            "downstream",
            (400.0, 0.3),
            {
                "fill_conductance": 0.0025,
                "fill_critical_ratio": 0.3,
                "exhaust_conductance": 0.0025,
                "exhaust_critical_ratio": 0.3,
                "regulator_is_upstream": 1.0,
            },
        ),
    ],
)
def test_supply_effect_changes_only_its_fields(
    effect: str, form: str, parameters: tuple[float, ...], changed_fields: dict[str, float]
) -> None:
    supply = SupplyParameters(*(0.5 + k for k in range(len(SupplyParameters._fields))))  # all fields differ
    effect_form = catalogue.find_form(effect, form)[1]
    law, state = effect_form.laws["supply"], effect_form.make_zero_state()
    assert law(effect_form.parameter_type(*parameters), state, supply) == supply._replace(**changed_fields)
    assert law(effect_form.parameter_type(0.0, *parameters[1:]), state, supply) == supply
