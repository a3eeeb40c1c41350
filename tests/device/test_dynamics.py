"""The implicit time step: force balance, stops, convergence and energy."""

import itertools
import math
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.device import dynamics as dynamics
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters, DeviceState
from klute_sim.device.energy.ledger import POWER_TERMS, EnergyBalance, EnergyRecorder
from klute_sim.device.energy.outputs import compute_stop_force
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.effects import catalogue
from klute_sim.laws import mckibben, pneumatic_step
from klute_sim.laws import tendon as tendon_law

PAIR = load_device("klute-3-4-pair").parameters
ANKLE = load_device("klute-1-1-4-pair").parameters
LOCK, REST = mckibben.lock_length(ANKLE.muscle), ANKLE.muscle.resting_length


def without_friction(parameters: DeviceParameters) -> DeviceParameters:
    return parameters._replace(muscle=parameters.muscle._replace(friction_slope=0.0, friction_offset=0.0))


@settings(max_examples=300)
@given(
    pressure=st.floats(0.0, 5e5),
    start=st.floats(LOCK, REST),
    unit_length=st.floats(LOCK, REST + 0.14),
    step=st.floats(1e-4, 5e-3),
    concentric=st.sampled_from([0.0, 1.0, 3e4, 1e7]),
    eccentric=st.sampled_from([0.0, 1.0, 3e4, 1e7]),
)
def test_step_balances_forces_or_rests_on_a_stop(
    pressure: float, start: float, unit_length: float, step: float, concentric: float, eccentric: float
) -> None:
    device = ANKLE._replace(
        damper=ANKLE.damper._replace(concentric_coefficient=concentric, eccentric_coefficient=eccentric)
    )
    length = dynamics.solve_length(
        device, pneumatic_step.constant_pressure(pressure), DeviceState(pressure, start), unit_length, step
    )
    pull = tendon_law.force(device.tendon, unit_length - length - device.tendon.slack_length)
    push = dynamics.compute_muscle_force(
        device, dynamics.ZERO_INTERNAL_STATE, pressure, length, (length - start) / step
    )
    assert LOCK <= length <= REST
    if length == REST:
        assert push <= pull + 1e-9  # the stop carries the difference
    elif length == LOCK:
        assert push >= pull - 1e-9
    else:
        # The last bit of the length limits the residual of the balance.
        stiffness = 3e5 + 2 * max(concentric, eccentric) * abs(length - start) / step**2
        assert abs(push - pull) <= 1e-9 * (1 + pull) + 4 * math.ulp(length) * stiffness


def test_solved_length_agrees_with_an_independent_solver() -> None:
    from scipy.optimize import brentq

    random = np.random.default_rng(1)
    for _ in range(200):
        pressure, step = random.uniform(1e5, 5e5), 5e-4
        start = random.uniform(0.8, 0.99) * REST
        unit_length = start + 0.1 + random.uniform(0.0, 0.01)

        def imbalance(x: float, p: float = pressure, s: float = start, u: float = unit_length) -> float:
            pull = tendon_law.force(ANKLE.tendon, u - x - ANKLE.tendon.slack_length)
            return dynamics.compute_muscle_force(ANKLE, dynamics.ZERO_INTERNAL_STATE, p, x, (x - s) / 5e-4) - pull

        expected = brentq(imbalance, LOCK, REST, xtol=1e-15)
        assert dynamics.solve_length(
            ANKLE, pneumatic_step.constant_pressure(pressure), DeviceState(pressure, start), unit_length, step
        ) == pytest.approx(expected, abs=1e-13)


def test_equilibrium_length_does_not_depend_on_the_damper() -> None:
    state, undamped = (
        DeviceState(4e5, 0.24),
        PAIR._replace(damper=PAIR.damper._replace(concentric_coefficient=0.0, eccentric_coefficient=0.0)),
    )
    for _ in range(4000):
        state = dynamics.advance_state(PAIR, state, 0.34, 4e5, 1e-3)
    alone = dynamics.advance_state(undamped, DeviceState(4e5, 0.24), 0.34, 4e5, 1e-3)
    assert state.length == pytest.approx(alone.length, abs=1e-6)


def test_time_step_has_first_order() -> None:
    def end_length(step: float) -> float:
        state = DeviceState(1e5, 0.24)
        for k in range(round(0.2 / step)):
            length = 0.34 + 0.01 * math.sin(2 * math.pi * 3 * (k + 1) * step)
            state = dynamics.advance_state(PAIR, state, length, 4e5, step)
        return state.length

    errors = [abs(end_length(h) - end_length(h / 2)) for h in (2e-3, 1e-3, 5e-4, 2.5e-4)]
    orders = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert all(0.85 < order < 1.15 for order in orders), orders


def test_closed_orifices_lock_the_muscle_and_open_ones_do_not_chatter() -> None:
    closed = PAIR._replace(damper=PAIR.damper._replace(concentric_coefficient=1e12, eccentric_coefficient=1e12))
    assert dynamics.solve_length(
        closed, pneumatic_step.constant_pressure(4e5), DeviceState(4e5, 0.24), 0.36, 5e-4
    ) == pytest.approx(0.24, abs=1e-7)
    state, lengths = DeviceState(4e5, 0.24), []
    for _ in range(2000):
        state = dynamics.advance_state(PAIR, state, 0.345, 4e5, 5e-4)
        lengths.append(state.length)
    moves = np.diff(lengths)
    assert (moves >= -1e-15).all() or (moves <= 1e-15).all()  # monotonic, towards equilibrium


def test_unpressurized_muscle_with_slack_tendon_returns_to_rest() -> None:
    state = DeviceState(0.0, 0.8 * REST)
    for _ in range(4000):
        state = dynamics.advance_state(ANKLE, state, 0.8 * REST, 0.0, 1e-3)
    assert state.length == pytest.approx(REST, abs=2e-4)
    assert dynamics.compute_tension(ANKLE, state, 0.8 * REST, 0.0) == 0.0


def test_rigid_tie_transmits_tension_and_compression() -> None:
    bare = load_device("klute-1-1-4").parameters
    for ratio, force in ((0.96, 1354), (0.70, -164)):
        state = dynamics.advance_state(bare, DeviceState(5e5, REST), ratio * REST, 5e5, 1e-3)
        assert state.length == ratio * REST
        assert dynamics.compute_tension(bare, state, ratio * REST, 0.0) == pytest.approx(force, abs=0.6)


def test_rigid_tie_stops_at_the_muscle_stops() -> None:
    bare = load_device("klute-1-1-4").parameters
    lock = mckibben.lock_length(bare.muscle)
    for length, expected in ((1.2 * REST, REST), (0.1 * REST, lock)):
        assert dynamics.advance_state(bare, DeviceState(5e5, REST), length, 5e5, 1e-3).length == expected


def test_nan_input_gives_nan() -> None:
    assert math.isnan(
        dynamics.solve_length(PAIR, pneumatic_step.constant_pressure(math.nan), DeviceState(1e5, 0.24), 0.34, 1e-3)
    )
    assert math.isnan(
        dynamics.solve_length(PAIR, pneumatic_step.constant_pressure(1e5), DeviceState(1e5, 0.24), math.nan, 1e-3)
    )


@given(st.floats(0.3, 0.34), st.floats(1e5, 4.9e5))
def test_force_increases_with_pressure_and_length(unit_length: float, pressure: float) -> None:
    def hold_pressure(p: float, length: float) -> float:
        undamped = PAIR._replace(damper=PAIR.damper._replace(concentric_coefficient=0.0, eccentric_coefficient=0.0))
        state = dynamics.advance_state(undamped, DeviceState(p, 0.24), length, p, 1.0)
        return dynamics.compute_tension(undamped, state, length, 0.0)

    assert hold_pressure(pressure + 1e4, unit_length) >= hold_pressure(pressure, unit_length)
    assert hold_pressure(pressure, unit_length + 0.002) >= hold_pressure(pressure, unit_length)


def test_force_decreases_with_shortening_velocity() -> None:
    def force_while_passing(speed: float) -> float:
        step, state = 1e-4, DeviceState(4e5, 0.235)
        count = round(0.01 / abs(speed) / step)
        for k in range(count + 1):
            length = 0.34 + speed * (k - count) * step
            state = dynamics.advance_state(PAIR, state, length, 4e5, step)
        return dynamics.compute_tension(PAIR, state, 0.34, 0.0)

    forces = [force_while_passing(v) for v in (-0.3, -0.1, -0.02, 0.02, 0.1, 0.15)]
    assert forces == sorted(forces)
    assert forces[0] < 0.9 * forces[2]


def compute_balance(parameters: DeviceParameters, step: float) -> EnergyBalance:
    """Return the energy balance of the third cycle of length and pressure."""
    state = DeviceState(2e5, 0.95 * parameters.muscle.resting_length)
    middle, count = state.length + parameters.tendon.slack_length + 0.008, round(0.5 / step)
    recorder = EnergyRecorder(parameters, count + 1)
    for k in range(-1 - 2 * count, count):
        angle = 2 * math.pi * k / count
        length = middle + 0.008 * math.sin(angle)
        after = dynamics.advance_state(parameters, state, length, 3e5 + 1.5e5 * math.sin(angle + 1.2), step)
        if k >= -1:
            recorder.record_sample(k + 1, after, length, (after.length - state.length) / step)
        state = after
    return recorder.to_energy_balance(step)


def compute_residual(step: float) -> float:
    """Return the absolute residual of the energy balance over a cycle [J]."""
    return step * float(np.abs(compute_balance(PAIR, step).residual_power).sum())


def test_residual_of_the_energy_balance_is_proportional_to_the_step() -> None:
    steps = (1e-3, 5e-4, 2.5e-4, 1.25e-4)
    residuals = np.array([compute_residual(step) for step in steps])
    assert np.all((residuals[:-1] / residuals[1:] > 1.9) & (residuals[:-1] / residuals[1:] < 2.1))
    balance = compute_balance(PAIR, 5e-4)
    work = {line: 5e-4 * getattr(balance, line).sum() for line in (*POWER_TERMS, "delivered_power", "residual_power")}
    assert work["delivered_power"] == pytest.approx(work["gas_power"], rel=0.9)  # the powers are not negligible
    assert residuals[1] < 3e-3 * abs(work["delivered_power"])
    assert abs(work["residual_power"]) < 0.05 * residuals[1]  # over a closed cycle it cancels
    assert np.abs(balance.force_residual).max() < 1e-6


@pytest.mark.parametrize("name", ["gas_force", "bladder_force", "friction_force"])
def test_wrong_force_in_the_ledger_appears_in_the_force_residual(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    gas, bladder, friction = mckibben.gas_force, mckibben.bladder_force, mckibben.friction_force
    monkeypatch.setattr(mckibben, "force", lambda m, p, x: gas(m, p, x) + bladder(m, x) + friction(m, p))
    law = getattr(mckibben, name)
    monkeypatch.setattr(mckibben, name, lambda *arguments: 1.1 * law(*arguments))
    assert np.abs(compute_balance(PAIR, 1e-3).force_residual).max() > 0.1


@pytest.mark.parametrize(
    ("law", "name", "factor"),
    [
        (mckibben, "gas_force", 1.02),
        (mckibben, "bladder_force", 1.1),
        (mckibben, "bladder_energy", 0.0),
        (tendon_law, "stored_energy", 0.6),
    ],
)
def test_wrong_force_or_energy_of_a_law_appears_in_the_energy_residual(
    law: ModuleType, name: str, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    right, function = compute_residual(1e-3), getattr(law, name)
    monkeypatch.setattr(law, name, lambda *arguments: factor * function(*arguments))
    assert compute_residual(1e-3) > 1.5 * right


def test_wrong_force_of_the_time_step_appears_in_the_force_residual(monkeypatch: pytest.MonkeyPatch) -> None:
    law = dynamics.compute_muscle_force
    monkeypatch.setattr(dynamics, "compute_muscle_force", lambda *arguments: law(*arguments) + 3.0)
    assert np.abs(compute_balance(PAIR, 1e-3).force_residual).max() == pytest.approx(3.0, abs=1e-5)


def test_stops_absorb_energy_only_at_impact() -> None:
    before = DeviceState(1e5, ANKLE.muscle.resting_length - 1e-4)
    after = dynamics.advance_state(ANKLE, before, REST + 0.12, 1e5, 5e-4)
    assert after.length == REST
    recorder = EnergyRecorder(ANKLE, 3)
    for k, (state_before, state_after) in enumerate(((before, before), (before, after), (after, after))):
        recorder.record_sample(k, state_after, REST + 0.12, (state_after.length - state_before.length) / 5e-4)
    hit = recorder.to_energy_balance(5e-4).stop_power
    assert hit[1] < 0.0  # impact at resting length; the state before is not in equilibrium
    assert hit[2] == 0.0  # at rest on the stop
    free = [dynamics.advance_state(ANKLE, DeviceState(3e5, 0.25), 0.352, 3e5, 5e-4)]
    free.append(dynamics.advance_state(ANKLE, free[0], 0.352, 3e5, 5e-4))
    recorder = EnergyRecorder(ANKLE, 2)
    for k, (state_before, state_after) in enumerate(((DeviceState(3e5, 0.25), free[0]), free)):
        recorder.record_sample(k, state_after, 0.352, (state_after.length - state_before.length) / 5e-4)
    assert recorder.to_energy_balance(5e-4).stop_power[1] == 0.0


def test_stops_push_only_outward_and_only_in_contact() -> None:
    muscle, middle = ANKLE.muscle, 0.5 * (LOCK + REST)
    for length, expected in ((REST, (0.0, 7.0)), (middle, (0.0, 0.0)), (LOCK, (-7.0, 0.0))):
        assert tuple(compute_stop_force(muscle, length, imbalance) for imbalance in (-7.0, 7.0)) == expected
    # MuJoCo stores the length as an offset whose rounding must not lift the muscle off its stop.
    assert compute_stop_force(muscle, REST - 1e-16, 7.0) == 7.0


def test_device_is_passive_without_friction_offset_at_constant_pressure() -> None:
    quiet = without_friction(PAIR)
    state = DeviceState(3e5, 0.24)
    work, step, count = 0.0, 2.5e-4, 2000
    for cycle in range(3):
        for k in range(count):
            angle = 2 * math.pi * k / count
            after = dynamics.advance_state(quiet, state, 0.335 + 0.01 * math.sin(angle), 3e5, step)
            if cycle == 2:
                rate = 0.01 * 2 * math.pi / (count * step) * math.cos(angle)
                work -= step * rate * dynamics.compute_tension(quiet, after, 0.335 + 0.01 * math.sin(angle), rate)
            state = after
    assert work < 0.0  # a closed loop at constant pressure dissipates energy in the damper


def test_friction_offset_has_its_own_power_term() -> None:
    with_offset, without = compute_balance(PAIR, 5e-4), compute_balance(without_friction(PAIR), 5e-4)
    assert np.abs(with_offset.friction_power).max() > 1.0
    assert not without.friction_power.any()
    assert with_offset.damper_power.sum() < 0.0


def test_gas_below_room_pressure_does_no_work_on_the_braid() -> None:
    """A bladder below room pressure leaves the braid: neither force nor power, so the balance stays closed."""
    recorder = EnergyRecorder(ANKLE, 2)
    for k, length in enumerate((0.23, 0.24)):
        recorder.record_sample(k, DeviceState(-2e4, length), 0.36, 0.0)
    assert not recorder.to_energy_balance(5e-4).gas_power.any()


def test_dead_times_of_the_valve_of_a_data_driven_term_and_of_sound_in_the_hose_add_up() -> None:
    """Sound travels 343.2 m/s in air of 20 degrees Celsius (tables)."""
    sections = {
        ("pressure_delay", "dead_time"): {"delay_s": 0.03},
        ("hose", "tube"): {"length_m": 6.864, "inner_diameter_mm": 4.0},
        ("unknown_pressure", "sparse"): {"delay_s": 0.01},
    }
    for keys, dead_time in (((0,), 0.03), ((1,), 0.02), ((2,), 0.01), ((0, 1), 0.05), ((0, 1, 2), 0.06)):
        chosen = {key: sections[key] for key in (list(sections)[k] for k in keys)}
        device = ANKLE._replace(effects=catalogue.pack_effects(chosen))
        assert dynamics.get_dead_time(device) == pytest.approx(dead_time, rel=1e-3)


@given(pressure=st.floats(0.0, 5e5), near=st.floats(LOCK, REST), unit_length=st.floats(LOCK + 0.12, REST + 0.14))
def test_equilibrium_does_not_depend_on_the_length_where_the_search_begins(
    pressure: float, near: float, unit_length: float
) -> None:
    expected = compute_equilibrium_state(ANKLE, unit_length, pressure)
    found = compute_equilibrium_state(ANKLE, unit_length, pressure, near)
    assert found.length == pytest.approx(expected.length, abs=1e-12)
    assert found.pressure == expected.pressure
    assert found.internal_state == pytest.approx(expected.internal_state, rel=1e-9)
