"""Dry friction inside the tendon: limits, virgin curve, Masing's rule, loss of a cycle, memory, and passivity."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.equilibrium import compute_equilibrium_state, compute_taut_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.effects import catalogue
from klute_sim.effects.families import tendon
from klute_sim.effects.smoothing import EQUILIBRIUM_TIME_STEP
from klute_sim.laws import tendon as laws_tendon
from klute_sim.types import Array
from tests.effects.test_tendon_laws import ALONE, MUSCLE, SPRINGS, STIFFNESS, check_convergence, stretch_tendon


class Parameters(NamedTuple):
    """Parameters of the form in SI units."""

    friction: float
    presliding: float


class State(NamedTuple):
    """States of the form [m]."""

    slider_1: float = 0.0
    slider_2: float = 0.0
    slider_3: float = 0.0


def make_slip(friction_n: float, presliding_mm: float, device: DeviceParameters = ALONE) -> DeviceParameters:
    effects = {("tendon_hysteresis", "maxwell_slip"): {"friction_n": friction_n, "presliding_mm": presliding_mm}}
    return device._replace(effects=catalogue.pack_effects(effects))


def step(p: Parameters, state: State, stretch: float, dt: float = 1e-3) -> State:
    values: Any = tendon.step_tendon_sliders(p, state, MUSCLE, 0.0, 0.0, 0.25, stretch, dt)
    return State(*values)


def compute_virgin_force(friction: float, presliding: float, x: Array) -> Array:
    """Return the friction [N] of a tendon that is pulled from slack to ``x`` >= 0."""
    return friction / (2.0 * presliding) * sum(np.minimum(x, presliding * i / 3.0) for i in (1, 2, 3))


def compute_cycle_loss(friction: float, presliding: float, amplitude: float, speed: float = 0.02) -> float:
    """Return the loss [J] of a settled cycle of ``amplitude`` [m] about a stretch that keeps the tendon taut."""
    n = 600
    cycle = amplitude * np.concatenate([np.linspace(-1.0, 1.0, n + 1)[1:], np.linspace(1.0, -1.0, n + 1)[1:]])
    stretch = 120e-3 + np.concatenate([[-amplitude], cycle, cycle])
    tension = stretch_tendon(make_slip(friction, 1e3 * presliding), stretch, 2.0 * amplitude / (n * speed))
    return compute_work(stretch, tension, len(stretch) - 2 * n - 1)


def compute_work(stretch: Array, tension: Array, start: int = 0) -> float:
    """Return the work [J] that stretching the tendon takes from sample ``start`` on (trapezoidal rule)."""
    return float(np.sum(0.5 * (tension[start + 1 :] + tension[start:-1]) * np.diff(stretch[start:])))


def store(p: Parameters, state: State, stretch: float) -> float:
    """Return the energy [J] in the three springs of the friction."""
    return 0.25 * p.friction / p.presliding * sum((max(0.0, stretch) - slider) ** 2 for slider in state)


def test_sliders_follow_at_their_distances_and_stay_while_slack() -> None:
    p = Parameters(60.0, 3e-3)
    state = step(p, State(), 2.5e-3)
    assert state == pytest.approx((1.5e-3, 0.5e-3, 0.0), abs=1e-15)
    assert tendon.maxwell_slip_force(p, state, 100.0, 2.5e-3, SPRINGS) == pytest.approx(
        100.0 + 1e4 * (1e-3 + 2e-3 + 2.5e-3)
    )
    state = step(p, state, 6e-3)
    assert state == pytest.approx((5e-3, 4e-3, 3e-3), abs=1e-15)
    assert tendon.maxwell_slip_force(p, state, 100.0, 6e-3, SPRINGS) == pytest.approx(160.0)
    assert step(p, state, 4.5e-3) == state  # nothing slides
    slack = step(p, state, -1e-3)
    assert slack == step(p, state, 0.0)
    assert tendon.maxwell_slip_force(p, slack, 0.0, -1e-3, SPRINGS) == 0.0
    for stretch in (-5e-3, -1e-3, -2e-3, 0.0):
        slack = step(p, slack, stretch)
    assert slack == step(p, state, 0.0)


@pytest.mark.parametrize("presliding", [0.02, 1.0, 8.0])
def test_tendon_at_rest_is_on_its_virgin_curve(presliding: float) -> None:
    """It is there as one pulled from slack: at its first sample a record under a preload has the whole friction."""
    device, friction = make_slip(100.0, presliding), 100.0
    slack = device.tendon.slack_length + device.muscle.resting_length
    pulled = stretch_tendon(device, np.linspace(0.0, 4e-3, 101), 1e-3)[-1]
    virgin = STIFFNESS * 4e-3 + compute_virgin_force(friction, 1e-3 * presliding, np.array([4e-3]))
    assert pulled == pytest.approx(float(virgin[0]), rel=1e-12)
    for compute_state in (compute_taut_state, compute_equilibrium_state):
        state = compute_state(device, slack + 4e-3, 0.0)
        trace = simulate_rollouts(device, np.full(3, slack + 4e-3), np.zeros(3), 1e-3, initial_state=state)
        assert trace.tension == pytest.approx(np.full(3, pulled), rel=1e-12)
    p = Parameters(friction, 1e-3 * presliding)
    assert step(p, State(), 4e-3, EQUILIBRIUM_TIME_STEP) == step(p, State(), 4e-3)


@pytest.mark.parametrize(("friction", "presliding"), [(20.0, 1.0), (1000.0, 0.02), (1000.0, 50.0)])
@pytest.mark.parametrize("unit_length", [0.32, 0.338, 0.345])
def test_muscle_and_tendon_rest_in_equilibrium(friction: float, presliding: float, unit_length: float) -> None:
    """The equilibrium with friction is that of a tendon with the virgin curve, and it stays."""
    device = make_slip(friction, presliding, load_device("klute-3-4-pair").parameters)
    state = compute_equilibrium_state(device, unit_length, 4e5)
    stretch = max(0.0, unit_length - state.length - device.tendon.slack_length)
    trace = simulate_rollouts(device, np.full(400, unit_length), np.full(400, 4e5), 5e-3, initial_state=state)
    assert np.ptp(trace.tension) < 1e-3 * (1.0 + trace.tension.max())
    spring = laws_tendon.force(device.tendon, stretch)
    virgin = float(compute_virgin_force(friction, 1e-3 * presliding, np.array([stretch]))[0])
    assert trace.tension[0] == pytest.approx(spring + virgin, rel=1e-3, abs=0.1)


@given(st.floats(2e-5, 5e-2), st.floats(0.0, 2e-2), st.floats(0.0, 2e-2), st.floats(0.0, 2e-2), st.integers(1, 40))
def test_result_of_a_monotone_move_does_not_depend_on_its_steps(
    presliding: float, top: float, start: float, end: float, n_steps: int
) -> None:
    p = Parameters(10.0, presliding)
    first = step(p, step(p, State(), top), start)
    state = first
    for stretch in np.linspace(start, end, n_steps + 1)[1:].tolist():
        state = step(p, state, stretch)
    assert state == pytest.approx(step(p, first, end), abs=1e-15)


def test_short_presliding_is_dry_friction() -> None:
    friction = 40.0
    stretch = 1e-3 * np.concatenate(
        [np.linspace(0.0, 8.0, 81), np.linspace(8.0, 2.0, 61)[1:], np.linspace(2.0, 6.0, 41)[1:]]
    )
    tension = stretch_tendon(make_slip(friction, 0.02), stretch, 1e-3)
    sign = np.sign(np.diff(stretch, prepend=-1e-3))
    away = np.abs(stretch[:, None] - np.array([0.0, 8e-3, 2e-3])).min(axis=1) > 0.05e-3
    assert (tension - STIFFNESS * stretch)[away] == pytest.approx(friction * sign[away], abs=1e-6)


def test_long_presliding_is_a_spring() -> None:
    """For moves shorter than d/3 from slack nothing slides: a spring of 3 F/(2d)."""
    friction, presliding = 40.0, 50e-3
    stretch = 6e-3 + 4e-3 * np.sin(np.linspace(0.0, 6.0 * np.pi, 600))
    tension = stretch_tendon(make_slip(friction, 1e3 * presliding), stretch, 1e-3)
    assert tension == pytest.approx((STIFFNESS + 1.5 * friction / presliding) * stretch, rel=1e-9)


@pytest.mark.parametrize("ratio", [0.2, 0.4, 0.8, 1.0, 3.0, 30.0])
def test_loss_of_a_settled_cycle_is_that_of_three_elements_at_any_speed(ratio: float) -> None:
    """A cycle of amplitude A loses 4 sum k y_i max(0, A - y_i): nothing below d/3, 4 F (A - 7 d/9) above d."""
    friction, amplitude = 30.0, 2e-3
    presliding = amplitude / ratio
    loss = compute_cycle_loss(friction, presliding, amplitude)
    distances = presliding * np.arange(1, 4) / 3.0
    expected = 2.0 * friction / presliding * np.sum(distances * np.maximum(0.0, amplitude - distances))
    scale = 4.0 * friction * amplitude
    assert loss == pytest.approx(expected, abs=1e-3 * scale)
    if ratio >= 1.0:
        assert expected == pytest.approx(4.0 * friction * (amplitude - 7.0 / 9.0 * presliding))
    assert loss == pytest.approx(compute_cycle_loss(friction, presliding, amplitude, speed=2.0), abs=1e-9 * scale)


def compute_friction(stretch: Array, p: Parameters) -> Array:
    """Return the friction [N] along ``stretch`` from slack."""
    state, force = State(), np.empty(len(stretch))
    for k, x in enumerate(stretch.tolist()):
        state = step(p, state, x)
        force[k] = tendon.maxwell_slip_force(p, state, 0.0, x, SPRINGS)
    return force


@pytest.mark.parametrize("presliding", [0.5e-3, 2e-3, 6e-3])
def test_branch_after_a_reversal_is_the_virgin_curve_at_twice_its_size(presliding: float) -> None:
    """Masing's rule: F(x) = F_r - 2 V((x_r - x)/2), as long as no older reversal is passed."""
    p = Parameters(80.0, presliding)
    down = np.linspace(9e-3, 1e-3, 200)
    force = compute_friction(np.concatenate([np.linspace(0.0, 9e-3, 200), down]), p)[200:]
    assert force == pytest.approx(
        force[0] - 2.0 * compute_virgin_force(p.friction, presliding, 0.5 * (9e-3 - down)), abs=1e-9
    )


@given(
    st.floats(0.2e-3, 2e-2),
    st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3),
    st.floats(1e-3, 15e-3),
)
def test_minor_loop_closes_and_is_forgotten(presliding: float, corners: list[float], top: float) -> None:
    """Return-point memory: after a closed minor loop the tendon goes on as if it had not been there."""
    low, high = sorted(corners[:2])
    p, turn = Parameters(50.0, presliding), top * low
    direct = step(p, step(p, State(), top), turn)
    state = direct
    for x in (top * high, turn + corners[2] * (top * high - turn), top * high, turn):
        state = step(p, state, x)
    assert state == pytest.approx(direct, abs=1e-15)
    # Going on beyond the older reversal returns to the virgin curve.
    assert step(p, state, 1.5 * top) == pytest.approx(step(p, State(), 1.5 * top), abs=1e-15)


FORCES = st.floats(1.0, 1000.0)
PRESLIDINGS = st.floats(2e-5, 5e-2)
PATHS = st.lists(st.floats(-3e-3, 15e-3), min_size=1, max_size=8)


@given(FORCES, PRESLIDINGS, PATHS)
def test_work_covers_what_the_friction_stores(friction: float, presliding: float, path: list[float]) -> None:
    """On any part of any path, also where the tendon is slack, with the work of the friction alone."""
    p, state, x, force, stored = Parameters(friction, presliding), State(), 0.0, 0.0, 0.0
    for end in path:
        work = 0.0
        for new in np.linspace(x, end, 601)[1:].tolist():
            state = step(p, state, new)
            assert all(slider >= 0.0 for slider in state)
            new_force = tendon.maxwell_slip_force(p, state, 0.0, new, SPRINGS) if new > 0.0 else force
            if new > 0.0 or x > 0.0:
                at_slack = -0.5 * friction / presliding * sum(state)
                first, last = (force if x > 0.0 else at_slack), (new_force if new > 0.0 else at_slack)
                work += 0.5 * (first + last) * (max(0.0, new) - max(0.0, x))
            x, force = new, new_force
        now = store(p, state, end)
        # Trapezoids cut the corner where a slider begins to move in a step.
        step_size = 15e-3 / 600
        assert now - stored <= work + 6.0 * friction / presliding * step_size**2 + 1e-12 * friction
        stored = now


@given(FORCES, PRESLIDINGS, PATHS, st.floats(1.0, 500.0))
def test_no_part_of_a_path_from_rest_returns_more_than_it_took(
    friction: float, presliding: float, path: list[float], stiffness_n_per_mm: float
) -> None:
    """Also where the friction holds the springs back and the tension is clipped at 0."""
    p, stiffness = Parameters(friction, presliding), 1e3 * stiffness_n_per_mm
    corners = np.array([0.0, *path, 0.0])
    stretch = np.interp(np.linspace(0.0, len(corners) - 1.0, 400 * len(corners)), np.arange(len(corners)), corners)
    tension = np.maximum(0.0, stiffness * np.maximum(0.0, stretch) + compute_friction(stretch, p))
    move = np.diff(stretch)
    work = np.cumsum(0.5 * (tension[1:] + tension[:-1]) * move)
    # Trapezoids err by less than the change of the tension in a step times the step.
    error = np.cumsum(np.abs(np.diff(tension) * move))
    assert (work >= -0.5 * error - 1e-12).all()


@given(FORCES, PRESLIDINGS, PATHS)
def test_no_path_from_rest_gains_energy_from_a_tendon(friction: float, presliding: float, path: list[float]) -> None:
    corners = np.array([0.0, *path, 0.0])
    stretch = np.interp(np.linspace(0.0, len(corners) - 1.0, 3000), np.arange(len(corners)), corners)
    tension = stretch_tendon(make_slip(friction, 1e3 * presliding), stretch, 1e-3)
    assert tension.min() >= 0.0
    assert compute_work(stretch, tension) >= -1e-3 * tension.max() * 1e-3


def test_tension_is_continuous_where_the_tendon_becomes_slack_and_taut() -> None:
    stretch = 4e-3 * np.sin(np.linspace(0.0, 8.0 * np.pi, 200_001))
    for presliding in (0.02, 1.0, 50.0):
        tension = stretch_tendon(make_slip(100.0, presliding), stretch, 1e-3)
        slope = STIFFNESS + 1.5 * 100.0 / (1e-3 * presliding)
        assert np.abs(np.diff(tension)).max() < 1.001 * slope * np.abs(np.diff(stretch)).max()
        assert (tension[stretch <= 0.0] == 0.0).all()


def test_a_cycle_in_which_the_tendon_is_slack_repeats() -> None:
    """The state that the tendon has when it becomes slack is the one with which it becomes taut again."""
    stretch = 4e-3 * np.sin(2.0 * np.pi * np.arange(4001) / 1000)
    tension = stretch_tendon(make_slip(100.0, 2.0), stretch, 1e-3)
    assert tension[2000:3000] == pytest.approx(tension[3000:4000], abs=0.05)
    lifted = stretch - np.where(stretch < 0.0, 5e-3, 0.0)  # how far it is slack does not matter
    assert stretch_tendon(make_slip(100.0, 2.0), lifted, 1e-3) == pytest.approx(tension, abs=1e-12)


@pytest.mark.parametrize("dt", [5e-4, 1e-3, 5e-3])
@pytest.mark.parametrize(("friction", "presliding"), [(10.0, 1.0), (100.0, 0.02), (1000.0, 5.0)])
def test_friction_of_a_tendon_beside_a_muscle_is_stable_and_converges(
    friction: float, presliding: float, dt: float
) -> None:
    device = make_slip(friction, presliding, load_device("klute-3-4-pair").parameters)
    check_convergence(device, dt)
