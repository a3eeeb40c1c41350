"""``klute-sim bench`` end to end, as a user types it."""

import csv
import json
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest

from klute_sim.bench.protocols import library as protocols_library
from klute_sim.datasets import trial
from klute_sim.device.device import load_device
from klute_sim.recording import parquet
from tests import command_line as command

SMALL = """
kind = "workloop"
name = "small"
pressures_bar = [3, 5]
low_bar = 0.0
velocities_mm_per_s = [200]
activations = ["concentric", "eccentric"]
long_muscle_ratio = 0.99
short_muscle_ratio = 0.91
acceleration_m_per_s2 = 20.0
dwell_s = 0.1

[sources]
dwell_s = "assumed: enough"
"""


def run(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return command.run("bench", *arguments, cwd=cwd)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    folder = tmp_path_factory.mktemp("bench")
    (folder / "small.toml").write_text(SMALL, "utf-8")
    done = run("small.toml", "klute-3-4", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def test_run_folder_holds_all_files(made: tuple[Path, dict[str, object]]) -> None:
    folder, shown = made
    home = folder / str(shown["run"])
    assert home == folder / "runs" / "bench-001"
    names = [f"{way}_200mm_per_s_{bar}bar" for way in ("concentric", "eccentric") for bar in (3, 5)]
    wanted = {
        "summary.json",
        "results.csv",
        "device.toml",
        "protocol.toml",
        "figure.png",
        "index.html",
        *(f"{n}.parquet" for n in names),
    }
    assert {file.name for file in home.iterdir()} == wanted == set(shown["files"])  # type: ignore[call-overload]
    assert json.loads((home / "summary.json").read_text()) == shown
    assert (home / "protocol.toml").read_text() == SMALL
    assert (home / "device.toml").read_bytes() == load_device("klute-3-4").content
    assert (home / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert (shown["device"], shown["protocol"], shown["mujoco"]) == ("klute-3-4", "small", False)
    assert "protocol.dwell_s" in shown["assumptions"]  # type: ignore[operator]
    assert "supply.rate_bar_per_s" in shown["assumptions"]  # type: ignore[operator]


def test_results_agree_with_recordings(made: tuple[Path, dict[str, object]]) -> None:
    folder, shown = made
    home = folder / str(shown["run"])
    with (home / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["work_j"]) > 0 for row in rows] == [True, True, False, False]
    for row, told in zip(rows, shown["trials"], strict=True):  # type: ignore[call-overload]
        assert row["trial"] == told["name"]
        assert float(row["work_j"]) == told["metrics"]["work_j"]
        recording = parquet.load_recording(home / f"{row['trial']}.parquet")
        half = recording.select(recording["time"] >= 0.5 + (recording["time"][-1] - 0.5) / 2 - 1e-9)
        assert -np.trapezoid(half["force"], 1e-3 * half["length"]) == pytest.approx(float(row["work_j"]), rel=1e-3)


def test_recordings_are_dataset_trials(made: tuple[Path, dict[str, object]]) -> None:
    folder, shown = made
    for file in (folder / str(shown["run"])).glob("*.parquet"):
        found = trial.read_trial([file], "bench")
        assert set(found.prescribed) == {"length", "pressure_command"}
        assert set(found.measured) == {"force", "pressure", "muscle_length"}


def test_mujoco_run_records_the_reached_length(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(SMALL.replace('["concentric", "eccentric"]', '["concentric"]'), "utf-8")
    done = run("small.toml", "--mujoco", "--out", "here", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "small: klute-3-4-pair, MuJoCo tester" in done.stdout
    assert "Values that the protocol assumes, because the source does not print them: dwell_s." in done.stdout
    assert "Positive work is done by the device" in done.stdout
    recording = parquet.load_recording(tmp_path / "here" / "concentric_200mm_per_s_5bar.parquet")
    assert 1e-4 < np.abs(recording["length"] - recording["length_command"]).max() < 0.5
    assert recording["load_cell"] == pytest.approx(recording["force"], rel=1e-6, abs=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("name", ["isometric", "step", "frequency", "quick-release", "creep", "isokinetic-unit"])
def test_every_kind_has_a_table_and_a_figure(name: str, tmp_path: Path) -> None:
    done = run(name, "--out", "r", "--step", "1", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"{name}: klute-3-4-pair, device only" in done.stdout
    assert (tmp_path / "r" / "figure.png").stat().st_size > 20_000


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.toml").touch()
    (tmp_path / "huge.toml").write_text("#" * 1_000_001)
    (tmp_path / "mine.toml").write_text(SMALL, "utf-8")
    (tmp_path / "device.toml").write_bytes(load_device("klute-3-4").content)
    for arguments, says in (
        (["empty.toml"], "protocol file empty.toml: key 'kind' is missing; allowed: isometric, isokinetic"),
        (["huge.toml"], "protocol file huge.toml has 1.000001 MB; allowed: up to 1 MB"),
        (["isometric", "mine.toml"], "'mine.toml' is a protocol where a device is expected"),
        (["device.toml"], "it looks like a device file, which stands after the protocol"),
    ):
        done = run(*arguments, cwd=tmp_path)
        assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
        assert says in done.stderr


@pytest.mark.long
def test_phased_activation_gets_no_advice_on_dwell(tmp_path: Path) -> None:
    done = run("workloop-phased", "--step", "1", "--out", "p", cwd=tmp_path)
    assert "its rise and fall are part of the experiment" in done.stdout
    assert "dwell_s it would be" not in done.stdout
    assert "[% of cycle]" in done.stdout
    (tmp_path / "short.toml").write_text(SMALL.replace("dwell_s = 0.1", "dwell_s = 0.0"), "utf-8")
    done = run("short.toml", "--out", "s", cwd=tmp_path)
    assert "In 4 of 4 concentric or eccentric trials" in done.stdout
    assert "with a longer dwell_s it would be" in done.stdout


def test_negative_force_is_reported(made: tuple[Path, dict[str, object]], tmp_path: Path) -> None:
    """The vented muscle pushes in every loop; a unit with a tendon never does."""
    (said,) = [remark for remark in made[1]["remarks"] if "force is negative" in remark]  # type: ignore[attr-defined]
    assert said.startswith("In 4 of 4 trials a force is negative (minimum -1")
    assert said.endswith("A tendon would be slack.")
    done = run("step", "klute-3-4-pair", "--step", "1", "--out", "t", cwd=tmp_path)
    assert "negative" not in done.stdout


def test_creep_slope_has_its_unit(tmp_path: Path) -> None:
    assert "[% per decade]" in run("creep", "--step", "10", "--out", "c", cwd=tmp_path).stdout


def test_protocols_are_listed_and_printed(tmp_path: Path) -> None:
    listed = run(cwd=tmp_path).stdout
    assert listed == run("--list", cwd=tmp_path).stdout
    assert all(name in listed for name in protocols_library.list_protocols())
    assert {row["name"] for row in json.loads(run("--json", cwd=tmp_path).stdout)} == set(
        protocols_library.list_protocols()
    )
    printed = run("workloop", "--toml", cwd=tmp_path).stdout
    assert printed.encode() == protocols_library.read_protocol_bytes("workloop")
    assert tomllib.loads(printed)["velocities_mm_per_s"] == [1, 50, 100, 200]
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["stretch"], "no protocol 'stretch': give the path of a protocol file"),
        ([""], "the name of the protocol is empty"),
        (["step", "klute-9"], "no device 'klute-9'"),
        (["step", "--step", "20"], "step is 20 ms; allowed: above 0, up to 10 ms"),
        (["isokinetic-unit", "klute-3-4"], "unit length runs from 298.0 to 322.0 mm; allowed for 'klute-3-4'"),
        (["--toml"], "--toml needs a protocol"),
        (["klute-3-4"], "'klute-3-4' is a device: name a protocol before it (klute-sim bench PROTOCOL klute-3-4)"),
        (["/dev/zero"], "protocol file /dev/zero cannot be read: it is a device; give a regular file"),
        (["step", "/dev/zero"], "device file /dev/zero cannot be read: it is a device; give a regular file"),
        (["step", "isometric"], "'isometric' is a protocol where a device is expected"),
        (["step", "--list"], "--list takes no protocol"),
        (["step", "--toml", "--json"], "--toml and --json exclude each other"),
    ],
)
def test_invalid_input_gives_one_sentence_and_no_files(arguments: list[str], says: str, tmp_path: Path) -> None:
    done = run(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "runs").exists()
