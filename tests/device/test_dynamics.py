"""The implicit step: it balances, it respects the stops, it converges, and it makes no energy."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.device import dynamics as unit
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters, DeviceState
from klute_sim.device.energy.ledger import POWER_TERMS, EnergyBalance, EnergyRecorder
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
def test_every_step_balances_or_rests_on_a_stop(
    pressure: float, start: float, unit_length: float, step: float, concentric: float, eccentric: float
) -> None:
    device = ANKLE._replace(
        damper=ANKLE.damper._replace(concentric_coefficient=concentric, eccentric_coefficient=eccentric)
    )
    length = unit.solve_length(
        device, pneumatic_step.constant_pressure(pressure), DeviceState(pressure, start), unit_length, step
    )
    pull = tendon_law.force(device.tendon, unit_length - length - device.tendon.slack_length)
    push = unit.compute_muscle_damper_force(device, unit.ZERO_INTERNAL_STATE, pressure, length, (length - start) / step)
    assert LOCK <= length <= REST
    if length == REST:
        assert push <= pull + 1e-9  # the stop only holds the muscle back
    elif length == LOCK:
        assert push >= pull - 1e-9
    else:
        # The balance can be met no better than the last bit of the length allows.
        stiffness = 3e5 + 2 * max(concentric, eccentric) * abs(length - start) / step**2
        assert abs(push - pull) <= 1e-9 * (1 + pull) + 4 * math.ulp(length) * stiffness


def test_balance_agrees_with_an_independent_solver() -> None:
    from scipy.optimize import brentq

    random = np.random.default_rng(1)
    for _ in range(200):
        pressure, step = random.uniform(1e5, 5e5), 5e-4
        start = random.uniform(0.8, 0.99) * REST
        unit_length = start + 0.1 + random.uniform(0.0, 0.01)

        def imbalance(x: float, p: float = pressure, s: float = start, u: float = unit_length) -> float:
            pull = tendon_law.force(ANKLE.tendon, u - x - ANKLE.tendon.slack_length)
            return unit.compute_muscle_damper_force(ANKLE, unit.ZERO_INTERNAL_STATE, p, x, (x - s) / 5e-4) - pull

        wanted = brentq(imbalance, LOCK, REST, xtol=1e-15)
        assert unit.solve_length(
            ANKLE, pneumatic_step.constant_pressure(pressure), DeviceState(pressure, start), unit_length, step
        ) == pytest.approx(wanted, abs=1e-13)


def test_settled_length_needs_no_damper_to_be_the_static_balance() -> None:
    state, undamped = (
        DeviceState(4e5, 0.24),
        PAIR._replace(damper=PAIR.damper._replace(concentric_coefficient=0.0, eccentric_coefficient=0.0)),
    )
    for _ in range(4000):
        state = unit.advance_state(PAIR, state, 0.34, 4e5, 1e-3)
    alone = unit.advance_state(undamped, DeviceState(4e5, 0.24), 0.34, 4e5, 1e-3)
    assert state.length == pytest.approx(alone.length, abs=1e-6)


def test_order_of_convergence_is_one() -> None:
    def end_length(step: float) -> float:
        state = DeviceState(1e5, 0.24)
        for k in range(round(0.2 / step)):
            length = 0.34 + 0.01 * math.sin(2 * math.pi * 3 * (k + 1) * step)
            state = unit.advance_state(PAIR, state, length, 4e5, step)
        return state.length

    errors = [abs(end_length(h) - end_length(h / 2)) for h in (2e-3, 1e-3, 5e-4, 2.5e-4)]
    orders = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert all(0.85 < order < 1.15 for order in orders), orders


def test_closed_orifices_hold_the_muscle_and_open_ones_do_not_chatter() -> None:
    closed = PAIR._replace(damper=PAIR.damper._replace(concentric_coefficient=1e12, eccentric_coefficient=1e12))
    assert unit.solve_length(
        closed, pneumatic_step.constant_pressure(4e5), DeviceState(4e5, 0.24), 0.36, 5e-4
    ) == pytest.approx(0.24, abs=1e-7)
    state, lengths = DeviceState(4e5, 0.24), []
    for _ in range(2000):
        state = unit.advance_state(PAIR, state, 0.345, 4e5, 5e-4)
        lengths.append(state.length)
    moves = np.diff(lengths)
    assert (moves >= -1e-15).all() or (moves <= 1e-15).all()  # one way, towards the balance


def test_no_pressure_and_a_slack_tendon_bring_the_muscle_back_to_rest() -> None:
    state = DeviceState(0.0, 0.8 * REST)
    for _ in range(4000):
        state = unit.advance_state(ANKLE, state, 0.8 * REST, 0.0, 1e-3)
    assert state.length == pytest.approx(REST, abs=2e-4)
    assert unit.compute_tension(ANKLE, state, 0.8 * REST, 0.0) == 0.0


def test_rigid_tie_is_the_muscle_itself_both_ways() -> None:
    bare = load_device("klute-1-1-4").parameters
    for ratio, force in ((0.96, 1354), (0.70, -164)):
        state = unit.advance_state(bare, DeviceState(5e5, REST), ratio * REST, 5e5, 1e-3)
        assert state.length == ratio * REST
        assert unit.compute_tension(bare, state, ratio * REST, 0.0) == pytest.approx(force, abs=0.6)


def test_a_rigid_tie_stops_with_the_muscle() -> None:
    bare = load_device("klute-1-1-4").parameters
    lock = mckibben.lock_length(bare.muscle)
    for length, wanted in ((1.2 * REST, REST), (0.1 * REST, lock)):
        assert unit.advance_state(bare, DeviceState(5e5, REST), length, 5e5, 1e-3).length == wanted


def test_not_a_number_comes_out_as_not_a_number() -> None:
    assert math.isnan(
        unit.solve_length(PAIR, pneumatic_step.constant_pressure(math.nan), DeviceState(1e5, 0.24), 0.34, 1e-3)
    )
    assert math.isnan(
        unit.solve_length(PAIR, pneumatic_step.constant_pressure(1e5), DeviceState(1e5, 0.24), math.nan, 1e-3)
    )


@given(st.floats(0.3, 0.34), st.floats(1e5, 4.9e5))
def test_more_pressure_more_length_more_force(unit_length: float, pressure: float) -> None:
    def held(p: float, length: float) -> float:
        undamped = PAIR._replace(damper=PAIR.damper._replace(concentric_coefficient=0.0, eccentric_coefficient=0.0))
        state = unit.advance_state(undamped, DeviceState(p, 0.24), length, p, 1.0)
        return unit.compute_tension(undamped, state, length, 0.0)

    assert held(pressure + 1e4, unit_length) >= held(pressure, unit_length)
    assert held(pressure, unit_length + 0.002) >= held(pressure, unit_length)


def test_faster_shortening_is_weaker_and_faster_lengthening_stronger() -> None:
    def force_while_passing(speed: float) -> float:
        step, state = 1e-4, DeviceState(4e5, 0.235)
        count = round(0.01 / abs(speed) / step)
        for k in range(count + 1):
            length = 0.34 + speed * (k - count) * step
            state = unit.advance_state(PAIR, state, length, 4e5, step)
        return unit.compute_tension(PAIR, state, 0.34, 0.0)

    forces = [force_while_passing(v) for v in (-0.3, -0.1, -0.02, 0.02, 0.1, 0.15)]
    assert forces == sorted(forces)
    assert forces[0] < 0.9 * forces[2]


def booked(parameters: DeviceParameters, step: float) -> EnergyBalance:
    """The ledger of the third cycle of length and pressure."""
    state = DeviceState(2e5, 0.95 * parameters.muscle.resting_length)
    middle, count = state.length + parameters.tendon.slack_length + 0.008, round(0.5 / step)
    book = EnergyRecorder(parameters, count + 1)
    for k in range(-1 - 2 * count, count):
        angle = 2 * math.pi * k / count
        length = middle + 0.008 * math.sin(angle)
        after = unit.advance_state(parameters, state, length, 3e5 + 1.5e5 * math.sin(angle + 1.2), step)
        if k >= -1:
            book.record_sample(k + 1, after, length, (after.length - state.length) / step)
        state = after
    return book.to_energy_balance(step)


def test_ledger_closes_and_the_solvers_line_shrinks_with_the_square_of_the_step() -> None:
    solver = []
    for step in (1e-3, 2.5e-4):
        told = booked(PAIR, step)
        work = {line: step * getattr(told, line).sum() for line in (*POWER_TERMS, "delivered_power")}
        assert sum(work[line] for line in POWER_TERMS) == pytest.approx(work["delivered_power"], abs=1e-10)
        assert work["delivered_power"] == pytest.approx(work["gas_power"], rel=0.9)  # there is something to close
        solver.append(step * np.abs(told.solver_power).sum())
    assert solver[1] < 1e-3 * abs(work["delivered_power"])
    assert solver[1] < 0.15 * solver[0]


def test_a_wrong_law_shows_in_the_solvers_line(monkeypatch: pytest.MonkeyPatch) -> None:
    right = 5e-4 * np.abs(booked(PAIR, 5e-4).solver_power).sum()
    monkeypatch.setattr(mckibben, "bladder_energy", lambda muscle, length: 0.0)
    assert 5e-4 * np.abs(booked(PAIR, 5e-4).solver_power).sum() > 20 * right


def test_stops_only_take_and_only_when_hit() -> None:
    before = DeviceState(1e5, ANKLE.muscle.resting_length - 1e-4)
    after = unit.advance_state(ANKLE, before, REST + 0.12, 1e5, 5e-4)
    assert after.length == REST
    book = EnergyRecorder(ANKLE, 3)
    for k, (one, two) in enumerate(((before, before), (before, after), (after, after))):
        book.record_sample(k, two, REST + 0.12, (two.length - one.length) / 5e-4)
    hit = book.to_energy_balance(5e-4).stop_power
    assert hit[1] < 0.0  # pulled onto its resting length; half of it is before's imbalance, which is no balance
    assert hit[2] == 0.0  # on it, at rest
    free = [unit.advance_state(ANKLE, DeviceState(3e5, 0.25), 0.352, 3e5, 5e-4)]
    free.append(unit.advance_state(ANKLE, free[0], 0.352, 3e5, 5e-4))
    book = EnergyRecorder(ANKLE, 2)
    for k, (one, two) in enumerate(((DeviceState(3e5, 0.25), free[0]), free)):
        book.record_sample(k, two, 0.352, (two.length - one.length) / 5e-4)
    assert book.to_energy_balance(5e-4).stop_power[1] == pytest.approx(0.0, abs=1e-6)


def test_passive_without_the_friction_offset_at_constant_pressure() -> None:
    quiet = without_friction(PAIR)
    state = DeviceState(3e5, 0.24)
    work, step, count = 0.0, 2.5e-4, 2000
    for cycle in range(3):
        for k in range(count):
            angle = 2 * math.pi * k / count
            after = unit.advance_state(quiet, state, 0.335 + 0.01 * math.sin(angle), 3e5, step)
            if cycle == 2:
                rate = 0.01 * 2 * math.pi / (count * step) * math.cos(angle)
                work -= step * rate * unit.compute_tension(quiet, after, 0.335 + 0.01 * math.sin(angle), rate)
            state = after
    assert work < 0.0  # a closed loop at constant pressure only takes energy: the damper's


def test_friction_offset_has_a_ledger_line_of_its_own() -> None:
    with_offset, without = booked(PAIR, 5e-4), booked(without_friction(PAIR), 5e-4)
    assert np.abs(with_offset.friction_power).max() > 1.0
    assert not without.friction_power.any()
    assert with_offset.damper_power.sum() < 0.0
