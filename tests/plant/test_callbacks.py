"""Two installations of one law: the same bits everywhere, in good company, and honest when one is impossible."""

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
from klute_sim.errors import InputError, KluteSimWarning, SimulationError
from klute_sim.gait.rig.setup import DRIVE_ACTUATORS, GaitOptions, GaitRig, build_gait_rig, reset_gait_rig
from klute_sim.plant import batch, callbacks, models, struct_layout
from klute_sim.plant.actuator import DeviceActuator

DEVICE = load_device("klute-1-1-4-pair")
BOTH = pytest.mark.parametrize("law", ["compiled", "python"])
STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its own warnings to a log file where it stands


def ankle() -> tuple[mujoco.MjModel, mujoco.MjData, DeviceActuator]:
    model = models.attach_devices(models.load_spec("ankle"), {"muscle_tendon": DEVICE.parameters})
    return model, mujoco.MjData(model), DeviceActuator(model, "muscle_tendon")


def walked(rig: GaitRig, law: str, steps: int) -> np.ndarray:
    """Every state of a walk with a pressure that jumps."""
    data, states = mujoco.MjData(rig.model), []
    reset_gait_rig(rig, data, 1e5)
    with callbacks.device_callbacks(law) as in_force:
        assert in_force == law
        for k in range(steps):
            data.ctrl[: len(DRIVE_ACTUATORS)] = rig.command_rates[k % rig.commands_per_stride]
            data.ctrl[rig.actuator.ctrl_address] = (k // 300) % 6
            callbacks.step_model(rig.model, data)
            states.append(np.concatenate([data.qpos, data.qvel, data.act, data.sensordata]))
    return np.array(states)


def test_ten_thousand_gait_steps_are_the_same_alone_in_threads_and_in_a_batch() -> None:
    rig, steps = build_gait_rig(DEVICE, GaitOptions(), 5e-4), 10_000
    reference = walked(rig, "python", steps)
    assert np.isfinite(reference).all()
    assert np.array_equal(walked(rig, "compiled", steps), reference)

    found: list[np.ndarray] = []
    threads = [threading.Thread(target=lambda: found.append(walked(rig, "compiled", steps))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 2
    assert all(np.array_equal(each, reference) for each in found)

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


def test_a_batch_carries_different_devices_as_models_of_their_own_would() -> None:
    strong, light = DEVICE.parameters, load_device("klute-3-4-pair").parameters
    model, *_ = ankle()
    simulations = batch.create_batch(model, 2, n_threads=2)
    batch.set_parameters(simulations, "muscle_tendon", [strong, light])
    simulations.bind("ctrl")[:] = 3.0
    batch.step_batch(simulations, n_steps=200)
    for i, parameters in enumerate((strong, light)):
        own = models.attach_devices(models.load_spec("ankle"), {"muscle_tendon": parameters})
        data = mujoco.MjData(own)
        data.ctrl[:] = 3.0
        with callbacks.device_callbacks():
            callbacks.step_model(own, data, 200)
        assert np.array_equal(data.act, simulations.bind("act")[i])
    assert not np.array_equal(*simulations.bind("act"))


def test_what_a_batch_cannot_do_is_refused() -> None:
    model, *_ = ankle()
    simulations = batch.create_batch(model, 2)
    with pytest.raises(InputError, match="1 devices for 2 simulations"):
        batch.set_parameters(simulations, "muscle_tendon", [DEVICE.parameters])
    with pytest.raises(InputError, match="without a tendon"):
        batch.set_parameters(simulations, "muscle_tendon", [load_device("klute-3-4").parameters] * 2)
    mujoco.set_mjcb_act_bias(lambda m, d, i: 0.0)
    try:
        with pytest.warns(KluteSimWarning), pytest.raises(InputError, match="Python callbacks"):
            batch.step_batch(simulations)
    finally:
        mujoco.set_mjcb_act_bias(None)


def test_models_compile_while_the_compiled_law_is_in() -> None:
    with callbacks.device_callbacks("compiled"):
        model, data, actuator = ankle()
        data.ctrl[:] = 4.0
        callbacks.step_model(model, data, 300)
    assert actuator.tension(data) > 500.0


@BOTH
def test_a_law_in_the_process_changes_no_other_model(law: str) -> None:
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
    with callbacks.device_callbacks(law):
        assert run() == alone


@BOTH
def test_a_model_travels_with_its_device(law: str) -> None:
    model, data, actuator = ankle()
    data.ctrl[:] = 4.0
    copies = [pickle.loads(pickle.dumps((model, data, actuator))) for _ in range(2)]
    with callbacks.device_callbacks(law):
        for each, state, device in [(model, data, actuator), *copies]:
            callbacks.step_model(each, state, 300)
            assert device.tension(state) == actuator.tension(data) > 500.0


def _tension_elsewhere(law: str) -> float:
    model, data, actuator = ankle()
    data.ctrl[:] = 4.0
    with callbacks.device_callbacks(law):
        callbacks.step_model(model, data, 300)
    return actuator.tension(data)


@BOTH
@pytest.mark.skipif(not hasattr(multiprocessing, "get_context") or sys.platform == "win32", reason="needs fork")
def test_a_forked_child_has_the_law_even_if_another_thread_was_inside(law: str) -> None:
    wanted = _tension_elsewhere(law)
    inside, leave = threading.Event(), threading.Event()

    def stay() -> None:
        with callbacks.device_callbacks(law):
            inside.set()
            leave.wait()

    thread = threading.Thread(target=stay)
    thread.start()
    inside.wait()
    try:
        with multiprocessing.get_context("fork").Pool(1) as pool:
            assert pool.apply(_slots) == (None, None)
            assert pool.apply(_tension_elsewhere, (law,)) == wanted
    finally:
        leave.set()
        thread.join()


def _step_on(model: mujoco.MjModel, data: mujoco.MjData, actuator: DeviceActuator) -> float:
    callbacks.step_model(model, data, 100)
    with callbacks.device_callbacks():
        callbacks.step_model(model, data, 100)
    callbacks.step_model(model, data, 100)
    return actuator.tension(data)


@pytest.mark.skipif(sys.platform == "win32", reason="needs fork")
def test_a_thread_that_forks_stays_inside_in_the_child() -> None:
    made = ankle()
    made[1].ctrl[:] = 4.0
    with callbacks.device_callbacks("compiled"):
        with multiprocessing.get_context("fork").Pool(1) as pool:
            there = pool.apply(_step_on, made)
        assert there == _step_on(*made) > 500.0


def _slots() -> tuple[object, object]:
    return mujoco.get_mjcb_act_dyn(), mujoco.get_mjcb_act_bias()


def test_a_fresh_process_gives_the_same_bits() -> None:
    script = (
        "import mujoco; from klute_sim.device.device import load; from klute_sim.plant import models, router\n"
        "m = models.equip(models.spec('ankle'), {'muscle_tendon': load('klute-1-1-4-pair').parameters})\n"
        "d = mujoco.MjData(m); d.ctrl[:] = 4.0\n"
        "with router.installed('compiled'): router.step(m, d, 300)\n"
        "print(-d.actuator_force[0])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert float(done.stdout) == _tension_elsewhere("python")


@BOTH
@pytest.mark.parametrize("what", ["command", "inf", "pressure"])
def test_a_state_that_is_not_finite_is_named_at_the_step(law: str, what: str) -> None:
    model, data, actuator = ankle()
    with callbacks.device_callbacks(law):
        callbacks.step_model(model, data, 10)
        before = data.qpos.copy()
        if what in ("command", "inf"):
            data.ctrl[:] = np.inf if what == "inf" else np.nan
        else:
            data.act[0] = np.nan
        with pytest.raises(SimulationError, match=r"actuator 'muscle_tendon' has no finite state at t = 0\.0050 s: .*"):
            callbacks.step_model(model, data)
        if law == "python":
            assert np.array_equal(data.qpos, before)  # not taken
        else:
            assert actuator.tension(data) == 0.0
        for _ in range(3):
            with pytest.raises(SimulationError):
                callbacks.step_model(model, data)
        assert np.isfinite(data.qpos).all()
        assert np.isfinite(data.qvel).all()
        # mended, it goes on
        data.ctrl[:], data.act[:] = 1.0, [0.5, -0.001]
        callbacks.step_model(model, data, 10)
    assert np.isfinite(data.act).all()


def test_who_steps_with_mujoco_itself_is_told_on_the_way_out() -> None:
    model, data, _ = ankle()
    data.ctrl[:] = np.nan
    told = r"'muscle_tendon'.*pressure command nan bar"
    with pytest.raises(SimulationError, match=told), callbacks.device_callbacks("compiled"):
        mujoco.mj_step(model, data, 5)
    with callbacks.device_callbacks("compiled"):  # told once
        pass


def test_a_fault_is_told_to_the_one_who_stepped_it() -> None:
    model, data, _ = ankle()
    healthy = mujoco.MjData(model)
    data.ctrl[:] = np.nan
    with callbacks.device_callbacks("compiled"):
        mujoco.mj_step(model, data)
        callbacks.step_model(model, healthy)
        with pytest.raises(SimulationError):
            callbacks.step_model(model, data)


def test_a_fault_in_another_thread_is_told_there() -> None:
    model, data, _ = ankle()
    data.ctrl[:] = np.nan
    told: list[str] = []

    def fail() -> None:
        try:
            with callbacks.device_callbacks("compiled"):
                mujoco.mj_step(model, data)
        except SimulationError as error:
            told.append(str(error))

    with callbacks.device_callbacks("compiled"):
        thread = threading.Thread(target=fail)
        thread.start()
        thread.join()
        callbacks.step_model(model, mujoco.MjData(model))
    assert len(told) == 1
    assert "'muscle_tendon' has no finite state" in told[0]


def test_a_step_outside_gives_no_force_and_no_error() -> None:
    model, data, actuator = ankle()
    data.ctrl[:] = np.nan
    callbacks.step_model(model, data)
    assert actuator.tension(data) == 0.0


def test_an_error_of_ones_own_is_not_hidden() -> None:
    model, data, _ = ankle()
    data.ctrl[:] = np.nan

    def step_and_fail() -> None:
        with callbacks.device_callbacks("compiled"):
            mujoco.mj_step(model, data)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        step_and_fail()
    with callbacks.device_callbacks("compiled"):  # and what happened in there is not told to somebody else
        pass


def test_the_loader_refuses_a_model_without_its_device() -> None:
    with pytest.raises(InputError, match="'muscle_tendon' is made for a device and has none"):
        models.attach_devices(models.load_spec("ankle"), {})
    with pytest.raises(InputError, match="no actuator 'achilles'; it has: muscle_tendon"):
        models.attach_devices(models.load_spec("ankle"), {"achilles": DEVICE.parameters})
    with pytest.raises(InputError, match="'muscle_tendon' carries no device"):
        DeviceActuator(models.load_spec("ankle").compile(), "muscle_tendon")


def test_offsets_that_do_not_hold_are_found_out() -> None:
    right = struct_layout.get_layout()
    struct_layout._check_layout(right)
    for part in ("model", "data"):
        for name in getattr(right, part):
            other = struct_layout.StructLayout(dict(right.model), dict(right.data))
            found_out = []
            for shift in (8, -8):  # an empty array begins where its neighbour does, so one side may look right
                getattr(other, part)[name] = getattr(right, part)[name] + shift
                with suppress(struct_layout.UnknownLayoutError):
                    struct_layout._check_layout(other)
                    continue
                found_out.append(shift)
            assert found_out, name


def run_without(hidden: str, code: str) -> subprocess.CompletedProcess[str]:
    imports = "from klute_sim.plant import models, router\nfrom klute_sim.device.device import load"
    script = f"import sys\n{hidden}\n{imports}\n{code}"
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)


NO_NUMBA = "sys.modules['numba'] = None"
OTHER_MUJOCO = (
    "from klute_sim.plant import layout\n"
    "def layout_(): raise layout.UnknownLayoutError('MuJoCo 9 keeps act elsewhere than it says')\n"
    "layout.layout = layout_"
)


@pytest.mark.parametrize(
    ("hidden", "reason"), [(NO_NUMBA, "numba cannot be imported"), (OTHER_MUJOCO, "MuJoCo 9 keeps act elsewhere")]
)
def test_where_it_cannot_be_compiled_python_runs_and_says_so_once(hidden: str, reason: str) -> None:
    code = "for _ in range(3):\n  with router.installed() as law: print(law)"
    done = run_without(hidden, code)
    assert done.stdout.split() == ["python"] * 3
    assert done.stderr.count(reason) == 1
    asked = run_without(hidden, "with router.installed('compiled'): pass")
    assert "there is no compiled law: " in asked.stderr
    assert reason in asked.stderr
    rollout = (
        "import numpy as np; from klute_sim.device.rollout import rollout\n"
        "print(rollout(load('klute-3-4').parameters, np.full(3, 0.18), np.full(3, 5e5), 1e-3).tension[-1] > 0)"
    )
    assert run_without(hidden, rollout).stdout.strip() == "True"


def test_a_law_nobody_knows_is_refused() -> None:
    with (
        pytest.raises(InputError, match="law is 'fast'; allowed: auto, compiled, python"),
        callbacks.device_callbacks("fast"),
    ):
        pass


def test_mujocos_own_rollouts_and_derivatives_see_the_law() -> None:
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
    assert all(np.array_equal(each, first) for each in states[:, -1])

    size = 2 * model.nv + model.na
    found = []
    for law in ("compiled", "python"):
        by_state, by_command = np.zeros((size, size)), np.zeros((size, model.nu))
        with callbacks.device_callbacks(law):
            mujoco.mjd_transitionFD(model, data, 1e-6, True, by_state, by_command, None, None)
        found.append((by_state, by_command))
    assert all(np.array_equal(a, b) for a, b in zip(*found, strict=True))
    assert found[0][1][2 * model.nv, 0] > 0.0  # more command, more pressure
