"""Datasets with ``rig = "mjcf"``: names of channels, model and devices, and one sentence for every mistake."""

import re
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.channels import MechanismChannels, get_column_units
from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.datasets.mechanism_channels import QUANTITIES, normalize_name, parse_channel, parse_input_channel
from klute_sim.datasets.write import write_trial
from klute_sim.errors import InputError

CHANNELS = """
prescribed = ["pressure_command_flexor", "pressure_command_extensor"]
measured = ["angle_joint", "force_flexor"]"""
HEAD = 'format = "klute-sim-dataset/2"\nrig = "mjcf"\ndevice = "klute-3-4-pair"\n'
MODEL = 'model = "antagonist_joint"'
TRIAL = '\n[[trial]]\nfiles = ["a.csv"]\n'
VALID = HEAD + MODEL + CHANNELS + TRIAL
OWN_DEVICE = '\n[devices.flexor]\n[devices.extensor]\ndevice = "klute-3-4-pair"\n'
TIME = np.linspace(0.0, 1.0, 101)


def load(folder: Path, text: str, **columns: np.ndarray) -> Dataset:
    (folder / "dataset.toml").write_text(text)
    table = {
        "time [s]": TIME,
        "pressure_command_flexor [bar]": 2.0 + TIME,
        "pressure_command_extensor [bar]": 3.0 - TIME,
        "angle_joint [deg]": 20.0 + 10.0 * TIME,
        "force_flexor [N]": 200.0 + TIME,
    }
    write_trial(folder / "a.csv", {**table, **columns})
    return load_dataset(folder)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_every_quantity_is_parsed_back(quantity: str) -> None:
    channel = parse_channel(f"{quantity}_left_knee")
    assert (channel.quantity, channel.object_name) == (quantity, "left_knee")
    assert get_column_units(MechanismChannels((), (channel.name,)))[channel.name] == channel.si_unit


@pytest.mark.parametrize("name", ["angle", "angle_", "elbow", "angle_Elbow", "velocity_elbow"])
def test_other_names_are_refused(name: str) -> None:
    with pytest.raises(InputError, match="allowed quantities"):
        parse_channel(name)


def test_outputs_cannot_be_prescribed() -> None:
    with pytest.raises(InputError, match="cannot be prescribed"):
        parse_input_channel("force_biceps")
    assert normalize_name("Left.Knee-2") == "left_knee_2"


def test_devices_and_numbers_are_read(tmp_path: Path) -> None:
    extra = """
[devices.flexor]
[devices.extensor]
changes = { "tendon.slack_length_mm" = 95 }
[numbers]
"model.geom.load.mass" = 1.5
[uncertain]
"muscle.friction_slope_n_per_bar" = "10 %"
"extensor/tendon.slack_length_mm" = 2
"model.geom.load.mass" = "20 %"
"""
    trial = TRIAL + '[trial.numbers]\n"model.joint.joint.damping" = 0.3\n[trial.device]\n"tendon.engagement_mm" = 6\n'
    dataset = load(tmp_path, HEAD + MODEL + CHANNELS + extra + trial)
    assert dataset.mechanism is not None
    assert dataset.mechanism.devices["extensor"].parameters.tendon.slack_length == pytest.approx(0.095)
    assert dataset.nominal_numbers == {"extensor/tendon.slack_length_mm": 95, "model.geom.load.mass": 1.5}
    assert dataset.uncertainties["model.geom.load.mass"] == pytest.approx(0.3)
    only_trial = dataset.trials[0]
    assert only_trial.model_numbers == {"model.geom.load.mass": 1.5, "model.joint.joint.damping": 0.3}
    assert [d.parameters.tendon.engagement_stretch for d in only_trial.devices.values()] == [0.006, 0.006]
    assert only_trial.measured["angle_joint"].value[0] == pytest.approx(np.radians(20.0))


def test_trial_changes_one_device_of_a_mechanism(tmp_path: Path) -> None:
    changes = '[trial.device]\n"extensor/tendon.engagement_mm" = 6\n"tendon.engagement_mm" = 5\n'
    (trial,) = load(tmp_path, VALID + changes).trials
    stretches = {name: device.parameters.tendon.engagement_stretch for name, device in trial.devices.items()}
    assert stretches == {"flexor": 0.005, "extensor": 0.006}
    heavy = '[trial.device]\n"extensor/muscle.c10_kpa" = 1\n'
    with pytest.raises(InputError, match=r"accept it with --accept extensor/muscle\.c10_kpa"):
        load(tmp_path, VALID + heavy)


def test_initial_state_of_a_trial_is_stated_with_units(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "datasets.md").read_text("utf-8")
    (initial,) = re.findall(r"^```toml\n(\[trial.initial\]\n.*?)^```", page, re.MULTILINE | re.DOTALL)
    state = load(tmp_path, HEAD + MODEL + CHANNELS + TRIAL + initial).trials[0].initial_state
    assert state.positions == pytest.approx({"joint": np.pi / 6})
    assert state.velocities == pytest.approx({"joint": -np.pi / 2})
    assert state.pressures == pytest.approx({"flexor": 1.5e5})


def test_initial_state_of_a_slide_is_stated_with_units(tmp_path: Path) -> None:
    channels = '\nprescribed = ["pressure_command_muscle"]\nmeasured = ["force_muscle"]'
    initial = '[trial.initial]\nposition_guide = "5 mm"\nvelocity_guide = "20 mm/s"\n'
    columns = {"pressure_command_muscle [bar]": 2.0 + TIME, "force_muscle [N]": 20.0 + TIME}
    dataset = load(tmp_path, HEAD + 'model = "hanging_mass"' + channels + TRIAL + initial, **columns)
    assert dataset.trials[0].initial_state == ({"guide": 0.005}, {"guide": 0.02}, {})


def test_every_tendon_has_the_device_by_default(tmp_path: Path) -> None:
    dataset = load(tmp_path, HEAD + MODEL + CHANNELS + TRIAL)
    assert dataset.mechanism is not None
    assert list(dataset.mechanism.devices) == ["flexor", "extensor"]
    assert dataset.mechanism.shares_device == {"flexor", "extensor"}


def test_model_in_the_folder_belongs_to_the_digest(tmp_path: Path) -> None:
    from klute_sim.plant.mjcf.model_file import load_model_file

    content = load_model_file("antagonist_joint").content
    (tmp_path / "elbow.xml").write_bytes(content)
    first = load(tmp_path, HEAD + 'model = "elbow.xml"' + CHANNELS + TRIAL)
    (tmp_path / "elbow.xml").write_bytes(content.replace(b'mass="1"', b'mass="2"'))
    assert load_dataset(tmp_path).digest != first.digest


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + CHANNELS + TRIAL, "needs the key 'model'"),
        (HEAD + MODEL + TRIAL, "needs the key 'prescribed'"),
        (HEAD + 'model = "elbow"' + CHANNELS + TRIAL, "no model"),
        (HEAD + MODEL + CHANNELS.replace("angle_joint", "angle_Joint") + TRIAL, "is not of the form"),
        (HEAD + MODEL + CHANNELS.replace("angle_joint", "pressure_command_flexor") + TRIAL, "is named twice"),
        (
            HEAD + MODEL + CHANNELS.replace("pressure_command_extensor", "force_extensor") + TRIAL,
            "cannot be prescribed",
        ),
        (HEAD + MODEL + CHANNELS + "\n[devices.biceps]\n" + TRIAL, "the tendons are: flexor, extensor"),
        (HEAD + MODEL + CHANNELS + "\n[devices.flexor]\n" + TRIAL, "add a table [devices.extensor]"),
        (HEAD + MODEL + CHANNELS.replace("angle_joint", "angle_elbow") + TRIAL, "no hinge joint; there are: joint"),
        (HEAD + MODEL + CHANNELS.replace("force_flexor", "force_biceps") + TRIAL, "there are: flexor, extensor"),
        (
            HEAD + MODEL + CHANNELS.replace(', "pressure_command_extensor"', "") + TRIAL,
            "device 'extensor' has no pressure; prescribe pressure_command_extensor",
        ),
        (VALID + "[trial.initial]\nangle_joint = 30\n", "allowed: text with a unit, as angle_elbow = '30 deg'"),
        (HEAD + MODEL + CHANNELS + '\n[numbers]\n"model.site.flexor.pos_z" = 1\n' + TRIAL, "--numbers' lists all"),
        (HEAD + MODEL + CHANNELS + '\n[numbers]\n"model.geom.load.maas" = 1\n' + TRIAL, "did you mean"),
        (HEAD + MODEL + CHANNELS + '\n[uncertain]\n"model.geom.x.mass" = 1\n' + TRIAL, "is not a numeric key"),
        (HEAD.replace("mjcf", "bench") + MODEL + TRIAL, "'model' is for rig = 'mjcf'"),
        (HEAD.replace("mjcf", "bench") + TRIAL + '[trial.numbers]\n"model.geom.load.mass" = 1\n', "for rig = 'mjcf'"),
        (HEAD.replace("mjcf", "bench") + TRIAL + '[trial.initial]\nvelocity_joint = "1 rad/s"\n', "for rig = 'mjcf'"),
        (
            VALID + '[trial.initial]\nvelocity_elbow = "1 rad/s"\n',
            "did you mean 'velocity_joint'",
        ),
        (
            HEAD + MODEL + CHANNELS + OWN_DEVICE + '[diameter]\ndevice = "10 mm"\ntrials = "20 mm"\n' + TRIAL,
            "[diameter] scales the muscle of the dataset's device, but [devices.extensor] names a device with a muscle",
        ),
        (VALID + '[trial.device]\n"flexer/tendon.engagement_mm" = 6\n', "no device; did you mean 'flexor'"),
        (VALID + '[trial.initial]\nvelocity_joint = "90 deg"\n', "unit of the wrong kind; allowed: deg/s, rad/s"),
        (VALID + "[trial.initial]\nvelocity_joint = 3\n", "trial.1.initial.velocity_joint = 3"),
        (VALID + '[trial.initial]\npressure_flexor = "-1 bar"\n', "allowed: a gauge pressure of 0 or more"),
        (
            VALID.replace('"angle_joint", ', "") + '[trial.initial]\nvelocity_joint = "1 rad/s"\n',
            "whose position is not known; state angle_joint",
        ),
        (HEAD.replace("mjcf", "joint") + TRIAL, "'bench', 'gait' or 'mjcf'"),
        (HEAD + MODEL + CHANNELS.replace("angle_joint", "moment_joint, site_x_tip") + TRIAL, "is not of the form"),
    ],
)
def test_mistakes_are_one_sentence(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        load(tmp_path, text)
    assert message in str(error.value)


def test_documented_example_is_a_valid_dataset(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "mechanisms.md").read_text("utf-8")
    (text,) = re.findall(r"^```toml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    columns = {
        "time [s]": TIME,
        "pressure_command_flexor [bar]": 2.0 + TIME,
        "pressure_command_extensor [bar]": 3.0 - TIME,
        "angle_joint [deg]": 20.0 + 10.0 * TIME,
    }
    for name in ("steps_1.csv", "steps_2.csv"):
        write_trial(tmp_path / name, columns)
    (tmp_path / "dataset.toml").write_text(text)
    dataset = load_dataset(tmp_path)
    assert set(dataset.nominal_numbers) == set(dataset.uncertainties) - {"muscle.friction_offset_n"}


def test_documented_quantities_are_complete() -> None:
    page = (Path(__file__).parents[2] / "docs" / "mechanisms.md").read_text("utf-8")
    assert all(f"`{quantity}`" in page for quantity in QUANTITIES)
