"""Draft of dataset.toml: repeats, and muscles of several resting lengths."""

from pathlib import Path

import numpy as np
import pytest

import klute_sim as ks
from tests.datasets.test_draft import COMMAND, DEVICE, FORCE, LENGTH, TIME, write

HEADINGS = ("time [s]", "length [mm]", "pressure_command [bar]", "force [N]")
MUSCLE = """
name = "muscle"
description = "bare muscle"
[muscle]
count = 1
resting_length_mm = 300.0
braid_length_ratio = 1.1034
turns_per_m = 7.0681
bladder_radius_mm = 10.5
bladder_thickness_mm = 1.5
c10_kpa = 400.0
c01_kpa = 400.0
friction_slope_n_per_bar = 0.0
friction_offset_n = 0.0
friction = false
[supply]
pressure_bar = 7.0
rate_bar_per_s = 1000.0
gas_temperature_c = 20.0
"""
"""A muscle of 300 mm without a tendon."""


def write_held(folder: Path, name: str, length: float, force: np.ndarray = FORCE) -> None:
    write(folder / f"{name}.csv", HEADINGS, [TIME, length + 0.0 * TIME, COMMAND, force])


def read_groups(folder: Path) -> list[str]:
    return [trial.group for trial in ks.load_dataset(folder).trials]


def test_repeats_agree_in_their_outputs(tmp_path: Path) -> None:
    noise = 2.0 * np.sin(1e3 * TIME)
    for name, scale in (("a_1", 1.0), ("a_2", 1.02), ("b_1", 0.85), ("b_2", 0.86)):
        write(tmp_path / f"{name}.csv", HEADINGS, [TIME, LENGTH, COMMAND, scale * FORCE + noise])
    assert ks.draft_dataset(tmp_path, DEVICE).n_groups == 2
    assert read_groups(tmp_path) == ["a", "a", "b", "b"]


def test_noise_and_gaps_do_not_separate_repeats(tmp_path: Path) -> None:
    strong = np.where(np.arange(len(TIME)) % 7 == 0, np.nan, FORCE)
    for name, length, force in (("strong_1", 345.0, strong), ("strong_2", 345.0, FORCE)):
        write_held(tmp_path, name, length, force)
    for seed in (1, 2):
        slack = np.random.default_rng(seed).normal(0.0, 0.3, len(TIME))
        write_held(tmp_path, f"slack_{seed}", 300.0, slack)
    assert ks.draft_dataset(tmp_path, DEVICE).n_groups == 2


def test_gaps_in_the_time_leave_recordings_apart(tmp_path: Path) -> None:
    gap = np.where(TIME > 3.0, np.nan, TIME)
    for name, time in (("a", TIME), ("b", gap), ("c", gap)):
        write(tmp_path / f"{name}.csv", HEADINGS, [time, LENGTH, COMMAND, FORCE])
    assert ks.draft_dataset(tmp_path, DEVICE).n_groups == 3


def test_lengths_of_one_millimetre_apart_are_no_repeats(tmp_path: Path) -> None:
    for length in (330.0, 331.0, 350.0):
        write_held(tmp_path, f"{length:.0f}", length)
    assert ks.draft_dataset(tmp_path, DEVICE).n_groups == 3


def test_empty_column_is_not_used(tmp_path: Path) -> None:
    columns = [TIME, LENGTH, COMMAND, FORCE, np.full(len(TIME), np.nan)]
    for name in "ab":
        write(tmp_path / f"{name}.csv", [*HEADINGS, "Pressure (bar)"], columns)
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert draft.n_groups == 1
    assert draft.remarks == ("not used: the columns 'Pressure (bar)'",)


def accept_proposals(draft: ks.DatasetDraft) -> None:
    """Remove the # before the proposed numbers of each trial."""
    head, *trials = draft.path.read_text("utf-8").split("[[trial]]")
    accepted = [trial.replace("\n# ", "\n") for trial in trials]
    draft.path.write_text("[[trial]]".join([head, *accepted]), "utf-8")


@pytest.fixture
def device(tmp_path: Path) -> Path:
    path = tmp_path / "muscle.toml"
    path.write_text(MUSCLE)
    return path


def pull(resting_length: float, length: float) -> np.ndarray:
    return FORCE * (1.0 - 4.0 * (1.0 - length / resting_length)) * (1.0 - 24.0 / resting_length)


@pytest.mark.parametrize("is_stroke", [False, True])
def test_resting_lengths_in_file_names_are_proposed(tmp_path: Path, device: Path, is_stroke: bool) -> None:
    lengths = {f"d20mm_{rest}mm_{step}": (rest, rest * (1 - step / 10)) for rest in (120, 400) for step in (0, 1)}
    for name, (rest, length) in lengths.items():
        column = rest - length if is_stroke else length
        headings = ["time [s]", "stroke [mm]" if is_stroke else "Laenge [mm]", "cmd [bar]", "F [N]"]
        write(tmp_path / f"{name}.csv", headings, [TIME, column + 0.0 * TIME, COMMAND, pull(rest, length)])
    draft = ks.draft_dataset(tmp_path, device)
    assert not draft.is_complete
    assert any(("several resting lengths" in each) or ("120 to 400 mm" in each) for each in draft.remarks)
    accept_proposals(draft)
    trials = ks.load_dataset(tmp_path, accept=["force-unit"]).trials
    for trial in trials:
        rest, length = lengths[trial.name]
        assert trial.specimen == f"{rest} mm"
        assert trial.device.spec.collect_values()["muscle.resting_length_mm"] == rest
        assert trial.prescribed["length"].value == pytest.approx(1e-3 * length)


def test_repeats_are_of_one_specimen(tmp_path: Path, device: Path) -> None:
    for rest in (200, 300):
        for repeat in (1, 2):
            columns = [TIME, 0.0 * TIME, COMMAND, pull(rest, rest)]
            write(tmp_path / f"{rest}mm_{repeat}.csv", ["time [s]", "contraction [mm]", "cmd [bar]", "F [N]"], columns)
    assert ks.draft_dataset(tmp_path, device).text.count('group = "200mm"') == 2


def test_resting_lengths_that_no_name_states_are_asked_for(tmp_path: Path, device: Path) -> None:
    for number, length in enumerate((120.0, 200.0, 300.0)):
        write_held(tmp_path, f"test{number}_5mm", length)
    draft = ks.draft_dataset(tmp_path, device)
    assert '# specimen = "' not in draft.text
    assert draft.text.count("[trial.device]") == 1
    assert 'specimen = "A", and "muscle.resting_length_mm" = 300 under [trial.device]' in draft.remarks[0]


def test_lengths_of_another_muscle_are_doubted(tmp_path: Path, device: Path) -> None:
    write_held(tmp_path, "long_600mm", 580.0)
    draft = ks.draft_dataset(tmp_path, device)
    assert "not those of the device, which has 300 mm at rest" in draft.remarks[0]
    assert '# "muscle.resting_length_mm" = 600' in draft.text
    assert '# specimen = "' not in draft.text


def test_lengths_of_one_muscle_are_not_doubted(tmp_path: Path, device: Path) -> None:
    for length in (300.0, 280.0, 230.0):
        write_held(tmp_path, f"at_{length:.0f}mm", length)
    assert ks.draft_dataset(tmp_path, device).is_complete
