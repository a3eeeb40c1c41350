"""Mistakes in a dataset or model of a mechanism end in one sentence on the command line."""

import re
import shutil
from pathlib import Path

import pytest

from klute_sim.device.device import load_device, parse_device
from klute_sim.errors import InputError
from klute_sim.plant.mjcf.model_file import load_model_file
from tests import command_line as command
from tests.diagnosis import synthetic_joint_dataset as joint


def refuse(*arguments: str, cwd: Path) -> str:
    """Return the only line that the command prints; it leaves no file."""
    files = set(cwd.iterdir())
    done = command.run(*arguments, "--out", "found", cwd=cwd)
    assert done.returncode == 2
    assert done.stdout == ""
    assert set(cwd.iterdir()) == files
    (sentence,) = [line for line in done.stderr.strip().splitlines() if ": ignored columns " not in line]
    return sentence


def diagnose(folder: Path) -> str:
    return refuse("diagnose", str(folder), "--no-report", cwd=folder.parent)


def edit(folder: Path, old: str, new: str) -> None:
    path = folder / "dataset.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.fixture(scope="module")
def valid_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return joint.write_dataset(tmp_path_factory.mktemp("valid") / "data", groups=("fit_1",), repeats=1, seconds=1.5)


@pytest.fixture
def folder(valid_dataset: Path, tmp_path: Path) -> Path:
    return shutil.copytree(valid_dataset, tmp_path / "data")


MODEL = load_model_file("antagonist_joint").content.decode()
MODEL_MISTAKES = {
    "is no XML: no element found": "",
    "is no XML: unclosed token": MODEL[:2000],
    "unrecognized attribute: 'nonsense'": MODEL.replace("<joint name", '<joint nonsense="1" name'),
    "cannot be compiled (geom 'nowhere' not found in tendon 0": MODEL.replace(
        'geom geom="pulley"', 'geom geom="nowhere"'
    ),
    "cannot be compiled (mass and inertia of moving bodies": re.sub(r'mass="(1|0\.5|0\.1)"', 'mass="0"', MODEL),
    "cannot be compiled (Error opening file 'lever.stl')": MODEL.replace("<asset>", '<asset><mesh file="lever.stl"/>'),
    "refers to '../lever.stl', which is outside its folder": MODEL.replace(
        "<asset>", '<asset><mesh file="../lever.stl"/>'
    ),
    "refers to '../other.xml', which is outside its folder": MODEL.replace(
        "<worldbody>", '<include file="../other.xml"/><worldbody>'
    ),
    "includes a file that is missing: ": MODEL.replace("<worldbody>", '<include file="other.xml"/><worldbody>'),
    "has an <include> without file": MODEL.replace("<worldbody>", "<include/><worldbody>"),
    "allowed: Euler, implicit, implicitfast": MODEL.replace("implicitfast", "RK4"),
    "carries the actuator 'motor' of MuJoCo beside a device": MODEL.replace(
        "</mujoco>", '<actuator><motor name="motor" tendon="flexor"/></actuator></mujoco>'
    ),
}
"""Part of the sentence -> content of the MJCF file."""


@pytest.mark.parametrize("part", MODEL_MISTAKES)
def test_model_that_is_refused(folder: Path, part: str) -> None:
    (folder / "elbow.xml").write_text(MODEL_MISTAKES[part])
    edit(folder, 'model = "antagonist_joint"', 'model = "elbow.xml"')
    assert part in diagnose(folder)


@pytest.mark.parametrize("part", [part for part in MODEL_MISTAKES if "outside" in part or "cannot be" in part])
@pytest.mark.parametrize("arguments", [("bench", "joint", "steps"), ("export", "klute-3-4-pair", "--format", "mjcf")])
def test_model_that_is_refused_elsewhere(tmp_path: Path, arguments: tuple[str, ...], part: str) -> None:
    (tmp_path / "elbow.xml").write_text(MODEL_MISTAKES[part])
    assert part in refuse(*arguments, "--model", "elbow.xml", cwd=tmp_path)


@pytest.mark.parametrize(
    ("number", "part"),
    [
        ("model.geom.load.mass = -1", "cannot be compiled with its changed numbers (mass, inertia or density are neg"),
        ("model.joint.elbow.damping = 1", "'model.joint.elbow.damping' is not a number of the model"),
        ("model.joint.joint.stiffness = -1e9", "antagonist_joint.xml diverges: actuator 'flexor' has no finite state"),
    ],
)
def test_number_that_the_model_cannot_have(
    folder: Path, capfd: pytest.CaptureFixture[str], number: str, part: str
) -> None:
    name, value = number.split(" = ")
    edit(folder, "[numbers]\n", f'[numbers]\n"{name}" = {value}\n')
    assert part in diagnose(folder)
    assert part in refuse("bench", "joint", "steps", "--set", f"{name}={value}", cwd=folder.parent)
    assert capfd.readouterr() == ("", "")  # MuJoCo itself prints nothing


def test_gravity_that_no_place_has_is_refused_with_data_and_diverges_without(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    edit(folder, "[numbers]\n", '[numbers]\n"model.option.gravity_z" = -1e12\n')
    assert "the gravity of the model is 1e+12 m/s2; allowed: 0, or 0.5 to 30 m/s2" in diagnose(folder)
    answer = refuse("bench", "joint", "steps", "--set", "model.option.gravity_z=-1e12", cwd=folder.parent)
    assert "antagonist_joint.xml diverges: its motion is not finite after t = 0.0" in answer
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        (
            "[numbers]\n",
            "[devices.biceps]\n[numbers]\n",
            "[devices] names the tendon 'biceps'; the tendons are: flexor, ext",
        ),
        (
            "[numbers]\n",
            "[devices.flexor]\n[numbers]\n",
            "'pressure_command_extensor' belongs to the tendon 'extensor', which has no device",
        ),
        (
            "[uncertain]\n",
            '[uncertain]\n"model.joint.elbow.damping" = 1\n',
            "names 'model.joint.elbow.damping', which is not",
        ),
        ("[uncertain]\n", '[uncertain]\n"biceps/muscle.c10_kpa" = 1\n', "names 'biceps/muscle.c10_kpa', which is not"),
        ("angle_joint", "angle_elbow", "'angle_elbow' belongs to no hinge joint; there are: joint"),
        ("angle_joint", "position_joint", "'position_joint' belongs to no slide joint"),
        ("angle_joint", "site_x_hand", "'site_x_hand' belongs to no site; there are: flexor_origin"),
        ("angle_joint", "sensor_angle_encoder", "'sensor_angle_encoder' belongs to no sensor"),
        ("angle_joint", "force_biceps", "'force_biceps' belongs to no device; there are: flexor, extensor"),
        ("angle_joint", "torque_joint", "'torque_joint' is not of the form <quantity>_<object>"),
    ],
)
def test_name_of_nothing(folder: Path, old: str, new: str, part: str) -> None:
    edit(folder, old, new)
    if old == "angle_joint":
        unit = {"force": "N", "angle": "deg", "sensor": "deg"}.get(new.split("_")[0], "mm")
        table = folder / "fit_1_0.csv"
        table.write_text(table.read_text().replace("angle_joint [deg]", f"{new} [{unit}]"))
    assert part in diagnose(folder)


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("angle_joint [deg]", "angle_joint", "'angle_joint' has no unit in square brackets"),
        ("angle_joint [deg]", "angle_joint [N]", "'angle_joint [N]' has a unit of the wrong kind; allowed: deg, rad"),
        (
            "angle_joint [deg]",
            "angle_joint [rad]",
            "it looks like degrees that were taken for radians; correct the unit",
        ),
        ("angle_joint [deg]", "elbow [deg]", "no channel is measured; a mjcf trial needs at least one of angle_joint"),
        ("time [s]", "clock [s]", "has no column 'time [s]'"),
        ("pressure_command_flexor", "p1", "the prescribed channel 'pressure_command_flexor' is missing"),
    ],
)
def test_column_that_is_missing_or_has_another_unit(folder: Path, old: str, new: str, part: str) -> None:
    table = folder / "fit_1_0.csv"
    table.write_text(table.read_text().replace(old, new))
    assert part in diagnose(folder)


def test_channel_that_no_trial_has(folder: Path) -> None:
    edit(folder, "['angle_joint']", "['angle_joint', 'force_flexor']")
    assert "no trial has the measured channel 'force_flexor'; add its column to the files" in diagnose(folder)


def test_tendons_without_names(folder: Path) -> None:
    text = MODEL
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
