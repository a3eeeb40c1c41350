"""Models of users as files: names that are no file names, and meshes and pictures beside the model."""

import struct
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest

import klute_sim as ks
from klute_sim.api.joint_plan import plan_joint_measurements
from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.mechanism_channels import name_files
from klute_sim.errors import InputError
from klute_sim.plant.mjcf.model_export import build_model_files, collect_model_files, write_files
from klute_sim.plant.mjcf.model_file import load_model_file
from klute_sim.plant.models import get_models_folder

PAIR = ks.load_device("klute-3-4-pair")
STIFFER = PAIR.with_changes({"tendon.stiffness_1_n_per_mm": 80.0})


def write_mesh(file: Path) -> None:
    """Write a tetrahedron."""
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], dtype=np.float32)
    faces = [corners[list(index)].tobytes() for index in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(bytes(80) + struct.pack("<I", 4) + b"".join(bytes(12) + face + bytes(2) for face in faces))


def write_model(folder: Path, flexor: str = "flexor", extensor: str = "extensor", *, has_mesh: bool = False) -> Path:
    """Write the shipped joint with other names of tendons, and with a mesh that an included file declares."""
    text = (get_models_folder() / "antagonist_joint.xml").read_text("utf-8")
    text = text.replace('name="flexor"', f'name="{flexor}"').replace('name="extensor"', f'name="{extensor}"')
    if has_mesh:
        write_mesh(folder / "parts" / "a" / "part.stl")
        (folder / "parts.xml").write_text('<mujocoinclude><asset><mesh file="a/part.stl"/></asset></mujocoinclude>')
        text = text.replace("<worldbody>", '<include file="parts.xml"/><compiler meshdir="parts"/><worldbody>', 1)
        text = text.replace("</worldbody>", '<geom type="mesh" mesh="part" contype="0" conaffinity="0"/></worldbody>')
    (folder / "joint.xml").write_text(text)
    return folder / "joint.xml"


@pytest.mark.parametrize("names", [("long head", "lateral head"), ("arm/flexor", "arm/extensor")])
def test_plan_of_tendons_with_any_name_is_a_dataset(names: tuple[str, str], tmp_path: Path) -> None:
    devices = dict(zip(names, (PAIR, STIFFER), strict=True))
    model = write_model(tmp_path, *names)
    plan = plan_joint_measurements(devices, model=model, only=["quick-release"], load=-2.0, simulate=True)
    folder = plan.save(tmp_path / "plan")
    content = tomllib.loads((folder / "dataset.toml").read_text("utf-8"))
    assert content["devices"].keys() == set(names)
    dataset = load_dataset(folder)
    assert dataset.mechanism is not None
    assert {name: device.digest for name, device in dataset.mechanism.devices.items()} == {
        name: device.digest for name, device in devices.items()
    }
    assert f"{names[0]}/tendon.slack_length_mm" in dataset.uncertainties


def test_files_of_objects_have_different_names() -> None:
    names = name_files(["arm/flexor", "arm flexor", "Arm_Flexor", "x"])
    assert list(names.values()) == ["arm_flexor", "arm_flexor_2", "arm_flexor_3", "x"]


def test_exported_files_of_any_tendon_are_written(tmp_path: Path) -> None:
    model = write_model(tmp_path, "arm/flexor", "arm/extensor")
    folder = ks.export_mjcf({"arm/flexor": PAIR}, tmp_path / "out", model=model)
    assert ks.load_device(folder / "arm_flexor.toml").digest == PAIR.digest


def test_written_models_have_their_meshes(tmp_path: Path) -> None:
    model = write_model(tmp_path, has_mesh=True)
    exported = ks.export_mjcf(PAIR, tmp_path / "out", model=model)
    mesh = exported / "assets" / "parts" / "a" / "part.stl"
    assert mesh.read_bytes() == (tmp_path / "parts" / "a" / "part.stl").read_bytes()
    assert mujoco.MjModel.from_xml_path(str(exported / "model.xml")).nmesh == 1
    planned = plan_joint_measurements(PAIR, model=model, only=["sines"]).save(tmp_path / "plan")
    assert load_model_file(planned / "model.xml").make_spec().compile().nmesh == 1


def test_written_model_of_a_written_model_is_the_same(tmp_path: Path) -> None:
    file = load_model_file(write_model(tmp_path, has_mesh=True))
    first = build_model_files(file, file.make_spec())
    (tmp_path / "again").mkdir()
    write_files(first, tmp_path / "again")
    again = load_model_file(tmp_path / "again" / "model.xml")
    assert build_model_files(again, again.make_spec())["model.xml"].count(b"part.stl") == 1


def test_missing_mesh_is_one_sentence(tmp_path: Path) -> None:
    file = load_model_file(write_model(tmp_path, has_mesh=True))
    spec = file.make_spec()
    spec.compile()
    content = spec.to_xml()
    (tmp_path / "parts" / "a" / "part.stl").unlink()
    with pytest.raises(InputError, match="cannot be read"):
        collect_model_files(file, content)
