"""``klute-sim bench joint``, ``mass`` and ``knee`` end to end, as a user types them."""

import csv
import json
import re
from pathlib import Path

import pytest

from klute_sim.recording import parquet
from tests import command_line as command

QUICK = ("--step", "2")


def test_run_folder_holds_all_files(tmp_path: Path) -> None:
    changes = (
        "--set",
        "model.geom.load.mass=1.5",
        "--device",
        "flexor=klute-3-4-pair",
        "--device",
        "extensor=klute-1-2",
    )
    done = command.run("bench", "joint", "steps", *changes, *QUICK, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    folder = tmp_path / summary["run"]
    assert summary["devices"] == {"flexor": "klute-3-4-pair", "extensor": "klute-1-2"}
    assert {*summary["files"]} == {path.name for path in folder.iterdir() if not path.name.startswith(".")}
    rows = list(csv.DictReader((folder / "results.csv").read_text().splitlines()))
    assert [row["trial"] for row in rows] == [trial["name"] for trial in summary["trials"]]
    recording = parquet.load_recording(folder / f"{rows[0]['trial']}.parquet")
    assert recording["angle_joint"][-1] != recording["angle_joint"][0]
    assert 'mass="1.5"' in (folder / "model.xml").read_text()


@pytest.mark.slow
def test_measured_frequency_response_is_compared_as_documented(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "mechanisms.md").read_text("utf-8")
    (text,) = re.findall(r"^```text\n(frequency \[Hz\].*?)^```", page, re.MULTILINE | re.DOTALL)
    (line,) = re.findall(r"^klute-sim (bench joint sines --response.*)$", page, re.MULTILINE)
    (tmp_path / "bode.csv").write_text(text)
    done = command.run(*line.split(), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "times the simulated one" in done.stdout
    assert "ms of dead time" in done.stdout or "later than the measurement" in done.stdout
    summary = json.loads((tmp_path / "bode" / "summary.json").read_text())
    assert summary["response"]["points"] == len(summary["trials"]) == 3
    assert "response.csv" in summary["files"]
    refused = command.run("bench", "joint", "--response", "bode.csv", cwd=tmp_path)
    assert refused.returncode == 2
    assert "is compared with the test 'sines', not with 'steps'" in refused.stderr


@pytest.mark.parametrize(("word", "joint"), [("mass", "guide"), ("knee", "knee")])
def test_other_mechanisms_have_words_of_their_own(word: str, joint: str, tmp_path: Path) -> None:
    done = command.run("bench", word, "quick-release", "klute-1-1-4-pair", *QUICK, "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["joint"] == joint


def test_lists(tmp_path: Path) -> None:
    tests = command.run("bench", "joint", "--list", cwd=tmp_path)
    assert "co-contraction" in tests.stdout
    numbers = command.run("bench", "joint", "--numbers", "--json", cwd=tmp_path)
    assert json.loads(numbers.stdout)["model.joint.joint.damping"] == 0.05
    assert "bench joint" in command.run("bench", "joint", "--help", cwd=tmp_path).stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--set", "model.geom.load.mass"), "has no name and value"),
        (("--set", "model.geom.load.mass=x"), "is not a number"),
        (("steps", "klute-3-4", "--device", "flexor=klute-3-4"), "exclude each other"),
        (("--model", "missing.xml"), "no model 'missing.xml'"),
    ],
)
def test_mistakes_end_in_one_sentence(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    done = command.run("bench", "joint", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert not (tmp_path / "runs").exists()
