"""Datasets of a mechanism with a muscle against a spring, a device without a supply."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.datasets.mechanism_statics import compute_statics
from klute_sim.datasets.write import write_trial
from klute_sim.errors import InputError
from klute_sim.types import Array

HEAD = """format = "klute-sim-dataset/2"
rig = "mjcf"
model = "antagonist_joint"
prescribed = ["pressure_command_flexor", "pressure_command_extensor"]
measured = ["angle_joint"]
"""
NUMBERS = """
[numbers]
"model.site.flexor_origin.pos_z" = 0.29
"model.site.extensor_origin.pos_z" = 0.29
"""
SPRING = """name = "spring"
[tendon]
slack_length_mm = 250
stiffness_1_n_per_mm = 2
stiffness_2_n_per_mm = 0
engagement_mm = 100
"""
MUSCLE_AND_SPRING = """device = "klute-3-4-pair"
[devices.flexor]
[devices.extensor]
device = "spring.toml"
"""
TIME = np.linspace(0.0, 2.0, 201)
WAVEFORM = np.sin(3.0 * TIME)


def load(folder: Path, devices: str, flexor: Array, extensor: Array, angle: Array) -> Dataset:
    """Load one trial with two commands [bar] and an angle [deg]."""
    (folder / "spring.toml").write_text(SPRING)
    (folder / "dataset.toml").write_text(f'{HEAD}{devices}{NUMBERS}\n[[trial]]\nfiles = ["a.csv"]\n')
    columns = {
        "time [s]": TIME,
        "pressure_command_flexor [bar]": flexor,
        "pressure_command_extensor [bar]": extensor,
        "angle_joint [deg]": angle,
    }
    write_trial(folder / "a.csv", columns)
    return load_dataset(folder)


def test_tendons_with_own_devices_need_no_supply_of_the_dataset(tmp_path: Path) -> None:
    devices = "".join(f'[devices.{tendon}]\ndevice = "klute-3-4-pair"\n' for tendon in ("flexor", "extensor"))
    devices = f'device = "spring.toml"\n{devices}'
    assert load(tmp_path, devices, 2.0 + WAVEFORM, 3.0 - WAVEFORM, 30.0 + 10.0 * WAVEFORM).accepted == ()


def test_pressures_of_a_device_without_supply_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="of tendon 'extensor', but its device 'spring' has no \\[supply\\]"):
        load(tmp_path, MUSCLE_AND_SPRING, 2.0 + WAVEFORM, 3.0 - WAVEFORM, 30.0 + 10.0 * WAVEFORM)


def test_muscle_against_a_spring_is_accepted(tmp_path: Path) -> None:
    dataset = load(tmp_path, MUSCLE_AND_SPRING, 2.0 + WAVEFORM, 0.0 * TIME, 30.0 + 10.0 * WAVEFORM)
    assert dataset.accepted == ()


def test_joint_rests_where_muscle_and_spring_balance(tmp_path: Path) -> None:
    dataset = load(tmp_path, MUSCLE_AND_SPRING, 2.0 + WAVEFORM, 0.0 * TIME, 30.0 + 10.0 * WAVEFORM)
    assert dataset.mechanism is not None
    statics = compute_statics(dataset.mechanism, dataset.mechanism.devices, dataset.trials[0].model_numbers)
    assert statics is not None
    flexor = np.linspace(0.0, 4e5, 5)
    rest = statics.find_rest({"flexor": flexor, "extensor": np.zeros(5)})
    without_spring = statics.find_rest({"flexor": flexor})
    assert np.all(np.diff(rest) > 0.0)
    assert np.all(rest < without_spring)


def test_joint_that_an_idle_muscle_and_a_spring_hold_is_accepted(tmp_path: Path) -> None:
    still = np.full(201, 30.0)
    assert load(tmp_path, MUSCLE_AND_SPRING, np.full(201, 3.0), 0.0 * TIME, still).accepted == ()
    with pytest.raises(InputError, match="although pressure_command_flexor goes over 1 to 3 bar"):
        load(tmp_path, MUSCLE_AND_SPRING, 2.0 + WAVEFORM, 0.0 * TIME, still)
