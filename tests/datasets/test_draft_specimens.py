"""Draft of dataset.toml: repeats, and muscles of several resting lengths."""

from pathlib import Path

import numpy as np

import klute_sim as ks
from tests.datasets.test_draft import COMMAND, DEVICE, FORCE, LENGTH, TIME, write

HEADINGS = ("time [s]", "length [mm]", "pressure_command [bar]", "force [N]")


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
