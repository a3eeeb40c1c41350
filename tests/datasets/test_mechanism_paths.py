"""Paths of the tendons of a model, and which joints change them."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from klute_sim.datasets.dataset import Dataset, load_dataset
from klute_sim.datasets.mechanism_paths import find_moved_tendons, list_stops, measure_paths
from klute_sim.datasets.write import write_trial
from klute_sim.errors import InputError
from klute_sim.types import Array

MODEL = """<mujoco>
  <compiler angle="degree" autolimits="true"/>
  <worldbody>
    <site name="upper_origin" pos="0.04 0 0.34"/>
    <site name="lower_origin" pos="1.04 0 0.34"/>
    <body>
      <joint name="Shoulder" axis="0 -1 0" range="-60 60"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.015" mass="0.5"/>
      <site name="upper_insertion" pos="0.04 0 0"/>
    </body>
    <body pos="1 0 0">
      <joint name="elbow" axis="0 -1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.015" mass="0.5"/>
      <site name="lower_insertion" pos="0.04 0 0"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="upper"><site site="upper_origin"/><site site="upper_insertion"/></spatial>
    <spatial name="lower"><site site="lower_origin"/><site site="lower_insertion"/></spatial>
  </tendon>
</mujoco>
"""
HEAD = """format = "klute-sim-dataset/2"
rig = "mjcf"
model = "arm.xml"
device = "klute-3-4-pair"
prescribed = ["pressure_command_upper", "pressure_command_lower"]
measured = ["angle_shoulder", "angle_elbow"]
[[trial]]
files = ["a.csv"]
"""
TIME = np.linspace(0.0, 2.0, 201)
WAVEFORM = np.sin(3.0 * TIME)


def load(folder: Path, shoulder: Array, elbow: Array) -> Dataset:
    """Load a trial in which the command of the upper muscle changes alone."""
    (folder / "arm.xml").write_text(MODEL)
    (folder / "dataset.toml").write_text(HEAD)
    columns = {
        "time [s]": TIME,
        "pressure_command_upper [bar]": 2.0 + WAVEFORM,
        "pressure_command_lower [bar]": np.full(201, 2.0),
        "angle_shoulder [deg]": shoulder,
        "angle_elbow [deg]": elbow,
    }
    write_trial(folder / "a.csv", columns)
    return load_dataset(folder)


def test_each_joint_moves_its_own_tendon() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL)
    moved = find_moved_tendons(model)
    assert (moved["angle_shoulder"], moved["angle_elbow"]) == ({"upper"}, {"lower"})
    assert list_stops(model)["angle_shoulder"] == pytest.approx((-np.pi / 3.0, np.pi / 3.0))
    assert "angle_elbow" not in list_stops(model)
    low, high = measure_paths(model, ["upper"])["upper"]
    assert low < 0.34 < high


def test_still_joint_is_stuck_only_under_its_own_muscle(tmp_path: Path) -> None:
    assert load(tmp_path, 10.0 + 10.0 * WAVEFORM, np.full(201, 5.0)).accepted == ()
    with pytest.raises(InputError) as error:
        load(tmp_path, np.full(201, 10.0), np.full(201, 5.0))
    assert str(error.value).endswith("accept it with --accept angle_shoulder-constant")
