"""Rollouts without MuJoCo: the same time steps, any number of threads, and physical invariants."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.device import dynamics as dynamics
from klute_sim.device.device import list_presets, load_device
from klute_sim.device.dynamics import DeviceParameters, DeviceState
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.device.rollout import RolloutTrace, simulate_rollouts
from klute_sim.errors import InputError
from klute_sim.laws import mckibben, pneumatic_step
from klute_sim.laws.pneumatics import ATMOSPHERIC_PRESSURE

PAIR = load_device("klute-3-4-pair").parameters


def test_rollouts_equal_single_steps_on_both_backends() -> None:
    length = 0.335 + 0.01 * np.sin(np.arange(500) / 30)
    command = np.where(np.arange(500) % 100 < 50, 4e5, 0.5e5)
    state, expected = compute_taut_state(PAIR, length[0], command[0]), []
    for x, c in zip(length.tolist(), command.tolist(), strict=True):
        after = dynamics.advance_state(PAIR, state, x, c, 5e-4)
        expected.append((dynamics.compute_tension(PAIR, after, x, (after.length - state.length) / 5e-4), *after[:2]))
        state = after
    for backend in ("compiled", "python"):
        assert np.array_equal(
            np.stack(simulate_rollouts(PAIR, length, command, 5e-4, backend=backend), axis=1), expected
        )


def test_rollouts_of_a_rigid_device_equal_single_steps() -> None:
    tied = load_device("klute-1-2").parameters
    assert tied.tendon.is_rigid
    length = tied.muscle.resting_length * (0.9 + 0.05 * np.sin(np.arange(300) / 20))
    state, expected = compute_taut_state(tied, float(length[0]), 3e5), []
    for x in length.tolist():
        after = dynamics.advance_state(tied, state, x, 3e5, 5e-4)
        expected.append(dynamics.compute_tension(tied, after, x, (after.length - state.length) / 5e-4))
        state = after
    for backend in ("compiled", "python"):
        assert np.array_equal(
            simulate_rollouts(tied, length, np.full(300, 3e5), 5e-4, backend=backend).tension, expected
        )
    assert len(set(expected)) > 250


def test_rollouts_do_not_depend_on_the_number_of_threads() -> None:
    devices = [load_device(name).parameters for name in ("klute-3-4-pair", "klute-1-1-4-pair")] * 4
    length = 0.33 + 0.002 * np.arange(8)[:, None] + 0.005 * np.sin(np.arange(400) / 20)
    traces = [simulate_rollouts(devices, length, np.full(400, 3e5), 5e-4, n_jobs=n) for n in (1, 2, 5)]
    for other in traces[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(traces[0], other, strict=True))
    single = simulate_rollouts(devices[3], length[3], np.full(400, 3e5), 5e-4)
    assert single.tension.shape == (400,)
    assert all(np.array_equal(a[3], b) for a, b in zip(traces[0], single, strict=True))
    assert len(np.unique(traces[0].tension[:, -1])) == 8


def test_rollout_starts_in_the_initial_state() -> None:
    begin = DeviceState(2e5, 0.23)
    trace = simulate_rollouts(PAIR, [0.34], [2e5], 1e-4, initial_state=begin)
    assert trace.length[0] == pytest.approx(dynamics.advance_state(PAIR, begin, 0.34, 2e5, 1e-4).length)
    both = simulate_rollouts(PAIR, [[0.34], [0.34]], [2e5], 1e-4, initial_state=[begin, DeviceState(3e5, 0.22)])
    assert both.pressure[:, 0].tolist() == [2e5, 2.99e5]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((PAIR, [0.34], [np.nan], 1e-3), "finite"),
        ((PAIR, [np.inf], [1e5], 1e-3), "finite"),
        ((PAIR, [0.34], [1e5], 0.0), "dt is 0"),
        ((PAIR, [0.34], [1e5], np.nan), "dt is nan"),
        ((PAIR, [0.34], [1e5], 0.02), "allowed: above 0, up to 0.01 s"),
        ((PAIR, [0.34, 0.34], [1e5, 1e5, 1e5], 1e-3), "do not fit together"),
        (([PAIR, PAIR], np.ones((3, 5)), np.ones(5), 1e-3), "do not fit together"),
        ((PAIR, [], [], 1e-3), "do not fit together"),
        ((PAIR, 0.34, [1e5], 1e-3), "do not fit together"),
        (([], [0.34], [1e5], 1e-3), "0 devices, .* do not fit together"),
    ],
)
def test_invalid_input_is_refused_in_one_sentence(arguments: tuple, message: str) -> None:
    with pytest.raises(InputError, match=message):
        simulate_rollouts(*arguments)
    with pytest.raises(InputError, match="n_jobs is -1"):
        simulate_rollouts(PAIR, [0.34], [1e5], 1e-3, n_jobs=-1)
    with pytest.raises(InputError, match="3 initial states for 1 rollouts"):
        simulate_rollouts(PAIR, [0.34], [1e5], 1e-3, initial_state=[DeviceState(0.0, 0.2)] * 3)


def draw_device(random: np.random.Generator) -> DeviceParameters:
    """Return a random device: all parameters from wide ranges, some without damper, tendon or effects."""
    device = load_device(str(random.choice(list_presets()))).parameters
    longer = random.uniform(0.2, 3.0)
    muscle = device.muscle._replace(
        n_actuators=float(random.integers(1, 5)),
        resting_length=longer * device.muscle.resting_length,
        braid_length=longer * device.muscle.resting_length * random.uniform(1.01, 1.7),
        braid_turns=longer * device.muscle.braid_turns * random.uniform(0.7, 1.4),
        c10=device.muscle.c10 * random.choice([0.0, 1.0, 5.0]),
        friction_slope=device.muscle.friction_slope * random.choice([0.0, 1.0, 3.0]),
        friction_offset=device.muscle.friction_offset * random.choice([0.0, 1.0, -1.0]),
    )
    # As in a device file, the bladder fits into its braid and leaves room for air.
    radius = np.sqrt(muscle.braid_length**2 - muscle.resting_length**2) / (2.0 * np.pi * muscle.braid_turns)
    muscle = muscle._replace(bladder_radius=float(radius), bladder_thickness=float(radius * random.uniform(0.05, 0.5)))
    coefficients = random.choice([0.0, *10.0 ** np.arange(0, 13)], 2)
    tendon = device.tendon
    if not tendon.is_rigid:
        stiffness = 10.0 ** random.uniform(3, 7, 2) * random.choice([0.0, 1.0], 2)
        tendon = tendon._replace(
            slack_length=random.uniform(0.0, 0.3),
            stiffness_1=stiffness[0] + 1e3,
            stiffness_2=stiffness[1],
            engagement_stretch=random.uniform(0.0, 0.02),
        )
    supply = device.supply._replace(
        max_pressure=random.uniform(0.5e5, 10e5), max_pressure_rate=10.0 ** random.uniform(4, 9)
    )
    damper = device.damper._replace(
        concentric_coefficient=float(coefficients[0]), eccentric_coefficient=float(coefficients[1])
    )
    return DeviceParameters(muscle, damper, tendon, supply)


def simulate_random_devices(seed: int, rollouts: int, samples: int) -> tuple[list[DeviceParameters], RolloutTrace]:
    """Simulate random devices under lengths and commands that jump."""
    random = np.random.default_rng(seed)
    devices = [draw_device(random) for _ in range(rollouts)]
    slack = np.array([d.tendon.slack_length for d in devices])[:, None]
    rest = np.array([d.muscle.resting_length for d in devices])[:, None]
    drift = np.cumsum(random.normal(0.0, 1e-3, (rollouts, samples)), axis=1)
    jumps = random.uniform(-1.0, 1.5, (rollouts, samples)) * (random.random((rollouts, samples)) < 0.01)
    length = np.abs(slack + rest * (0.9 + drift + np.where(jumps != 0.0, jumps, 0.0)))
    pressure = np.array([d.supply.max_pressure for d in devices])[:, None]
    command = pressure * random.uniform(-3.0, 4.0, (rollouts, samples // 20 + 1)).repeat(20, axis=1)[:, :samples]
    command[random.random(command.shape) < 1e-3] *= 1e12
    return devices, simulate_rollouts(devices, length, command, float(10.0 ** random.uniform(-4, np.log10(5e-3))))


def check_invariants(devices: list[DeviceParameters], trace: RolloutTrace) -> None:
    for i, device in enumerate(devices):
        assert np.isfinite(trace.tension[i]).all()
        if pneumatic_step.is_ideal(device.supply):
            assert trace.pressure[i].min() >= 0.0
            assert trace.pressure[i].max() <= device.supply.max_pressure
        else:  # the motion of the muscle compresses and expands its air
            assert trace.pressure[i].min() > -ATMOSPHERIC_PRESSURE
            assert trace.pressure[i].max() < 100.0 * (device.supply.max_pressure + ATMOSPHERIC_PRESSURE)
        assert trace.length[i].max() <= device.muscle.resting_length
        assert trace.length[i].min() >= mckibben.lock_length(device.muscle)
        if not device.tendon.is_rigid:
            assert trace.tension[i].min() >= 0.0


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 10))])
def test_invariants_hold_for_random_devices(seed: int) -> None:
    for part in range(8):
        check_invariants(*simulate_random_devices(100 * seed + part, rollouts=125, samples=1000))


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**31), st.floats(1e-4, 5e-3))
def test_steps_of_random_devices_balance_to_the_tolerance(seed: int, step: float) -> None:
    random = np.random.default_rng(seed)
    device = draw_device(random)
    if device.tendon.is_rigid:
        return
    low, high = mckibben.lock_length(device.muscle), device.muscle.resting_length
    for _ in range(20):
        begin, pressure = random.uniform(low, high), random.uniform(0.0, device.supply.max_pressure)
        length = device.tendon.slack_length + random.uniform(0.8 * low, 1.05 * high)
        solved_length = dynamics.solve_length(
            device, pneumatic_step.constant_pressure(pressure), DeviceState(pressure, begin), length, step
        )
        imbalance = dynamics._compute_force_residual(
            device,
            pneumatic_step.constant_pressure(pressure),
            DeviceState(pressure, begin),
            length,
            step,
            solved_length,
        )
        if low < solved_length < high:
            state, neighbours = DeviceState(pressure, begin), [np.nextafter(solved_length, to) for to in (0, 1)]
            nearby = [
                dynamics._compute_force_residual(
                    device, pneumatic_step.constant_pressure(pressure), state, length, step, neighbour
                )
                for neighbour in neighbours
            ]
            pull = dynamics.compute_tension(device, DeviceState(pressure, solved_length), length, 0.0)
            # Solved, or the root lies between this length and an adjacent floating-point number.
            assert abs(imbalance) <= 1e-10 * (1.0 + pull) or nearby[0] * nearby[1] <= 0.0
        else:
            assert imbalance * (1 if solved_length == low else -1) >= 0.0
