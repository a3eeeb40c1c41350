"""Tests of the walk itself: two backends, exact resume, energy, time step, commands and pushes."""

import mujoco
import numpy as np
import pytest

from klute_sim.controllers.parse import parse_controller
from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.gait.rig import sensors as rig_sensors
from klute_sim.plant import callbacks
from klute_sim.types import Array
from klute_sim.walker.person.body import load_body
from klute_sim.walker.person.build import Prosthesis, build_walker_model
from klute_sim.walker.reflexes.walker_file import load_walker
from klute_sim.walker.simulation import state as layout
from klute_sim.walker.simulation import stepping
from klute_sim.walker.simulation.commands import DeviceCommands
from klute_sim.walker.simulation.simulate import WalkOptions
from klute_sim.walker.simulation.simulator import WalkSimulator
from klute_sim.walker.simulation.walk import Push, Walk

BODY = load_body()
INTACT, AMPUTEE = load_walker("intact-1").reflexes, load_walker("machine-1").reflexes
DEVICE = load_device("klute-1-1-4-pair")


def make_simulator(is_prosthetic: bool, backend: str = "compiled", dt: float = 1e-3) -> WalkSimulator:
    prosthesis = Prosthesis(device=DEVICE) if is_prosthetic else None
    simulator = WalkSimulator(build_walker_model(BODY, prosthesis, dt=dt), BODY, backend=backend)
    simulator.reset(AMPUTEE if is_prosthetic else INTACT)
    return simulator


@pytest.mark.parametrize("is_prosthetic", [False, True])
def test_backends_give_equal_bits(is_prosthetic: bool) -> None:
    states = []
    for backend in ("compiled", "python"):
        with callbacks.device_callbacks(backend):
            simulator = make_simulator(is_prosthetic, backend)
            if simulator.actuator is not None:
                simulator.actuator.set_command(simulator.data, 2e5)
            record = np.zeros((60, simulator.record_width))
            assert simulator.take_steps(60, push=20.0, record=record) == 60
            states.append((simulator.data.qpos.copy(), simulator.state.copy(), record))
    for compiled, python in zip(*states, strict=True):
        np.testing.assert_array_equal(compiled, python)


def test_record_ends_with_the_state_of_the_device_before_each_step() -> None:
    with callbacks.device_callbacks():
        simulator = make_simulator(True)
        assert simulator.actuator is not None
        simulator.actuator.set_command(simulator.data, 2e5)
        rows, states = np.zeros((60, simulator.record_width)), []
        for k in range(60):
            states.append(simulator.data.act[:2].copy())
            simulator.take_steps(1, record=rows[k : k + 1])
    np.testing.assert_array_equal(rows[:, -2:], states)
    assert np.ptp(states, axis=0).min() > 0.0


def test_snapshot_resumes_to_the_bit() -> None:
    with callbacks.device_callbacks():
        simulator = make_simulator(True)
        simulator.take_steps(700)
        snapshot = simulator.save()
        simulator.take_steps(500)
        expected = simulator.save()
        other = make_simulator(True)
        other.restore(snapshot)
        other.take_steps(500)
    for a, b in zip(other.save(), expected, strict=True):
        np.testing.assert_array_equal(a, b)
    with pytest.raises(InputError, match="the snapshot has"):
        make_simulator(False).restore(snapshot)


def test_steps_in_pieces_equal_steps_in_one_call() -> None:
    with callbacks.device_callbacks():
        whole, pieces = make_simulator(False), make_simulator(False)
        whole.take_steps(900)
        for n in (1, 9, 90, 800):
            pieces.take_steps(n)
    np.testing.assert_array_equal(whole.state, pieces.state)


def walk(seconds: float, dt: float = 1e-3) -> WalkSimulator:
    with callbacks.device_callbacks():
        simulator = make_simulator(False, dt=dt)
        assert Walk(simulator, DeviceCommands(simulator, None, 1)).advance(seconds)
    return simulator


@pytest.mark.slow
def test_time_step_changes_speed_and_cost_by_less_than_one_per_cent() -> None:
    outcomes = []
    for dt in (1e-3, 2.5e-4):
        simulator = walk(20.0, dt)
        x = float(simulator.data.qpos[0])
        outcomes.append((x, float(simulator.state[layout.METABOLIC_MINETTI]) / x))
    assert outcomes[0] == pytest.approx(outcomes[1], rel=0.01)


def measure_energy(simulator: WalkSimulator) -> float:
    """Return the kinetic and potential energy of the body [J]."""
    mujoco.mj_energyPos(simulator.model, simulator.data)
    mujoco.mj_energyVel(simulator.model, simulator.data)
    return float(simulator.data.energy.sum())


def test_work_of_the_muscles_and_of_the_push_accounts_for_the_energy_of_a_flying_body() -> None:
    """Without ground and stops only muscles, joint damping and the push work on the body."""
    model = build_walker_model(BODY, None, dt=1e-4)
    model.dof_damping[:] = 0.0
    with callbacks.device_callbacks():
        simulator = WalkSimulator(model, BODY)
        simulator.reset(INTACT)
        model.geom_contype[:] = model.geom_conaffinity[:] = 0
        model.jnt_limited[:] = 0
        mujoco.mj_forward(model, simulator.data)
        before = measure_energy(simulator)
        simulator.take_steps(600, push=100.0)
        mujoco.mj_forward(model, simulator.data)
    work = float(simulator.state[layout.MUSCLE_JOINT_WORK] + simulator.state[layout.PUSH_WORK])
    assert simulator.state[layout.PUSH_WORK] > 5.0
    assert measure_energy(simulator) - before == pytest.approx(work, rel=0.01)


@pytest.mark.parametrize("is_prosthetic", [False, True])
def test_energy_of_a_walk_closes_within_half_a_per_cent(is_prosthetic: bool) -> None:
    """Muscles, device, contacts with stops, joint damping and springs account for the energy of the body."""
    with callbacks.device_callbacks():
        simulator = make_simulator(is_prosthetic)
        model, data, dt = simulator.model, simulator.data, simulator.settings.dt
        commands = DeviceCommands(simulator, parse_controller("machine") if is_prosthetic else None, 3000)
        work = turnover = before = 0.0
        for k in range(2500):
            commands.update(k)
            if k == 500:
                mujoco.mj_fwdPosition(model, data)
                before = measure_energy(simulator)
            velocity = data.qvel.copy()
            simulator.take_steps(1)
            if k >= 500:
                motion = 0.5 * dt * (velocity + data.qvel)
                # The implicit integrator applies the damping at the velocity after the step.
                passive = data.qfrc_passive + model.dof_damping * (velocity - data.qvel)
                forces = data.qfrc_applied + data.qfrc_actuator + data.qfrc_constraint + passive
                # Springs are part of the potential energy.
                springs = -model.jnt_stiffness * (data.qpos - 0.5 * dt * data.qvel - model.qpos_spring)
                work += float((forces - springs) @ motion)
                turnover += float(np.abs(data.qfrc_applied) @ np.abs(motion))
        mujoco.mj_fwdPosition(model, data)
    assert turnover > 100.0
    assert abs(measure_energy(simulator) - before - work) < 0.005 * turnover


def test_fibers_and_tendons_account_for_the_work_on_the_joints() -> None:
    """What the fibers give goes into the joints and the tendons; over a whole walk the tendons keep nothing."""
    state = walk(12.0).state
    given, taken = float(state[layout.FIBER_WORK]), float(state[layout.MUSCLE_JOINT_WORK])
    assert abs(given - taken) < 0.02 * float(state[layout.POSITIVE_FIBER_WORK])


def test_a_walker_walks_and_falls_without_its_reflexes() -> None:
    simulator = walk(6.0)
    assert simulator.data.qpos[0] > 6.0
    with callbacks.device_callbacks():
        simulator.reset(INTACT)
        simulator.left, simulator.right = np.zeros_like(INTACT.left), np.zeros_like(INTACT.right)
        n = simulator.take_steps(3000)
    assert n < 2000
    assert simulator.has_fallen()


def test_forward_push_makes_the_walker_faster_for_a_moment() -> None:
    records = []
    for impulse in (10.0, 0.0):
        with callbacks.device_callbacks():
            simulator = make_simulator(False)
            commands = DeviceCommands(simulator, None, 1)
            rows = np.zeros((3000, simulator.record_width))
            Walk(simulator, commands, [Push(impulse=impulse, phase=0.5, after=1.0)], rows).advance(3.0)
        applied = rows[:, 2 * simulator.model.nq]
        assert applied.sum() * 1e-3 == pytest.approx(impulse, rel=0.02)
        records.append(rows)
    pushed, free = records
    n_q = int(simulator.model.nq)
    end = int(np.flatnonzero(pushed[:, 2 * n_q])[-1])
    gained = pushed[end, n_q] - free[end, n_q]
    assert 0.05 < gained < 2.0 * 10.0 / 75.0


def test_phase_estimate_is_that_of_the_gait_rig() -> None:
    """Foot strikes reset it, bounces do not, and the last stride scales it."""
    dt, n = 1e-2, 600
    load = np.where((np.arange(n) * dt) % 1.2 < 0.7, 0.8, 0.0)
    load[200:202] = 0.0  # a bounce
    state = np.zeros(layout.compute_state_size(2))
    state[layout.STRIDE_TIME] = state[layout.PHASE_TIME] = stepping.NOMINAL_STRIDE_TIME
    settings = make_simulator(False).settings._replace(dt=dt)
    sensors = rig_sensors.ProsthesisSensors.__new__(rig_sensors.ProsthesisSensors)
    sensors._interval, sensors._nominal_stride_time = dt, np.array([stepping.NOMINAL_STRIDE_TIME])
    sensors._in_stance, sensors._time_since_strike = np.array([False]), np.array([stepping.NOMINAL_STRIDE_TIME])
    sensors._stride_time = np.array([stepping.NOMINAL_STRIDE_TIME])
    for k in range(n):
        state[layout.PYLON_LOAD] = load[k]
        stepping.update_phase(settings, state)
        sensors.update_phase(np.array([load[k]]), np.array([True]))
        own = min(float(state[layout.PHASE_TIME] / state[layout.STRIDE_TIME]), 1.0)
        assert own == pytest.approx(float(sensors.estimate_phase()[0]), abs=1e-9)
    assert state[layout.STRIDE_TIME] == pytest.approx(1.2)


def command_pressures(controller: str | PressureProfile, seconds: float = 1.5) -> Array:
    chosen = parse_controller(controller) if isinstance(controller, str) else controller
    with callbacks.device_callbacks():
        simulator = make_simulator(True)
        commands = DeviceCommands(simulator, chosen, 3000)
        Walk(simulator, commands).advance(seconds)
    return commands.pressures[: round(seconds / 1e-3)]


def test_controllers_command_what_they_say() -> None:
    assert (command_pressures("constant:2") == 2e5).all()
    assert (command_pressures("off") == 0.0).all()
    machine = set(np.round(command_pressures("machine") / 1e5, 3))
    assert {1.1, 4.4, 0.9} <= machine
    profile = command_pressures(PressureProfile("p", (0.0, 50.0), (1.0, 3.0)))
    assert 1e5 <= profile.min() < profile.max() <= 3e5


def test_dead_time_delays_the_command() -> None:
    device = DEVICE.with_effect("pressure_delay", delay_s=0.007)
    arrived = []
    for chosen in (DEVICE, device):
        model = build_walker_model(BODY, Prosthesis(device=chosen))
        with callbacks.device_callbacks():
            simulator = WalkSimulator(model, BODY)
            simulator.reset(AMPUTEE)
            commands = DeviceCommands(simulator, parse_controller("machine"), 1000)
            values = []
            for k in range(40):
                commands.update(k)
                values.append(float(simulator.data.ctrl[0]))
                simulator.take_steps(1)
        arrived.append(values)
        assert commands.steps_per_update == (1 if chosen is device else 10)
    assert arrived[1][7:17] == arrived[0][:10]


def test_interval_of_a_controller_must_be_a_multiple_of_the_step() -> None:
    simulator = make_simulator(True, dt=7e-4)
    with pytest.raises(InputError, match="allowed: a whole fraction of the controller's interval, 10 ms"):
        DeviceCommands(simulator, parse_controller("machine"), 10)


def test_walk_that_ends_before_its_push_is_refused() -> None:
    assert WalkOptions(seconds=7.0, push=Push(impulse=5.0)).seconds == 7.0
    with pytest.raises(InputError, match="duration is 6; a push in the first stride after 5 s needs 7 s or more"):
        WalkOptions(seconds=6.0, push=Push(impulse=5.0))


def test_refusals_of_a_push() -> None:
    for values, sentence in (
        ({"impulse": 200.0}, "push is 200; allowed: -100 to 100"),
        ({"impulse": 5.0, "phase": 1.0}, "phase of the push is 100"),
        ({"impulse": 5.0, "after": -1.0}, "time of the push is -1"),
    ):
        with pytest.raises(InputError, match=sentence):
            Push(**values)  # type: ignore[arg-type]
