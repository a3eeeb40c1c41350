"""The device in MuJoCo: delivers what the law says, leaves everybody else alone, and is zero without us."""

import ctypes
import threading
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest

from klute_sim.device import dynamics as unit
from klute_sim.device.device import load_device
from klute_sim.device.dynamics import DeviceState
from klute_sim.errors import InputError, KluteSimError, KluteSimWarning, SimulationError
from klute_sim.plant import callbacks, models
from klute_sim.plant.actuator import DeviceActuator

PAIR = load_device("klute-3-4-pair")
STEP = 5e-4


def bench() -> tuple[mujoco.MjModel, mujoco.MjData, DeviceActuator]:
    spec = models.load_spec("bench")
    spec.option.timestep = STEP
    model = models.attach_devices(spec, {"muscle_tendon": PAIR.parameters})
    return model, mujoco.MjData(model), DeviceActuator(model, "muscle_tendon")


def test_mujoco_steps_are_the_devices_own_steps() -> None:
    model, data, actuator = bench()
    state = unit.compute_rest_state(PAIR.parameters)
    with callbacks.device_callbacks():
        for k in range(1500):
            length = float(0.335 + 0.015 * np.sin(2 * np.pi * 3 * k * STEP))
            command = 4e5 if k > 200 else 1e5
            data.qpos[0], data.qvel[0] = length, 0.0
            actuator.set_command(data, command)
            mujoco.mj_step(model, data)
            state = unit.advance_state(PAIR.parameters, state, length, command, STEP)
            wanted = unit.compute_tension(PAIR.parameters, state, length, 0.0)
            assert actuator.tension(data) == pytest.approx(wanted, rel=1e-12, abs=1e-9)
            assert actuator.get_state(data)[:2] == pytest.approx(state[:2], rel=1e-12)
    assert wanted > 100.0


@pytest.mark.parametrize("name", ["ankle", "bench", "gait_rig"])
def test_in_bare_mujoco_every_model_gives_no_tendon_force(name: str) -> None:
    model = models.load_spec(name).compile()
    data = mujoco.MjData(model)
    if name == "bench":
        data.qpos[0] = 0.36
    actuator = [i for i in range(model.nactuator) if model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_USER]
    assert len(actuator) == 1
    data.act[-2:] = [5.0, -0.01]
    data.ctrl[actuator[0]] = 5.0
    for _ in range(10):
        mujoco.mj_step(model, data)
        assert data.actuator_force[actuator[0]] == 0.0


def test_the_models_load_from_their_files() -> None:
    for name in ("ankle", "bench", "gait_rig"):
        assert mujoco.MjModel.from_xml_path(str(models.get_models_folder() / f"{name}.xml")).nu >= 1


def test_moment_arm_is_48_mm_at_neutral_and_masses_are_plausible() -> None:
    model = models.load_spec("ankle").compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ankle, d = model.joint("ankle").qposadr[0], 1e-6
    lengths = []
    for angle in (-d, d):
        data.qpos[ankle] = angle
        mujoco.mj_forward(model, data)
        lengths.append(float(data.ten_length[0]))
    assert -(lengths[1] - lengths[0]) / (2 * d) == pytest.approx(0.048, abs=1e-5)
    assert 1.3 <= model.body_mass.sum() <= 2.0


FOREIGN = """
<mujoco><worldbody><body><joint name="j" type="slide"/><geom size=".1" mass="1"/></body></worldbody>
<actuator>
  <general name="a" joint="j" dyntype="user" actdim="1" gaintype="fixed" gainprm="0" biastype="user"/>
</actuator>
</mujoco>"""


def test_foreign_actuators_get_their_own_law_and_the_slots_are_put_back() -> None:
    model, data, actuator = bench()
    foreign = mujoco.MjModel.from_xml_string(FOREIGN)
    theirs = mujoco.MjData(foreign)
    bias = lambda m, d, i: 7.0  # noqa: E731
    rate = lambda m, d, i: 3.0  # noqa: E731
    mujoco.set_mjcb_act_bias(bias)
    mujoco.set_mjcb_act_dyn(rate)
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            with callbacks.device_callbacks() as law:
                mujoco.mj_step(foreign, theirs)
                data.qpos[0] = 0.36
                mujoco.mj_step(model, data)
        assert law == "python"
        assert ["so that they are asked" in str(each.message) for each in said] == [True]
        assert theirs.actuator_force[0] == 7.0
        assert theirs.act[0] == pytest.approx(3.0 * foreign.opt.timestep)
        assert actuator.tension(data) > 0.0
        assert mujoco.get_mjcb_act_bias() is bias
        assert mujoco.get_mjcb_act_dyn() is rate
    finally:
        mujoco.set_mjcb_act_bias(None)
        mujoco.set_mjcb_act_dyn(None)


def test_foreign_c_functions_are_asked_with_their_own_pointers() -> None:
    seen: list[tuple[int, int, int]] = []

    def told(model: int, data: int, actuator: int) -> float:
        seen.append((model, data, actuator))
        return 7.0

    plain = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)(told)
    foreign = mujoco.MjModel.from_xml_string(FOREIGN)
    theirs = mujoco.MjData(foreign)
    mujoco.set_mjcb_act_bias(plain)
    try:
        mujoco.mj_step(foreign, theirs)
        with pytest.warns(KluteSimWarning, match="asked, too"), callbacks.device_callbacks():
            mujoco.mj_step(foreign, theirs)
    finally:
        mujoco.set_mjcb_act_bias(None)
    assert theirs.actuator_force[0] == 7.0
    assert seen == [(foreign._address, theirs._address, 0)] * 2


def test_foreign_actuators_without_a_law_stay_neutral() -> None:
    foreign = mujoco.MjModel.from_xml_string(FOREIGN)
    theirs = mujoco.MjData(foreign)
    with callbacks.device_callbacks():
        mujoco.mj_step(foreign, theirs)
    assert theirs.actuator_force[0] == 0.0
    assert theirs.act[0] == 0.0
    assert mujoco.get_mjcb_act_bias() is None


def test_who_installs_while_we_are_in_keeps_the_slot() -> None:
    late = lambda m, d, i: 1.0  # noqa: E731
    try:
        with pytest.warns(KluteSimWarning, match="it had no force since"), callbacks.device_callbacks():
            mujoco.set_mjcb_act_bias(late)
            with pytest.raises(KluteSimError, match="over the device's"), callbacks.device_callbacks():
                pass
        assert mujoco.get_mjcb_act_bias() is late
        assert mujoco.get_mjcb_act_dyn() is None
    finally:
        mujoco.set_mjcb_act_bias(None)


def test_who_wraps_our_callback_and_stays_is_asked_once() -> None:
    foreign = mujoco.MjModel.from_xml_string(FOREIGN)
    theirs = mujoco.MjData(foreign)
    try:
        with pytest.warns(KluteSimWarning), callbacks.device_callbacks():
            ours = mujoco.get_mjcb_act_bias()
            mujoco.set_mjcb_act_bias(lambda m, d, i: 5.0 + ours(m, d, i))
        with pytest.warns(KluteSimWarning), callbacks.device_callbacks():
            mujoco.mj_step(foreign, theirs)
        assert theirs.actuator_force[0] == 5.0
    finally:
        mujoco.set_mjcb_act_bias(None)


def test_nested_and_after_an_exception_the_slots_are_free() -> None:
    with callbacks.device_callbacks(), callbacks.device_callbacks():
        assert mujoco.get_mjcb_act_bias() is not None
    assert mujoco.get_mjcb_act_bias() is None
    with pytest.raises(ZeroDivisionError), callbacks.device_callbacks():
        raise ZeroDivisionError
    assert mujoco.get_mjcb_act_dyn() is None


def test_models_in_several_threads_do_not_mix() -> None:
    def run(number: int, made: tuple[mujoco.MjModel, mujoco.MjData, DeviceActuator], into: dict[int, float]) -> None:
        model, data, actuator = made
        with callbacks.device_callbacks():
            for _ in range(400):
                data.qpos[0] = 0.34 + 0.005 * number
                actuator.set_command(data, 1e5 * (number + 1))
                mujoco.mj_step(model, data)
        into[number] = actuator.tension(data)

    alone: dict[int, float] = {}
    together: dict[int, float] = {}
    for number in range(3):
        run(number, bench(), alone)
    # Models are compiled before: MuJoCo cannot compile while a Python callback is installed.
    threads = [threading.Thread(target=run, args=(number, bench(), together)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert together == alone
    assert len(set(alone.values())) == 3


@pytest.mark.parametrize("where", ["command", "length"])
def test_not_a_number_is_an_error_that_names_actuator_and_time(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its own warning to a log file where it stands
    model, data, actuator = bench()
    data.qpos[0] = 0.34 if where == "command" else np.nan
    actuator.set_command(data, np.nan if where == "command" else 1e5)
    with pytest.raises(SimulationError, match=r"muscle_tendon.*t = 0\.0000 s"), callbacks.device_callbacks():
        mujoco.mj_step(model, data)


def test_only_an_actuator_made_for_a_device_takes_one() -> None:
    with pytest.raises(InputError, match="'thigh' cannot carry a device"):
        models.attach_devices(models.load_spec("gait_rig"), {"thigh": PAIR.parameters})


def test_reset_is_the_device_at_rest_and_a_saved_state_replays_bitwise() -> None:
    model, data, actuator = bench()
    assert actuator.get_state(data) == unit.compute_rest_state(PAIR.parameters)
    actuator.set_state(data, DeviceState(2e5, 0.24))
    assert actuator.get_state(data)[:2] == pytest.approx((2e5, 0.24), rel=1e-15)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION)
    saved = np.empty(size)
    data.qpos[0] = 0.34
    actuator.set_command(data, 3e5)
    mujoco.mj_getState(model, data, saved, mujoco.mjtState.mjSTATE_INTEGRATION)
    ends = []
    with callbacks.device_callbacks():
        for _ in range(2):
            mujoco.mj_setState(model, data, saved, mujoco.mjtState.mjSTATE_INTEGRATION)
            for _ in range(50):
                mujoco.mj_step(model, data)
            ends.append(data.act.copy())
    assert (ends[0] == ends[1]).all()
