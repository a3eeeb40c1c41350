"""MJCF files with devices inside: without force in MuJoCo alone, with the force of the device in this package."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

import klute_sim as ks
from klute_sim.errors import InputError
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.mechanism.mounting import mount_devices
from klute_sim.mechanism.simulate import simulate_mechanism
from klute_sim.plant.actuator import DeviceActuator
from klute_sim.plant.callbacks import device_callbacks, step_model
from klute_sim.plant.mjcf.model_file import MODEL_NAMES, load_model_file
from tests import command_line as command

PAIR = ks.load_device("klute-3-4-pair")


@pytest.mark.parametrize("name", MODEL_NAMES)
def test_exported_model_has_no_force_without_the_package(name: str, tmp_path: Path) -> None:
    folder = ks.export_mjcf(PAIR, tmp_path / "out", model=name)
    model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    data = mujoco.MjData(model)
    data.ctrl[:] = 4.0
    mujoco.mj_step(model, data, 50)
    assert not data.actuator_force.any()
    assert np.isfinite(data.qpos).all()


def test_exported_device_has_all_its_digits(tmp_path: Path) -> None:
    device = PAIR.with_effect("braid_hysteresis", slope_n_per_bar=8.123456789, stiffness_n_per_mm=40.0)
    folder = ks.export_mjcf({"flexor": device, "extensor": PAIR}, tmp_path / "out", model="antagonist_joint")
    model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    assert tuple(DeviceActuator(model, "flexor").parameters.effects) == tuple(device.parameters.effects)
    assert DeviceActuator(model, "extensor").parameters.muscle == PAIR.parameters.muscle
    assert PAIR.digest in (folder / "model.xml").read_text()
    assert ks.load_device(folder / "flexor.toml").digest == device.digest


def test_device_on_one_tendon_leaves_the_muscles_of_a_body_alone(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "mechanisms.md").read_text("utf-8")
    (text,) = re.findall(r'write_text\("""(<mujoco model="arm">.*?)"""\)', page, re.DOTALL)
    (tmp_path / "arm.xml").write_text(text)
    folder = ks.export_mjcf({"assist": PAIR}, tmp_path / "out", model=tmp_path / "arm.xml")
    own = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    for name in ("biceps", "triceps"):
        assert model.actuator(name).gainprm == pytest.approx(own.actuator(name).gainprm)
        assert model.actuator(name).dyntype == own.actuator(name).dyntype
    angles, tensions = [], []
    for pressure in (0.0, 2e5):
        data = mujoco.MjData(model)
        data.actuator("biceps").ctrl = 0.03
        with device_callbacks():
            DeviceActuator(model, "assist").set_command(data, pressure)
            step_model(model, data, 600)
        angles.append(float(data.joint("elbow").qpos[0]))
        tensions.append(DeviceActuator(model, "assist").get_tension(data))
    assert angles[1] > angles[0] + 0.1  # the device flexes the elbow further
    assert tensions[1] > tensions[0] + 5.0
    with pytest.raises(InputError, match="there is no tendon 'asist'; did you mean 'assist'"):
        ks.export_mjcf({"asist": PAIR}, tmp_path / "other", model=tmp_path / "arm.xml")


def test_exported_model_moves_like_the_mechanism(tmp_path: Path) -> None:
    folder = ks.export_mjcf(PAIR, tmp_path / "out", model="antagonist_joint")
    file = load_model_file("antagonist_joint")
    devices = {"flexor": PAIR, "extensor": PAIR}
    inputs = {"pressure_command_flexor": np.full(400, 3e5), "pressure_command_extensor": np.full(400, 1e5)}
    mechanism = Mechanism(file, tuple(devices), tuple(inputs))
    parameters = {name: device.parameters for name, device in devices.items()}
    rollout = simulate_mechanism(mechanism, parameters, inputs, 5e-4, numbers=mount_devices(file, devices))
    model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    data = mujoco.MjData(model)
    data.qpos[:], data.act[:] = rollout.initial_qpos, rollout.initial_act
    with device_callbacks():
        data.ctrl[:] = [3.0, 1.0]
        step_model(model, data, 400)
    assert data.qpos == pytest.approx(rollout.fields["qpos"][-1], abs=2e-4)  # MuJoCo writes six digits of positions


def test_command_exports_a_device(tmp_path: Path) -> None:
    done = command.run("export", "klute-3-4", "--format", "mjcf", "--out", "model", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in (tmp_path / "model").iterdir()} >= {"model.xml", "muscle.toml"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("klute-3-4", "--format", "mjcf", "--format", "csv"), "give it alone"),
        (("klute-3-4", "--model", "knee_jig"), "belongs to --format mjcf"),
        (("klute-3-5", "--format", "mjcf"), "no device 'klute-3-5'"),
        (("klute-3-4", "--format", "mjcf", "--model", "knee"), "no model 'knee'"),
    ],
)
def test_mistakes_end_in_one_sentence(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    done = command.run("export", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr


def test_model_without_tendons_is_refused(tmp_path: Path) -> None:
    (tmp_path / "box.xml").write_text("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    with pytest.raises(InputError, match="has no tendon with a name"):
        ks.export_mjcf(PAIR, tmp_path / "out", model=tmp_path / "box.xml")
