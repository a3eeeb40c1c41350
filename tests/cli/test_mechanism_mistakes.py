"""Mistakes in a dataset or model of a mechanism end in one sentence on the command line."""

from pathlib import Path

import pytest

from klute_sim.device.device import load_device, parse_device
from klute_sim.errors import InputError
from klute_sim.plant.mjcf.model_file import load_model_file
from tests import command_line as command
from tests.diagnosis import synthetic_joint_dataset as joint


def diagnose(folder: Path) -> str:
    done = command.run("diagnose", str(folder), "--no-report", "--out", "found", cwd=folder.parent)
    assert done.returncode != 0
    assert done.stdout == ""
    (sentence,) = done.stderr.strip().splitlines()
    return sentence


def edit(folder: Path, old: str, new: str) -> None:
    path = folder / "dataset.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return joint.write_dataset(tmp_path / "data", groups=("fit_1",), repeats=1, seconds=1.5)


def test_model_that_diverges(folder: Path) -> None:
    edit(folder, "[numbers]\n", '[numbers]\n"model.joint.joint.stiffness" = -1e9\n')
    sentence = diagnose(folder)
    assert "antagonist_joint.xml diverges: actuator 'flexor' has no finite state at t = " in sentence
    assert "; use a shorter time step, and check the numbers, stops and contacts of the model" in sentence


def test_tendon_without_device(folder: Path) -> None:
    edit(folder, "[numbers]\n", "[devices.biceps]\n[numbers]\n")
    assert "[devices] names the tendon 'biceps'; the tendons are: flexor, extensor" in diagnose(folder)


def test_channel_bound_to_nothing(folder: Path) -> None:
    edit(folder, "'angle_joint'", "'angle_elbow'")
    table = folder / "fit_1_0.csv"
    table.write_text(table.read_text().replace("angle_joint", "angle_elbow"))
    assert "the channel 'angle_elbow' belongs to no hinge joint; there are: joint" in diagnose(folder)


def test_include_outside_the_folder(folder: Path) -> None:
    text = load_model_file("antagonist_joint").content.decode()
    (folder.parent / "other.xml").write_text("<mujocoinclude/>")
    (folder / "elbow.xml").write_text(text.replace("<worldbody>", '<include file="../other.xml"/><worldbody>'))
    edit(folder, 'model = "antagonist_joint"', 'model = "elbow.xml"')
    assert "refers to '../other.xml', which is outside its folder" in diagnose(folder)


def test_tendons_without_names(folder: Path) -> None:
    text = load_model_file("antagonist_joint").content.decode()
    for name in joint.TENDONS:
        text = text.replace(f'<spatial name="{name}"', "<spatial")
    (folder / "elbow.xml").write_text(text)
    edit(folder, 'model = "antagonist_joint"', 'model = "elbow.xml"')
    assert "has a name, so none can carry a device" in diagnose(folder)


def test_effect_of_a_mechanism_in_a_device_file() -> None:
    content = '[effects.joint_friction]\nform = "coulomb"\nmoment_n_m = 0.1\n'
    device = load_device("klute-3-4-pair").content.decode()
    with pytest.raises(InputError, match="'joint_friction' is an effect of a mechanism; allowed in a device file"):
        parse_device(f"{device}\n{content}".encode(), "mine")
