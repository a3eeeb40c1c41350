"""Repeats in the draft of dataset.toml: which recordings form a group, and what is said about others."""

from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from tests.datasets.test_draft import COMMAND, DEVICE, FORCE, LENGTH, TIME, write

CYLINDER = """name = "cylinder"
description = "vented"
[cylinder]
extended_length_mm = 400.0
stroke_mm = 120.0
"""


def test_device_without_a_supply_needs_no_command(tmp_path: Path) -> None:
    (tmp_path / "cylinder.toml").write_text(CYLINDER)
    for name, scale in (("slow_a", 1.0), ("slow_b", 1.0), ("short", 0.5)):
        write(tmp_path / f"{name}.csv", ["t [s]", "L [mm]", "F [N]"], [TIME, 340.0 + scale * (LENGTH - 340.0), FORCE])
    draft = ks.draft_dataset(tmp_path)
    assert "pressure_command" not in draft.text
    assert draft.is_complete
    assert [trial.group for trial in ks.load_dataset(tmp_path).trials] == ["short", "slow", "slow"]


def test_group_has_the_name_of_no_trial(tmp_path: Path) -> None:
    for name, scale in (("ramp", 0.5), ("ramp_1", 1.0), ("ramp_2", 1.0)):
        columns = [TIME, 340.0 + scale * (LENGTH - 340.0), COMMAND, FORCE]
        write(tmp_path / f"{name}.csv", ["t [s]", "L [mm]", "cmd [bar]", "F [N]"], columns)
    assert ks.draft_dataset(tmp_path, DEVICE).n_groups == 2
    alone, *repeats = (trial.group for trial in ks.load_dataset(tmp_path).trials)
    assert alone == "ramp"
    assert len(set(repeats)) == 1
    assert repeats[0] != "ramp"


def test_repeats_agree_in_the_inputs_that_are_known(tmp_path: Path) -> None:
    for name, scale in (("a", 1.0), ("b", 1.0), ("c", 0.5)):
        columns = [TIME, 340.0 + scale * (LENGTH - 340.0), COMMAND, FORCE]
        write(tmp_path / f"{name}.csv", ["t [s]", "L [mm]", "AIN3", "F [N]"], columns)
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert draft.n_groups == 2
    assert "check the groups: repeats are recognized without pressure_command" in draft.remarks


def test_without_inputs_no_repeats_are_recognized(tmp_path: Path) -> None:
    for name in "ab":
        write(tmp_path / f"{name}.csv", ["t [s]", "AIN3", "F [N]"], [TIME, COMMAND, FORCE])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert draft.n_groups == 2
    assert any("not recognized without length and pressure_command" in remark for remark in draft.remarks)


def test_repeats_without_time_agree_row_by_row(tmp_path: Path) -> None:
    for name, scale in (("a", 1.0), ("b", 1.0), ("c", 0.5)):
        columns = [340.0 + scale * (LENGTH - 340.0), COMMAND, FORCE]
        write(tmp_path / f"{name}.csv", ["L [mm]", "cmd [bar]", "F [N]"], columns)
    assert ks.draft_dataset(tmp_path, DEVICE).n_groups == 2


@pytest.mark.parametrize(("difference", "n_groups"), [(0.0, 1), (0.3, 2)])
def test_measured_pressure_agrees_within_its_noise(tmp_path: Path, difference: float, n_groups: int) -> None:
    random = np.random.default_rng(1)
    for name, offset in (("a", 0.0), ("b", difference)):
        pressure = 3.0 + offset + 0.05 * random.standard_normal(len(TIME))
        force = 300.0 + 50.0 * np.sin(2.0 * TIME) ** 2
        write(tmp_path / f"{name}.csv", ["t [s]", "L [mm]", "p [bar]", "F [N]"], [TIME, LENGTH, pressure, force])
    assert ks.draft_dataset(tmp_path, DEVICE).n_groups == n_groups
