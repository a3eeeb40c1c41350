"""``klute-sim compare`` end to end, as a user types it."""

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
from tests.command_line import apart, run

NUMBERS = {"bands.parquet", "comparison.csv", "comparison.json"}
REPORT = {"comparison.html", "comparison.png"}


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two strides with the tuned profile, two without pressure, and the first as a measurement without provenance."""
    folder = tmp_path_factory.mktemp("walks")
    for name, controller in (("profile", "profile"), ("off", "off")):
        made = simulate_gait(
            load_device(DEFAULT_DEVICE), parse.parse_controller(controller), GaitOptions(strides=2, dt=1e-3)
        )
        (folder / name).mkdir()
        parquet.write(made, folder / name / "recording.parquet")
    made = parquet.read(folder / "profile" / "recording.parquet")
    kept = {n: made[n] for n in ("time", "gait_phase", "ankle_angle", "cop_x", "ankle_x")}
    text.write(Recording(kept, {n: made.units[n] for n in kept}), folder / "measured.csv")
    return folder


@pytest.fixture(scope="module")
def compared(walks: Path) -> tuple[Path, dict[str, Any]]:
    done = run("compare", "profile", "off", "--reference", "--json", cwd=walks)
    assert done.returncode == 0, done.stderr
    return walks, json.loads(done.stdout)


def difference(told: dict[str, Any], channel: str, label: str) -> dict[str, Any]:
    (part,) = told["parts"]
    (own,) = [row for row in part["channels"] if row["channel"] == channel]
    return next(d for d in own["differences"] if d["series"] == label)


def test_everything_is_in_the_run_folder(compared: tuple[Path, dict[str, Any]]) -> None:
    folder, told = compared
    made = folder / told["run"]
    assert made == folder / "runs" / "compare-001"
    wanted = NUMBERS | REPORT | ({"comparison.rrd"} if find_spec("rerun") else set())
    assert {file.name for file in made.iterdir()} == wanted == set(told["files"])
    assert json.loads((made / "comparison.json").read_text()) == told
    assert (made / "comparison.png").read_bytes().startswith(b"\x89PNG")


def test_numbers_are_those_of_the_recordings(compared: tuple[Path, dict[str, Any]]) -> None:
    folder, told = compared
    assert (told["over"], told["first"]) == ("phase", "profile")
    assert [(s["label"], s["repeats"]) for s in told["series"]] == [("profile", [1]), ("off", [1]), ("human", [None])]
    assert told["series"][1]["controllers"] == ["constant 0 bar"]
    strides = {}
    for name in ("profile", "off"):
        recording = parquet.read(folder / name / "recording.parquet")
        strides[name] = recording.select(recording["stride"] == 2)
    # 1100 samples a stride: every eleventh is at a whole percent.
    apart_ = (strides["off"]["pressure"] - strides["profile"]["pressure"])[::11]
    d = difference(told, "pressure", "off")
    assert d["largest"] == pytest.approx(apart_.min(), rel=1e-9)
    assert d["at"] == int(apart_.argmin())
    assert d["rms"] == pytest.approx(np.sqrt(np.mean(apart_**2)), rel=0.01)
    assert d["band"] == "none"
    assert difference(told, "ankle_angle", "human")["band"] == "reference"
    assert 0.5 < difference(told, "cop_x", "off")["share_compared"] < 0.75
    table = pq.read_table(folder / told["run"] / "bands.parquet").to_pylist()
    angle = [row["mean"] for row in table if (row["series"], row["channel"]) == ("profile", "ankle_angle")]
    assert angle[:100] == pytest.approx(strides["profile"]["ankle_angle"][::11], rel=1e-9)
    rows = list(csv.DictReader((folder / told["run"] / "comparison.csv").open()))
    assert {row["channel"] for row in rows} >= {"ankle_angle", "pressure"}


def test_a_run_against_itself_and_its_measurement(walks: Path) -> None:
    done = run("compare", "profile", "profile", "m=measured.csv", "--skip", "1", "--no-report", "--json", cwd=walks)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert [s["label"] for s in told["series"]] == ["profile", "profile (2)", "m"]
    for channel in told["parts"][0]["channels"]:
        for d in channel["differences"]:
            assert (d["rms"], d["bias"], d["half"], d["regions"]) == (0.0, 0.0, None, []), channel["channel"]
            assert d["correlation"] in (1.0, None)
    assert {file.name for file in (walks / told["run"]).iterdir()} == NUMBERS
    assert any("'profile' has channels that 'm' lacks" in remark for remark in told["remarks"])


def test_the_table_names_channels_units_and_how_to_read_it(walks: Path, tmp_path: Path) -> None:
    out = tmp_path / "c"
    done = run(
        "compare", "a=profile", "b=off", "--out", str(out), "--channel", "ankle_moment", "--no-report", cwd=walks
    )
    assert done.returncode == 0, done.stderr
    assert "b (1 stride) against a (1 stride)" in done.stdout
    assert "ankle moment [N·m]" in done.stdout
    assert "pressure" not in done.stdout
    assert "No band: where nothing is repeated" in done.stdout
    assert f"Run folder: {out}" in done.stdout


def test_over_time_the_whole_recordings_are_compared(walks: Path) -> None:
    done = run(
        "compare", "profile", "off", "--over", "time", "--channel", "pressure", "--no-report", "--json", cwd=walks
    )
    told = json.loads(done.stdout)
    (part,) = told["parts"]
    assert told["axis_unit"] == "s"
    assert (part["begin"], part["points"]) == (0.0, 2200)
    assert part["end"] == pytest.approx(2.199)


def test_names_in_the_data_are_escaped_and_shown_as_they_are(walks: Path, tmp_path: Path) -> None:
    for label in ("<script>alert(1)</script>", "_$x^2$ [b]bold[/b]"):
        out = tmp_path / str(len(label))
        done = run("compare", f"{label}=profile", "off", "--out", str(out), "--channel", "ankle_angle", cwd=walks)
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""
        assert label in done.stdout
        page = (out / "comparison.html").read_text()
        assert "<script" not in page
        assert "default-src 'none'" in page
    assert "_$x^2$ [b]bold[/b]" in page


def test_a_bench_run_is_compared_trial_by_trial(tmp_path: Path) -> None:
    time = np.arange(200) / 100.0
    for run_, names in (("one", ("slow", "fast", "odd")), ("two", ("fast", "slow"))):
        (tmp_path / run_).mkdir()
        for number, name in enumerate(names):
            force = 10.0 * (run_ == "two" and name == "fast") * (time > 1.5) + number
            columns = [("time [s]", time), ("force [N]", np.sin(time) + 0.0 * number + force - number)]
            parquet.write(Recording.from_columns(columns), tmp_path / run_ / f"{name}.parquet")
    done = run("compare", "one", "two", "--out", "c", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    found = {part["name"]: part["channels"][0]["differences"][0] for part in told["parts"]}
    assert sorted(found) == ["fast", "slow"]
    assert found["slow"]["rms"] == pytest.approx(0.0, abs=1e-12)
    assert found["fast"]["largest"] == pytest.approx(10.0)
    assert found["fast"]["half"] == pytest.approx([1.51, 1.75], abs=0.02)
    assert told["remarks"] == ["Trials of 'one' that not all have are left out: odd."]
    assert {"fast.png", "slow.png"} < set(told["files"])
    assert (tmp_path / "c" / "comparison.html").read_text().count("data:image/png") == 2


def test_the_rerun_recording_holds_the_curves(compared: tuple[Path, dict[str, Any]]) -> None:
    rr = pytest.importorskip("rerun")
    folder, told = compared
    file = folder / told["run"] / "comparison.rrd"
    chunks = {str(c.entity_path).lstrip("/"): c for c in rr.chunk.RrdReader(file).stream() if not c.is_static}

    def read(entity: str) -> np.ndarray:
        batch = chunks[entity].to_record_batch()
        assert batch.column("gait_cycle_percent").to_pylist() == list(range(101))
        (name,) = [n for n in batch.schema.names if n.endswith("Scalars:scalars")]
        return np.array([value for (value,) in batch.column(name).to_pylist()])

    table = pq.read_table(folder / told["run"] / "bands.parquet").to_pylist()
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
    assert 'href="comparison.rrd"' in (file.parent / "comparison.html").read_text()


def test_without_rerun_everything_else_is_written_and_the_extra_is_named(walks: Path, tmp_path: Path) -> None:
    (tmp_path / "rerun").mkdir()
    (tmp_path / "rerun" / "__init__.py").write_text("raise ImportError('not here')")
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    out = str(tmp_path / "c")
    done = apart("compare", "profile", "off", "--channel", "pressure", "--out", out, cwd=walks, PYTHONPATH=paths)
    assert done.returncode == 0, done.stderr
    assert "No comparison.rrd" in done.stderr
    assert "pip install '.[rerun]'" in done.stderr
    assert {file.name for file in (tmp_path / "c").iterdir()} == NUMBERS | REPORT


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "Missing argument"),
        (["profile"], "nothing to compare 'profile' with"),
        (["profile", "none"], "no run none"),
        (["profile", "bad.csv"], "trial file bad.csv"),
        (["profile", "full"], "full is no run folder"),
        (["profile", "off", "--channel", "nobody"], "no channel 'nobody'; there are"),
        (["profile", "off", "--over", "space"], "'space' is not one of"),
        (["profile", "off", "--to", "nobody"], "no series is called 'nobody'; allowed: profile, off"),
        (["profile", "off", "--skip", "2"], "leaves none"),
        (["profile", "off", "--skip", "-1"], "not in the range"),
        (["profile", "off", "--over", "time", "--reference"], "--reference is for strides"),
        (["profile", "", "--reference"], "the path of the run '' is empty"),
        (["profile", "off", "--out", "full"], "output folder full is not empty"),
        (["profile", "off", "--out", "bad.csv"], "is a file"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(arguments: list[str], says: str, walks: Path) -> None:
    (walks / "bad.csv").write_text("time [s],force [N]\n1,two\n")
    (walks / "full").mkdir(exist_ok=True)
    (walks / "full" / "x").touch()
    before = sorted(walks.rglob("*"))
    done = run("compare", *arguments, cwd=walks)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""
    assert sorted(walks.rglob("*")) == before
