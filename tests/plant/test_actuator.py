"""The device in MuJoCo: it gives the device's force, does not affect other actuators, and is 0 without callbacks."""

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


def test_mujoco_steps_equal_device_steps() -> None:
    model, data, actuator = bench()
    state = unit.DeviceState(0.0, PAIR.parameters.muscle.resting_length)
    with callbacks.device_callbacks():
        for k in range(1500):
            length = float(0.335 + 0.015 * np.sin(2 * np.pi * 3 * k * STEP))
            command = 4e5 if k > 200 else 1e5
            data.qpos[0], data.qvel[0] = length, 0.0
            actuator.set_command(data, command)
            mujoco.mj_step(model, data)
            state = unit.advance_state(PAIR.parameters, state, length, command, STEP)
            expected = unit.compute_tension(PAIR.parameters, state, length, 0.0)
            assert actuator.get_tension(data) == pytest.approx(expected, rel=1e-12, abs=1e-9)
            assert actuator.get_state(data)[:2] == pytest.approx(state[:2], rel=1e-12)
    assert expected > 100.0


@pytest.mark.parametrize("name", ["ankle", "bench", "gait_rig"])
def test_models_without_device_give_no_tendon_force(name: str) -> None:
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


def test_models_load_from_their_files() -> None:
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


OTHER_MODEL = """
<mujoco><worldbody><body><joint name="j" type="slide"/><geom size=".1" mass="1"/></body></worldbody>
<actuator>
  <general name="a" joint="j" dyntype="user" actdim="1" gaintype="fixed" gainprm="0" biastype="user"/>
</actuator>
</mujoco>"""


def test_other_callbacks_are_called_and_restored() -> None:
    model, data, actuator = bench()
    other_model = mujoco.MjModel.from_xml_string(OTHER_MODEL)
    other_data = mujoco.MjData(other_model)
    bias = lambda m, d, i: 7.0  # noqa: E731
    rate = lambda m, d, i: 3.0  # noqa: E731
    mujoco.set_mjcb_act_bias(bias)
    mujoco.set_mjcb_act_dyn(rate)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            with callbacks.device_callbacks() as backend:
                mujoco.mj_step(other_model, other_data)
                data.qpos[0] = 0.36
                mujoco.mj_step(model, data)
        assert backend == "python"
        assert ["so that they are called" in str(warning.message) for warning in caught] == [True]
        assert other_data.actuator_force[0] == 7.0
        assert other_data.act[0] == pytest.approx(3.0 * other_model.opt.timestep)
        assert actuator.get_tension(data) > 0.0
        assert mujoco.get_mjcb_act_bias() is bias
        assert mujoco.get_mjcb_act_dyn() is rate
    finally:
        mujoco.set_mjcb_act_bias(None)
        mujoco.set_mjcb_act_dyn(None)


def test_other_c_callbacks_get_their_pointers() -> None:
    seen: list[tuple[int, int, int]] = []

    def callback(model: int, data: int, actuator: int) -> float:
        seen.append((model, data, actuator))
        return 7.0

    c_callback = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)(callback)
    other_model = mujoco.MjModel.from_xml_string(OTHER_MODEL)
    other_data = mujoco.MjData(other_model)
    mujoco.set_mjcb_act_bias(c_callback)
    try:
        mujoco.mj_step(other_model, other_data)
        with pytest.warns(KluteSimWarning, match="called too"), callbacks.device_callbacks():
            mujoco.mj_step(other_model, other_data)
    finally:
        mujoco.set_mjcb_act_bias(None)
    assert other_data.actuator_force[0] == 7.0
    assert seen == [(other_model._address, other_data._address, 0)] * 2


def test_other_actuators_without_callbacks_stay_neutral() -> None:
    other_model = mujoco.MjModel.from_xml_string(OTHER_MODEL)
    other_data = mujoco.MjData(other_model)
    with callbacks.device_callbacks():
        mujoco.mj_step(other_model, other_data)
    assert other_data.actuator_force[0] == 0.0
    assert other_data.act[0] == 0.0
    assert mujoco.get_mjcb_act_bias() is None


def test_callback_installed_inside_keeps_the_slot() -> None:
    other_callback = lambda m, d, i: 1.0  # noqa: E731
    try:
        with pytest.warns(KluteSimWarning, match="has given no force since"), callbacks.device_callbacks():
            mujoco.set_mjcb_act_bias(other_callback)
            with pytest.raises(KluteSimError, match="so the device gives no force"), callbacks.device_callbacks():
                pass
        assert mujoco.get_mjcb_act_bias() is other_callback
        assert mujoco.get_mjcb_act_dyn() is None
    finally:
        mujoco.set_mjcb_act_bias(None)


def test_wrapped_callback_is_called_once() -> None:
    other_model = mujoco.MjModel.from_xml_string(OTHER_MODEL)
    other_data = mujoco.MjData(other_model)
    try:
        with pytest.warns(KluteSimWarning), callbacks.device_callbacks():
            device_callback = mujoco.get_mjcb_act_bias()
            mujoco.set_mjcb_act_bias(lambda m, d, i: 5.0 + device_callback(m, d, i))
        with pytest.warns(KluteSimWarning), callbacks.device_callbacks():
            mujoco.mj_step(other_model, other_data)
        assert other_data.actuator_force[0] == 5.0
    finally:
        mujoco.set_mjcb_act_bias(None)


def test_slots_are_free_after_nesting_and_exceptions() -> None:
    with callbacks.device_callbacks(), callbacks.device_callbacks():
        assert mujoco.get_mjcb_act_bias() is not None
    assert mujoco.get_mjcb_act_bias() is None
    with pytest.raises(ZeroDivisionError), callbacks.device_callbacks():
        raise ZeroDivisionError
    assert mujoco.get_mjcb_act_dyn() is None


def test_models_in_several_threads_are_independent() -> None:
    def run(
        number: int, simulation: tuple[mujoco.MjModel, mujoco.MjData, DeviceActuator], results: dict[int, float]
    ) -> None:
        model, data, actuator = simulation
        with callbacks.device_callbacks():
            for _ in range(400):
                data.qpos[0] = 0.34 + 0.005 * number
                actuator.set_command(data, 1e5 * (number + 1))
                mujoco.mj_step(model, data)
        results[number] = actuator.get_tension(data)

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
def test_nan_raises_an_error_with_actuator_and_time(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its own warning to a log file where it stands
    model, data, actuator = bench()
    data.qpos[0] = 0.34 if where == "command" else np.nan
    actuator.set_command(data, np.nan if where == "command" else 1e5)
    with pytest.raises(SimulationError, match=r"muscle_tendon.*t = 0\.0000 s"), callbacks.device_callbacks():
        mujoco.mj_step(model, data)


def test_device_needs_a_compatible_actuator() -> None:
    with pytest.raises(InputError, match="'thigh' cannot carry a device"):
        models.attach_devices(models.load_spec("gait_rig"), {"thigh": PAIR.parameters})


def test_reset_gives_rest_and_a_saved_state_replays_bitwise() -> None:
    model, data, actuator = bench()
    assert actuator.get_state(data) == unit.DeviceState(0.0, PAIR.parameters.muscle.resting_length)
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
