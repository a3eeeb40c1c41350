"""``klute-sim compare`` end to end."""

import csv
import json
import os
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from klute_sim.controllers import parse
from klute_sim.device.device import DEFAULT_DEVICE, load_device
from klute_sim.gait.rig.rig import simulate_gait
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.recording import csv as text
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording
from klute_sim.viewer.folders import ensure_recording
from tests.command_line import run, run_in_subprocess

NUMBERS = {"bands.parquet", "comparison.csv", "comparison.json"}
REPORT = {"index.html", "comparison.png"}


@pytest.fixture(scope="module")
def gait_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two strides with the tuned profile, two without pressure, and the first as a measurement without provenance."""
    folder = tmp_path_factory.mktemp("gait_runs")
    for name, controller in (("profile", "profile"), ("off", "off")):
        recording = simulate_gait(
            load_device(DEFAULT_DEVICE), parse.parse_controller(controller), GaitOptions(strides=2, dt=1e-3)
        )
        (folder / name).mkdir()
        parquet.write_recording(recording, folder / name / "recording.parquet")
    recording = parquet.load_recording(folder / "profile" / "recording.parquet")
    channels = {n: recording[n] for n in ("time", "gait_phase", "ankle_angle", "cop_x", "ankle_x")}
    text.write(Recording(channels, {n: recording.units[n] for n in channels}), folder / "measured.csv")
    return folder


@pytest.fixture(scope="module")
def compared(gait_runs: Path) -> tuple[Path, dict[str, Any]]:
    process = run("compare", "profile", "off", "--reference", "--json", cwd=gait_runs)
    assert process.returncode == 0, process.stderr
    return gait_runs, json.loads(process.stdout)


def get_difference(summary: dict[str, Any], channel: str, label: str) -> dict[str, Any]:
    (part,) = summary["parts"]
    (row,) = [row for row in part["channels"] if row["channel"] == channel]
    return next(d for d in row["differences"] if d["series"] == label)


def test_run_folder_is_complete(compared: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = compared
    run_folder = folder / summary["run"]
    assert run_folder == folder / "runs" / "compare-001"
    expected = NUMBERS | REPORT | ({"comparison.rrd"} if find_spec("rerun") else set())
    assert {file.name for file in run_folder.iterdir()} == expected == set(summary["files"])
    assert json.loads((run_folder / "comparison.json").read_text()) == summary
    assert (run_folder / "comparison.png").read_bytes().startswith(b"\x89PNG")


def test_numbers_match_recordings(compared: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = compared
    assert (summary["domain"], summary["baseline"]) == ("phase", "profile")
    assert [(s["label"], s["repeats"]) for s in summary["series"]] == [
        ("profile", [1]),
        ("off", [1]),
        ("human", [None]),
    ]
    assert summary["series"][1]["controllers"] == ["constant 0 bar"]
    strides = {}
    for name in ("profile", "off"):
        recording = parquet.load_recording(folder / name / "recording.parquet")
        strides[name] = recording.select(recording["stride"] == 2)
    # A stride has 1100 samples, so every eleventh is at an integer percentage.
    pressure_difference = (strides["off"]["pressure"] - strides["profile"]["pressure"])[::11]
    d = get_difference(summary, "pressure", "off")
    assert d["max_difference"] == pytest.approx(pressure_difference.min(), rel=1e-9)
    assert d["max_position"] == int(pressure_difference.argmin())
    assert d["rms"] == pytest.approx(np.sqrt(np.mean(pressure_difference**2)), rel=0.01)
    assert d["band"] == "none"
    assert get_difference(summary, "ankle_angle", "human")["band"] == "reference"
    assert 0.5 < get_difference(summary, "cop_x", "off")["compared_fraction"] < 0.75
    table = pq.read_table(folder / summary["run"] / "bands.parquet").to_pylist()
    angle = [row["mean"] for row in table if (row["series"], row["channel"]) == ("profile", "ankle_angle")]
    assert angle[:100] == pytest.approx(strides["profile"]["ankle_angle"][::11], rel=1e-9)
    rows = list(csv.DictReader((folder / summary["run"] / "comparison.csv").open()))
    assert {row["channel"] for row in rows} >= {"ankle_angle", "pressure"}


def test_equal_recordings_have_zero_difference(gait_runs: Path) -> None:
    process = run(
        "compare", "profile", "profile", "m=measured.csv", "--skip", "1", "--no-report", "--json", cwd=gait_runs
    )
    assert process.returncode == 0, process.stderr
    summary = json.loads(process.stdout)
    assert [s["label"] for s in summary["series"]] == ["profile", "profile (2)", "m"]
    for channel in summary["parts"][0]["channels"]:
        for d in channel["differences"]:
            assert (d["rms"], d["bias"], d["half_interval"], d["regions"]) == (0.0, 0.0, None, []), channel["channel"]
            assert d["correlation"] in (1.0, None)
    assert {file.name for file in (gait_runs / summary["run"]).iterdir()} == NUMBERS
    assert any("'profile' has channels that 'm' lacks" in remark for remark in summary["remarks"])


def test_table_explains_channels_and_units(gait_runs: Path, tmp_path: Path) -> None:
    out = tmp_path / "c"
    process = run(
        "compare", "a=profile", "b=off", "--out", str(out), "--channel", "ankle_moment", "--no-report", cwd=gait_runs
    )
    assert process.returncode == 0, process.stderr
    assert process.stdout.startswith("'b' differs most from 'a' in ankle moment: rms ")
    assert "b (1 stride) minus a (1 stride): size" in process.stdout
    assert "ankle moment [N·m]" in process.stdout
    assert "pressure" not in process.stdout
    assert "No band: there are neither repeats nor a known s" in process.stdout
    assert f"Run folder: {out}" in process.stdout


def test_recordings_are_compared_over_time(gait_runs: Path) -> None:
    process = run(
        "compare", "profile", "off", "--over", "time", "--channel", "pressure", "--no-report", "--json", cwd=gait_runs
    )
    summary = json.loads(process.stdout)
    (part,) = summary["parts"]
    assert summary["axis_unit"] == "s"
    assert (part["begin"], part["points"]) == (0.0, 2200)
    assert part["end"] == pytest.approx(2.199)


def test_labels_are_escaped(gait_runs: Path, tmp_path: Path) -> None:
    for label in ("<script>alert(1)</script>", "_$x^2$ [b]bold[/b]"):
        out = tmp_path / str(len(label))
        process = run(
            "compare", f"{label}=profile", "off", "--out", str(out), "--channel", "ankle_angle", cwd=gait_runs
        )
        assert process.returncode == 0, process.stderr
        assert process.stderr == ""
        assert label in process.stdout
        page = (out / "index.html").read_text()
        assert "<script" not in page
        assert "default-src 'none'" in page
    assert "_$x^2$ [b]bold[/b]" in page


def test_bench_runs_are_compared_by_trial(tmp_path: Path) -> None:
    time = np.arange(200) / 100.0
    for run_, names in (("one", ("slow", "fast", "odd")), ("two", ("fast", "slow"))):
        (tmp_path / run_).mkdir()
        for number, name in enumerate(names):
            force = 10.0 * (run_ == "two" and name == "fast") * (time > 1.5) + number
            columns = [("time [s]", time), ("force [N]", np.sin(time) + 0.0 * number + force - number)]
            parquet.write_recording(Recording.from_columns(columns), tmp_path / run_ / f"{name}.parquet")
    process = run("compare", "one", "two", "--out", "c", "--json", cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    summary = json.loads(process.stdout)
    found = {part["name"]: part["channels"][0]["differences"][0] for part in summary["parts"]}
    assert sorted(found) == ["fast", "slow"]
    assert found["slow"]["rms"] == pytest.approx(0.0, abs=1e-12)
    assert found["fast"]["max_difference"] == pytest.approx(10.0)
    assert found["fast"]["half_interval"] == pytest.approx([1.51, 1.75], abs=0.02)
    assert summary["remarks"] == ["Trials of 'one' that the other runs lack are excluded: odd."]
    assert {"fast.png", "slow.png"} < set(summary["files"])
    assert (tmp_path / "c" / "index.html").read_text().count("data:image/png") == 2


def test_rerun_recording_contains_curves(compared: tuple[Path, dict[str, Any]]) -> None:
    rr = pytest.importorskip("rerun")
    folder, summary = compared
    file = folder / summary["run"] / "comparison.rrd"
    chunks = {str(c.entity_path).lstrip("/"): c for c in rr.chunk.RrdReader(file).stream() if not c.is_static}

    def read(entity: str) -> np.ndarray:
        batch = chunks[entity].to_record_batch()
        assert batch.column("gait_cycle_percent").to_pylist() == list(range(101))
        (name,) = [n for n in batch.schema.names if n.endswith("Scalars:scalars")]
        return np.array([value for (value,) in batch.column(name).to_pylist()])

    table = pq.read_table(folder / summary["run"] / "bands.parquet").to_pylist()
    for number, label in enumerate(("profile", "off", "human")):
        rows = [r for r in table if (r["series"], r["channel"]) == (label, "ankle_angle")]
        assert read(f"part_1/ankle_angle/curves/series_{number}/mean").tolist() == [r["mean"] for r in rows]
    sd = np.array([r["sd"] for r in rows])
    high, low = (read(f"part_1/ankle_angle/curves/series_2/{side}") for side in ("high", "low"))
    assert high - low == pytest.approx(2.0 * sd)
    assert "part_1/pressure/difference/series_1/mean" in chunks
    assert len(list(rr.chunk.RrdReader(file).blueprints())) == 1
    with ensure_recording(file.parent) as found:
        assert found == file
    assert 'href="comparison.rrd"' in (file.parent / "index.html").read_text()


@pytest.mark.slow
def test_missing_rerun_is_reported(gait_runs: Path, tmp_path: Path) -> None:
    (tmp_path / "rerun").mkdir()
    (tmp_path / "rerun" / "__init__.py").write_text("raise ImportError('not here')")
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    out = str(tmp_path / "c")
    process = run_in_subprocess(
        "compare", "profile", "off", "--channel", "pressure", "--out", out, cwd=gait_runs, PYTHONPATH=paths
    )
    assert process.returncode == 0, process.stderr
    assert "No comparison.rrd" in process.stderr
    assert "pip install '.[rerun]'" in process.stderr
    assert {file.name for file in (tmp_path / "c").iterdir()} == NUMBERS | REPORT


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "Missing argument"),
        (["profile"], "'profile' has only one stride: there is nothing to compare it with"),
        (["profile", "none"], "none does not exist"),
        (["profile", "bad.csv"], "trial file bad.csv"),
        (["profile", "full"], "full is not a run folder"),
        (["profile", "off", "--channel", "nobody"], "unknown channel 'nobody'; allowed: "),
        (["profile", "off", "--over", "space"], "'space' is not one of"),
        (["profile", "off", "--baseline", "nobody"], "unknown baseline 'nobody'; allowed labels: profile, off"),
        (["profile", "off", "--skip", "2"], "leaves none"),
        (["profile", "off", "--skip", "-1"], "not in the range"),
        (
            ["profile", "off", "--over", "time", "--reference"],
            "compared over time, as --over says: leave out --reference",
        ),
        (["profile", "", "--reference"], "the path of the run '' is empty"),
        (["profile", "off", "--out", "full"], "output folder full is not empty"),
        (["profile", "off", "--out", "bad.csv"], "is a file"),
    ],
)
def test_invalid_input_raises_one_sentence_and_leaves_nothing(
    arguments: list[str], message: str, gait_runs: Path
) -> None:
    (gait_runs / "bad.csv").write_text("time [s],force [N]\n1,two\n")
    (gait_runs / "full").mkdir(exist_ok=True)
    (gait_runs / "full" / "x").touch()
    before = sorted(gait_runs.rglob("*"))
    process = run("compare", *arguments, cwd=gait_runs)
    assert process.returncode == 2
    assert message in process.stderr
    assert len(process.stderr.strip().splitlines()) == 1
    assert process.stdout == ""
    assert sorted(gait_runs.rglob("*")) == before
