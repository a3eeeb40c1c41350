"""The documentation page about datasets: its examples work and its tables are complete."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from klute_sim.datasets import channels, format
from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.datasets.trial_files import table
from klute_sim.datasets.write import write_trial

PAGE = (Path(__file__).parents[2] / "docs" / "datasets.md").read_text("utf-8")


def find_code_blocks(kind: str) -> list[str]:
    return re.findall(rf"^```{kind}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def find_toml(section: str) -> str:
    """Return the whole dataset file with ``section``; fragments begin without ``format``."""
    (text,) = (block for block in find_code_blocks("toml") if section in block and block.startswith("format"))
    return text


def test_example_folder_is_a_valid_dataset(tmp_path: Path) -> None:
    text = find_toml("[uncertain]")
    (tmp_path / "dataset.toml").write_text(text)
    time = np.arange(10.0)
    bench = {"time [s]": time, "length [mm]": 340 + time, "pressure_command [bar]": time, "force [N]": time}
    for name in re.findall(r"\w+\.csv", find_code_blocks("")[0]):
        write_trial(tmp_path / name, {"time [s]": time, "pressure [bar]": time} if "pressure" in name else bench)
    dataset = load_dataset(tmp_path)
    assert [trial.group for trial in dataset.trials] == ["iso_3bar", "iso_3bar", "ramp+ramp_pressure", "short"]
    assert dataset.trials[3].device.parameters.muscle.resting_length == 0.18
    assert len(split_dataset(dataset).test) > 0


def test_example_of_declared_quantities_is_a_valid_dataset(tmp_path: Path) -> None:
    text = find_toml("[noise]")
    (tmp_path / "dataset.toml").write_text(text)
    time = np.arange(10.0)
    columns = {"time [s]": time, "length [mm]": 340 + time, "pressure_command [bar]": time, "force [N]": 10 * time}
    for name in re.findall(r"\w+\.csv", text):
        write_trial(tmp_path / name, columns)
    dataset = load_dataset(tmp_path)
    assert [trial.specimen for trial in dataset.trials] == ["A", "A", "B"]
    assert [trial.input_noise["length"] for trial in dataset.trials] == pytest.approx([5e-5, 2e-4, 2e-4])
    assert dataset.tolerance == pytest.approx({"force": 1.8, "pressure": 5e3})
    assert [trial.limits["force"] for trial in dataset.trials] == 3 * [(-9.0, 1150.0)]


def test_fragment_for_a_logged_pressure_replaces_the_command(tmp_path: Path) -> None:
    (fragment,) = (block for block in find_code_blocks("toml") if block.startswith("[columns]"))
    head = 'format = "klute-sim-dataset/2"\nrig = "bench"\ndevice = "klute-3-4-pair"\n'
    (tmp_path / "dataset.toml").write_text(f'{head}{fragment}[[trial]]\nfiles = ["a.csv"]\n')
    time = np.arange(10.0)
    columns = {"time [s]": time, "length [mm]": 340 + time, "pressure [bar]": 0.1 * time, "force [N]": 10 * time}
    write_trial(tmp_path / "a.csv", columns)
    (trial,) = load_dataset(tmp_path).trials
    assert trial.prescribed["pressure_command"].value[-1] == pytest.approx(9e4)
    assert trial.input_noise["pressure_command"] == pytest.approx(2e3)
    assert "pressure" not in trial.measured


def test_example_of_columns_is_a_valid_dataset(tmp_path: Path) -> None:
    (tmp_path / "dataset.toml").write_text(find_toml("[columns]"))
    heading = find_code_blocks("text")[1].splitlines()[0]
    rows = [f"{10 * k};340;1.7;{409 + k % 2}" for k in range(20)]
    (tmp_path / "iso_3bar.csv").write_text("\n".join([heading, *rows]))
    run = {"rate": 100.0, "force": 690 + np.arange(20.0)}
    savemat(tmp_path / "iso_3bar_b.mat", {"run": run, "data": np.column_stack((np.zeros(20), np.full(20, 300.0)))})
    csv, mat = load_dataset(tmp_path).trials
    assert csv.measured["force"].value[0] == pytest.approx((0.392 * 409 - 4.18) * 4.45)
    assert mat.measured["force"].time[-1] == pytest.approx(0.19)
    assert [trial.prescribed["pressure_command"].value[0] for trial in (csv, mat)] == pytest.approx([3e5, 3e5])


def test_example_file_is_read_as_documented(tmp_path: Path) -> None:
    text = find_code_blocks("text")[0]
    (tmp_path / "a.csv").write_text(text)
    result = table.read_trial_file(tmp_path / "a.csv", channels.get_column_units("bench"))
    assert np.isnan(result.columns["force"]).tolist() == [False, True, False]
    assert result.ignored == ("note",)


def test_all_keys_and_channels_are_documented() -> None:
    sections = {"uncertain", "columns", "noise", "limits", "delay", "tolerance", "devices", "numbers"}
    keys = {*format.DatasetFile.model_fields, *format.TrialEntry.model_fields} - sections - {"trial"}
    names = {name for rig in channels.RIGS for name in channels.get_column_units(rig)}
    assert all(f"`{name}`" in PAGE for name in keys | names)
    assert all(
        f"`[{section}]`" in PAGE for section in sections | {"[trial]", "trial.device", "trial.columns", "trial.noise"}
    )
