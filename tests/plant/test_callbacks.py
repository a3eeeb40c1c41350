"""Two backends of one device: identical bits, coexistence with other callbacks, and clear errors."""

import multiprocessing
import pickle
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import mujoco
import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.errors import InputError, KluteSimError, KluteSimWarning, SimulationError
from klute_sim.gait.rig.setup import DRIVE_ACTUATORS, GaitOptions, GaitRig, build_gait_rig, reset_gait_rig
from klute_sim.plant import batch, callbacks, models, struct_layout
from klute_sim.plant.actuator import DeviceActuator

DEVICE = load_device("klute-1-1-4-pair")
BOTH = pytest.mark.parametrize("backend", ["compiled", "python"])
STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@pytest.fixture(autouse=True)
def run_in_temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its own warnings to a log file where it stands


def ankle() -> tuple[mujoco.MjModel, mujoco.MjData, DeviceActuator]:
    model = models.attach_devices(models.load_spec("ankle"), {"muscle_tendon": DEVICE.parameters})
    return model, mujoco.MjData(model), DeviceActuator(model, "muscle_tendon")


def simulate(rig: GaitRig, backend: str, steps: int) -> np.ndarray:
    """Every state of a walk with a pressure that jumps."""
    data, states = mujoco.MjData(rig.model), []
    reset_gait_rig(rig, data, 1e5)
    with callbacks.device_callbacks(backend) as active:
        assert active == backend
        for k in range(steps):
            data.ctrl[: len(DRIVE_ACTUATORS)] = rig.command_rates[k % rig.commands_per_stride]
            data.ctrl[rig.actuator.ctrl_address] = (k // 300) % 6
            callbacks.step_model(rig.model, data)
            states.append(np.concatenate([data.qpos, data.qvel, data.act, data.sensordata]))
    return np.array(states)


@pytest.mark.slow
def test_gait_steps_are_identical_alone_in_threads_and_in_a_batch() -> None:
    rig, steps = build_gait_rig(DEVICE, GaitOptions(), 5e-4), 10_000
    reference = simulate(rig, "python", steps)
    assert np.isfinite(reference).all()
    assert np.array_equal(simulate(rig, "compiled", steps), reference)

    traces: list[np.ndarray] = []
    threads = [threading.Thread(target=lambda: traces.append(simulate(rig, "compiled", steps))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(traces) == 2
    assert all(np.array_equal(trace, reference) for trace in traces)

    simulations = batch.create_batch(rig.model, 2, n_threads=2)
    data = mujoco.MjData(rig.model)
    reset_gait_rig(rig, data, 1e5)
    for row in simulations.state:
        mujoco.mj_getState(rig.model, data, row, STATE)
    bound = [simulations.bind(name) for name in ("qpos", "qvel", "act", "sensordata")]
    ctrl = simulations.bind("ctrl")
    for k in range(steps):
        ctrl[:, : len(DRIVE_ACTUATORS)] = rig.command_rates[k % rig.commands_per_stride]
        ctrl[:, rig.actuator.ctrl_address] = (k // 300) % 6
        batch.step_batch(simulations)
        now = np.concatenate(bound, axis=1)
        assert np.array_equal(now[0], reference[k])
        assert np.array_equal(now[1], reference[k])


def test_batch_of_different_devices_equals_separate_models() -> None:
    strong, light = DEVICE.parameters, load_device("klute-3-4-pair").parameters
    model, *_ = ankle()
    simulations = batch.create_batch(model, 2, n_threads=2)
    batch.set_parameters(simulations, "muscle_tendon", [strong, light])
    simulations.bind("ctrl")[:] = 3.0
    batch.step_batch(simulations, n_steps=200)
    for i, parameters in enumerate((strong, light)):
        separate_model = models.attach_devices(models.load_spec("ankle"), {"muscle_tendon": parameters})
        data = mujoco.MjData(separate_model)
        data.ctrl[:] = 3.0
        with callbacks.device_callbacks():
            callbacks.step_model(separate_model, data, 200)
        assert np.array_equal(data.act, simulations.bind("act")[i])
    assert not np.array_equal(*simulations.bind("act"))


def test_batch_refuses_unsupported_devices_and_callbacks() -> None:
    model, *_ = ankle()
    simulations = batch.create_batch(model, 2)
    with pytest.raises(InputError, match="1 devices for 2 simulations"):
        batch.set_parameters(simulations, "muscle_tendon", [DEVICE.parameters])
    with pytest.raises(InputError, match="with a rigid tendon"):
        batch.set_parameters(simulations, "muscle_tendon", [load_device("klute-3-4").parameters] * 2)
    mujoco.set_mjcb_act_bias(lambda m, d, i: 0.0)
    try:
        with pytest.warns(KluteSimWarning), pytest.raises(InputError, match="Python callbacks"):
            batch.step_batch(simulations)
    finally:
        mujoco.set_mjcb_act_bias(None)


def test_models_compile_while_compiled_callbacks_are_installed() -> None:
    with callbacks.device_callbacks("compiled"):
        model, data, actuator = ankle()
        data.ctrl[:] = 4.0
        callbacks.step_model(model, data, 300)
    assert actuator.get_tension(data) > 500.0


@BOTH
def test_installed_callbacks_do_not_change_other_models(backend: str) -> None:
    other = mujoco.MjModel.from_xml_string("""
        <mujoco><worldbody><body><joint name="j" type="slide"/><geom size=".1"/></body></worldbody>
        <actuator>
          <muscle joint="j" lengthrange="-1 1" user="1999001 2 3"/>
          <general joint="j" dyntype="user" actdim="2" gaintype="user" biastype="user" user="3"/>
        </actuator></mujoco>""")

    def run() -> list[float]:
        data = mujoco.MjData(other)
        data.ctrl[:] = 0.7
        for _ in range(50):
            mujoco.mj_step(other, data)
        return [*data.qpos, *data.act]

    alone = run()
    with callbacks.device_callbacks(backend):
        assert run() == alone


@BOTH
def test_copies_and_pickles_keep_the_device(backend: str) -> None:
    model, data, actuator = ankle()
    data.ctrl[:] = 4.0
    copies = [pickle.loads(pickle.dumps((model, data, actuator))) for _ in range(2)]
    with callbacks.device_callbacks(backend):
        for model_copy, data_copy, device in [(model, data, actuator), *copies]:
            callbacks.step_model(model_copy, data_copy, 300)
            assert device.get_tension(data_copy) == actuator.get_tension(data) > 500.0


def _compute_tension_in_process(backend: str) -> float:
    model, data, actuator = ankle()
    data.ctrl[:] = 4.0
    with callbacks.device_callbacks(backend):
        callbacks.step_model(model, data, 300)
    return actuator.get_tension(data)


@BOTH
@pytest.mark.skipif(not hasattr(multiprocessing, "get_context") or sys.platform == "win32", reason="needs fork")
def test_forked_child_has_the_callbacks_while_another_thread_was_inside(backend: str) -> None:
    expected = _compute_tension_in_process(backend)
    inside, leave = threading.Event(), threading.Event()

    def stay() -> None:
        with callbacks.device_callbacks(backend):
            inside.set()
            leave.wait()

    thread = threading.Thread(target=stay)
    thread.start()
    inside.wait()
    try:
        with multiprocessing.get_context("fork").Pool(1) as pool:
            assert pool.apply(_slots) == (None, None)
            assert pool.apply(_compute_tension_in_process, (backend,)) == expected
    finally:
        leave.set()
        thread.join()


def _step_on(model: mujoco.MjModel, data: mujoco.MjData, actuator: DeviceActuator) -> float:
    callbacks.step_model(model, data, 100)
    with callbacks.device_callbacks():
        callbacks.step_model(model, data, 100)
    callbacks.step_model(model, data, 100)
    return actuator.get_tension(data)


@pytest.mark.skipif(sys.platform == "win32", reason="needs fork")
def test_forking_thread_stays_inside_in_the_child() -> None:
    made = ankle()
    made[1].ctrl[:] = 4.0
    with callbacks.device_callbacks("compiled"):
        with multiprocessing.get_context("fork").Pool(1) as pool:
            there = pool.apply(_step_on, made)
        assert there == _step_on(*made) > 500.0


def _slots() -> tuple[object, object]:
    return mujoco.get_mjcb_act_dyn(), mujoco.get_mjcb_act_bias()


def test_profiler_reads_no_clock_while_devices_are_compiled_unless_the_user_times_it() -> None:
    model, data, _ = ankle()
    timer = data.timer[mujoco.mjtTimer.mjTIMER_STEP]
    with callbacks.device_callbacks("compiled"):
        callbacks.step_model(model, data)
    assert timer.duration == 0.0
    mujoco.mj_step(model, data)
    assert timer.duration > 0.0
    readings: list[float] = []
    mujoco.set_mjcb_time(lambda: readings.append(0.0) or 0.0)
    try:
        with callbacks.device_callbacks("compiled"):
            callbacks.step_model(model, data)
        assert mujoco.get_mjcb_time() is not None
    finally:
        mujoco.set_mjcb_time(None)
    assert readings


def test_new_process_gives_the_same_bits() -> None:
    script = (
        "import mujoco\nfrom klute_sim.device.device import load_device\n"
        "from klute_sim.plant import callbacks, models\n"
        "device = load_device('klute-1-1-4-pair').parameters\n"
        "m = models.attach_devices(models.load_spec('ankle'), {'muscle_tendon': device})\n"
        "d = mujoco.MjData(m); d.ctrl[:] = 4.0\n"
        "with callbacks.device_callbacks('compiled'): callbacks.step_model(m, d, 300)\n"
        "print(-d.actuator_force[0])"
    )
    process = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert float(process.stdout) == _compute_tension_in_process("python")


@BOTH
@pytest.mark.parametrize("what", ["command", "inf", "pressure"])
def test_nonfinite_state_is_reported_at_its_step(backend: str, what: str) -> None:
    model, data, actuator = ankle()
    with callbacks.device_callbacks(backend):
        callbacks.step_model(model, data, 10)
        before = data.qpos.copy()
        if what in ("command", "inf"):
            data.ctrl[:] = np.inf if what == "inf" else np.nan
        else:
            data.act[0] = np.nan
        with pytest.raises(SimulationError, match=r"actuator 'muscle_tendon' has no finite state at t = 0\.0050 s: .*"):
            callbacks.step_model(model, data)
        if backend == "python":
            assert np.array_equal(data.qpos, before)  # not taken
        else:
            assert actuator.get_tension(data) == 0.0
        for _ in range(3):
            with pytest.raises(SimulationError):
                callbacks.step_model(model, data)
        assert np.isfinite(data.qpos).all()
        assert np.isfinite(data.qvel).all()
        # Finite again, the simulation continues.
        data.ctrl[:], data.act[:] = 1.0, [0.5, -0.001]
        callbacks.step_model(model, data, 10)
    assert np.isfinite(data.act).all()


def test_nonfinite_state_in_mj_step_is_reported_on_exit() -> None:
    model, data, _ = ankle()
    data.ctrl[:] = np.nan
    message = r"'muscle_tendon'.*pressure command nan bar"
    with pytest.raises(SimulationError, match=message), callbacks.device_callbacks("compiled"):
        mujoco.mj_step(model, data, 5)
    with callbacks.device_callbacks("compiled"):  # a fault is reported once
        pass


def test_fault_is_reported_for_its_simulation() -> None:
    model, data, _ = ankle()
    healthy = mujoco.MjData(model)
    data.ctrl[:] = np.nan
    with callbacks.device_callbacks("compiled"):
        mujoco.mj_step(model, data)
        callbacks.step_model(model, healthy)
        with pytest.raises(SimulationError):
            callbacks.step_model(model, data)


def test_fault_is_reported_in_its_thread() -> None:
    model, data, _ = ankle()
    data.ctrl[:] = np.nan
    messages: list[str] = []

    def fail() -> None:
        try:
            with callbacks.device_callbacks("compiled"):
                mujoco.mj_step(model, data)
        except SimulationError as error:
            messages.append(str(error))

    with callbacks.device_callbacks("compiled"):
        thread = threading.Thread(target=fail)
        thread.start()
        thread.join()
        callbacks.step_model(model, mujoco.MjData(model))
    assert len(messages) == 1
    assert "'muscle_tendon' has no finite state" in messages[0]


def test_step_outside_the_context_gives_no_force() -> None:
    model, data, actuator = ankle()
    data.ctrl[:] = np.nan
    callbacks.step_model(model, data)
    assert actuator.get_tension(data) == 0.0


def test_user_exception_is_not_hidden() -> None:
    model, data, _ = ankle()
    data.ctrl[:] = np.nan

    def step_and_fail() -> None:
        with callbacks.device_callbacks("compiled"):
            mujoco.mj_step(model, data)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        step_and_fail()
    with callbacks.device_callbacks("compiled"):  # and its fault is not reported to another context
        pass


def test_model_without_its_device_is_refused() -> None:
    with pytest.raises(InputError, match="'muscle_tendon' is made for a device and has none"):
        models.attach_devices(models.load_spec("ankle"), {})
    with pytest.raises(InputError, match="no actuator 'achilles'; it has: muscle_tendon"):
        models.attach_devices(models.load_spec("ankle"), {"achilles": DEVICE.parameters})
    with pytest.raises(InputError, match="'muscle_tendon' carries no device"):
        DeviceActuator(models.load_spec("ankle").compile(), "muscle_tendon")


def test_wrong_offsets_are_detected() -> None:
    layout = struct_layout.get_layout()
    struct_layout._check_layout(layout)
    for struct in ("model", "data"):
        for name in getattr(layout, struct):
            other = struct_layout.StructLayout(dict(layout.model), dict(layout.data))
            detected_shifts = []
            for shift in (8, -8):  # an empty array starts where its neighbour does, so one shift may go undetected
                getattr(other, struct)[name] = getattr(layout, struct)[name] + shift
                with suppress(struct_layout.UnknownLayoutError):
                    struct_layout._check_layout(other)
                    continue
                detected_shifts.append(shift)
            assert detected_shifts, name


def run_without(hidden: str, code: str) -> subprocess.CompletedProcess[str]:
    imports = "from klute_sim.plant import callbacks, models\nfrom klute_sim.device.device import load_device"
    script = f"import sys\n{hidden}\n{imports}\n{code}"
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)


NO_NUMBA = "sys.modules['numba'] = None"
OTHER_MUJOCO = (
    "from klute_sim.plant import struct_layout\n"
    "def get_layout(): raise struct_layout.UnknownLayoutError('MuJoCo 9 stores act at other offsets')\n"
    "struct_layout.get_layout = get_layout"
)


@pytest.mark.parametrize(
    ("hidden", "reason"),
    [
        (NO_NUMBA, "numba cannot be imported"),
        pytest.param(OTHER_MUJOCO, "MuJoCo 9 stores act at other offsets", marks=pytest.mark.slow),
    ],
)
def test_python_backend_replaces_an_impossible_compilation_with_one_warning(hidden: str, reason: str) -> None:
    code = "for _ in range(3):\n  with callbacks.device_callbacks() as backend: print(backend)"
    fallback = run_without(hidden, code)
    assert fallback.stdout.split() == ["python"] * 3
    assert fallback.stderr.count(reason) == 1
    process = run_without(hidden, "with callbacks.device_callbacks('compiled'): pass")
    assert "the compiled backend is not available: " in process.stderr
    assert reason in process.stderr
    rollout = (
        "import numpy as np; from klute_sim.device.rollout import simulate_rollouts\n"
        "device = load_device('klute-3-4').parameters\n"
        "print(simulate_rollouts(device, np.full(3, 0.18), np.full(3, 5e5), 1e-3).tension[-1] > 0)"
    )
    assert run_without(hidden, rollout).stdout.strip() == "True"


def test_unknown_backend_is_refused() -> None:
    with (
        pytest.raises(InputError, match="backend is 'fast'; allowed: auto, compiled, python"),
        callbacks.device_callbacks("fast"),
    ):
        pass


def test_mujoco_rollouts_and_derivatives_use_the_device() -> None:
    from mujoco import rollout

    model, data, _ = ankle()
    first = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, first, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    commands = np.linspace(0.0, 5.0, 200)[None, :, None] * np.ones((4, 1, 1))
    with callbacks.device_callbacks("compiled"):
        states, _ = rollout.rollout(
            model, [mujoco.MjData(model) for _ in range(2)], np.tile(first, (4, 1)), commands, chunk_size=1
        )
    for command in commands[0]:
        data.ctrl[:] = command
        with callbacks.device_callbacks("python"):
            callbacks.step_model(model, data)
    mujoco.mj_getState(model, data, first, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    assert all(np.array_equal(state, first) for state in states[:, -1])

    size = 2 * model.nv + model.na
    derivatives = []
    for backend in ("compiled", "python"):
        by_state, by_command = np.zeros((size, size)), np.zeros((size, model.nu))
        with callbacks.device_callbacks(backend):
            mujoco.mjd_transitionFD(model, data, 1e-6, True, by_state, by_command, None, None)
        derivatives.append((by_state, by_command))
    assert all(np.array_equal(a, b) for a, b in zip(*derivatives, strict=True))
    assert derivatives[0][1][2 * model.nv, 0] > 0.0  # more command, more pressure


@pytest.mark.parametrize("backend", ["compiled", "python"])
def test_isolated_context_excludes_callbacks_of_other_code(backend: str) -> None:
    calls: list[float] = []
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    mujoco.set_mjcb_control(lambda model, data: calls.append(data.time))
    try:
        with callbacks.device_callbacks(backend, is_isolated=True):
            mujoco.mj_forward(model, mujoco.MjData(model))
            assert calls == []
            with pytest.raises(KluteSimError, match="at the same time"), callbacks.device_callbacks(backend):
                pass
        mujoco.mj_forward(model, mujoco.MjData(model))
        assert calls == [0.0]
        with callbacks.device_callbacks(backend):
            with pytest.raises(KluteSimError), callbacks.device_callbacks(backend, is_isolated=True):
                pass
            mujoco.mj_forward(model, mujoco.MjData(model))
        assert calls == [0.0, 0.0]
    finally:
        mujoco.set_mjcb_control(None)


def test_compilation_waits_for_python_callbacks_of_another_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    entered, left = threading.Event(), threading.Event()

    def stay() -> None:
        with callbacks.device_callbacks("python"):
            entered.set()
            left.wait(timeout=60.0)

    thread = threading.Thread(target=stay)
    thread.start()
    entered.wait(timeout=60.0)
    with monkeypatch.context() as patch:
        patch.setattr(callbacks, "MAX_COMPILATION_WAIT", 0.01)
        with pytest.raises(KluteSimError, match="cannot compile a model while"):
            callbacks.compile_model(mujoco.MjSpec())
    threading.Timer(0.05, left.set).start()
    assert callbacks.compile_model(mujoco.MjSpec()).nq == 0
    assert mujoco.get_mjcb_act_dyn() is None
    thread.join()
