"""Recordings of all kinds of folders show the content of their files."""

import csv
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from klute_sim.errors import InputError
from klute_sim.recording import parquet
from klute_sim.training.training import LEARNING_CURVE_COLUMNS
from klute_sim.viewer import chart, folders
from klute_sim.viewer.layouts import sweep
from klute_sim.viewer.layouts import training as training_view
from klute_sim.viewer.picture import rrd_reader
from klute_sim.viewer.picture.rrd_reader import RrdContents
from tests.command_line import run

pytest.importorskip("rerun")


def read_recording(folder: Path) -> RrdContents:
    with folders.ensure_recording(folder) as file:
        return rrd_reader.read_rrd(file)


def get_values(contents: RrdContents, entity: str) -> np.ndarray:
    return np.array([row[0] for row in contents.entities[entity].rows["scalars"]])


def get_text(contents: RrdContents, entity: str) -> str:
    return str(contents.entities[entity].static["text"][0])


def get_view_names(contents: RrdContents) -> list[str]:
    return [view.name for view in rrd_reader.iter_views(contents.root)]


def has_no_empty_view(contents: RrdContents) -> bool:
    return all(view.select_entities(contents.entities) for view in rrd_reader.iter_views(contents.root))


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("bench")
    completed = run("bench", "isokinetic", "--out", "run", "--step", "2", cwd=home)
    assert completed.returncode == 0, completed.stderr
    return home / "run"


def test_bench_run_shows_its_trials_and_metrics(bench: Path) -> None:
    contents = read_recording(bench)
    assert (bench / "recording.rrd").is_file()
    trials = json.loads((bench / "summary.json").read_text())["trials"]
    tabs = [child.name for child in contents.root.children]  # type: ignore[union-attr]
    assert tabs[0] == "all trials"
    assert tabs[1] == trials[0]["name"]
    assert tabs[-1] == trials[-1]["name"]
    assert has_no_empty_view(contents)
    channels = parquet.load_recording(bench / f"{trials[-1]['name']}.parquet")
    prefix = f"trial_{len(trials):03d}"
    assert np.array_equal(get_values(contents, f"{prefix}/pressure"), channels["pressure"])
    assert np.array_equal(get_values(contents, f"{prefix}/channels/delivered_power"), channels["delivered_power"])
    assert contents.entities[f"{prefix}/pressure"].get_times("time") == pytest.approx(channels["time"], abs=2e-9)
    line = next(line for line in get_text(contents, "metrics").splitlines() if trials[0]["name"] in line)
    assert f"{trials[0]['metrics']['force_n']:.4g}" in line
    curves = [path for path in contents.entities if path.startswith("all_trials/curve_")]
    assert len(curves) == len(trials)


def write_training(folder: Path, *, finished: bool) -> dict[str, Any]:
    folder.mkdir()
    rows = [[0.1 * k, 100 * k, 4, 50.0 + k, 90.0] for k in range(1, 6)]
    with (folder / "learning_curve.csv").open("w", newline="") as file:
        csv.writer(file).writerows([LEARNING_CURVE_COLUMNS, *rows])
    summary = {"algorithm": "ppo", "seed": 3, "steps": 500, "minutes": 0.5, "n_better_episodes": 2, "episodes": 3}
    summary |= {"gain": 1.5, "gain_standard_error": 0.2, "policy": {"return": 61.0}}
    summary |= {"baseline_name": "hand-tuned profile", "baseline": {"return": 59.5}}
    if finished:
        (folder / "summary.json").write_text(json.dumps(summary))
    return summary


def test_training_shows_learning_curve_and_result(tmp_path: Path) -> None:
    write_training(tmp_path / "done", finished=True)
    contents = read_recording(tmp_path / "done")
    assert get_values(contents, "curve/episode_return").tolist() == [51.0, 52.0, 53.0, 54.0, 55.0]
    assert contents.entities["curve/episode_return"].get_times("steps").tolist() == [100, 200, 300, 400, 500]
    assert set(get_values(contents, "evaluated/baseline")) == {59.5}
    assert "| return | 61 | 59.5 |" in get_text(contents, "summary")
    write_training(tmp_path / "unfinished", finished=False)
    unfinished = read_recording(tmp_path / "unfinished")
    assert "evaluated/baseline" not in unfinished.entities
    assert get_text(unfinished, "summary").startswith("# Training, not finished\n\n500 steps in 0.5 minutes")


def test_plots_of_a_training_cover_all_steps() -> None:
    """By default, the viewer shows a thousand steps before and after the cursor."""
    window = training_view.build_blueprint(8000).root_container
    curves = window.contents[0].contents
    for plot in (curves[0], *curves[1].contents):
        assert plot.properties["TimeAxis"].view_range.as_arrow_array().to_pylist() == [{"start": 0, "end": 8000}]


def write_tuning(folder: Path) -> None:
    folder.mkdir()
    knots = {"gait_pct": [0.0, 50.0], "pressure_bar": [1.0, 4.0]}
    (folder / "tune.json").write_text(json.dumps({"profile": {"kind": "profile", "name": "own", **knots}}))
    (folder / "tuned.csv").write_text("gait_pct,pressure_bar\n0,1.5\n50,3\n")
    (folder / "evaluations.csv").write_text(
        "evaluation,generation,cost,tracking_sd2,air_g\n0,0,2.0,1.8,1.5\n1,1,1e12,,\n2,1,3.0,2.5,1.4\n3,2,1.0,0.9,1.6\n"
    )
    table = [{"name": "air per stride [g]", "before": 1.5, "tuned": 1.6, "human": None}]
    result = {
        "cost": {"before": 2.0, "tuned": 1.0},
        "evaluations": 4,
        "seed": 7,
        "table": table,
        "remarks": ["A remark."],
    }
    result |= {
        "design_variables": {"timing [%]": {"before": 0.0, "tuned": -1.5}},
        "front": [{"air_g": 1.6, "tracking_sd2": 0.9}],
    }
    (folder / "tuning.json").write_text(json.dumps(result))


def test_tuning_shows_the_objective_without_invalid_evaluations(tmp_path: Path) -> None:
    write_tuning(tmp_path / "t")
    contents = read_recording(tmp_path / "t")
    assert get_values(contents, "objective/all") == pytest.approx([2.0, np.nan, 3.0, 1.0], nan_ok=True)
    assert get_values(contents, "objective/minimum").tolist() == [2.0, 2.0, 2.0, 1.0]
    assert contents.entities["objective/all"].get_times("generation").tolist() == [0, 1, 1, 2]
    page = get_text(contents, "result")
    assert page.startswith("# The objective fell by 50 % in 4 evaluations (seed 7)\n\n1 of them")
    assert "| timing [%] | 0 | -1.5 |" in page
    assert has_no_empty_view(contents)


def make_row(controller: str, mass: float, power: float | None, reference: str = "able-bodied") -> dict[str, Any]:
    return {
        **{"device": "d", "device_sha256": "0", "controller": controller, "reference": reference},
        "speed_requested [m/s]": None,
        **{"slope [deg]": 0.0, "mass [kg]": mass, "strides [1]": 2, "time_step [s]": 1e-3, "speed [m/s]": 1.2},
        **dict.fromkeys(sweep.CHARTED_METRICS, power),
        "failure": "it fell" if power is None else None,
    }


def test_sweep_over_subjects_has_a_curve_over_their_masses() -> None:
    subjects = [("anna", 58.0, 2.0), ("ben", 81.0, 3.0), ("cleo", 70.0, 2.5)]
    rows = [make_row("profile", mass, power, name) for name, mass, power in subjects]
    assert sweep.find_varied_inputs(rows) == ["reference", "mass [kg]"]
    curve = next(curve for curve in sweep.build_charts(rows)["mass [kg]"][0].curves if not curve.markers_only)
    assert (curve.x.tolist(), curve.y.tolist()) == ([58.0, 70.0, 81.0], [2.0, 2.5, 3.0])
    crossed = [make_row("profile", mass, 1.0, name) for name in ("anna", "ben") for mass in (60.0, 80.0)]
    names = {curve.name for curve in sweep.build_charts(crossed)["mass [kg]"][0].curves}
    assert names == {"anna", "ben"}


def test_sweep_shows_each_metric_over_the_varied_input(tmp_path: Path) -> None:
    rows = [
        make_row("profile", 90.0, 2.0),
        make_row("profile", 60.0, 3.0),
        make_row("off", 60.0, 1.0),
        make_row("off", 90.0, None),
    ]
    pq.write_table(pa.Table.from_pylist(rows), tmp_path / "sweep.parquet")
    charts = sweep.build_charts(rows)
    assert list(charts) == ["mass [kg]"]
    assert len(charts["mass [kg]"]) == len(sweep.CHARTED_METRICS)
    profile = next(
        curve for curve in charts["mass [kg]"][0].curves if curve.name == "profile" and not curve.markers_only
    )
    assert (profile.x.tolist(), profile.y.tolist()) == ([60.0, 90.0], [3.0, 2.0])
    assert list(sweep.build_charts(rows[1:3])) == ["row of the table"]
    contents = read_recording(tmp_path)
    assert get_view_names(contents)[-1] == "table"
    assert "| 4 | off | 90 | 1.2 | - | - |" in get_text(contents, "table")
    assert "it fell" in get_text(contents, "table")
    assert has_no_empty_view(contents)


def test_outdated_recording_is_rebuilt(tmp_path: Path) -> None:
    folder = tmp_path / "t"
    write_training(folder, finished=False)
    assert "not finished" in get_text(read_recording(folder), "summary")
    modified = (folder / "training.rrd").stat().st_mtime_ns
    read_recording(folder)
    assert (folder / "training.rrd").stat().st_mtime_ns == modified
    (folder / "summary.json").write_text(json.dumps(write_training(tmp_path / "other", finished=True)))
    os.utime(folder / "summary.json", ns=(modified + 10**9, modified + 10**9))
    assert "PPO, seed 3" in get_text(read_recording(folder), "summary")


def test_read_only_folder_is_not_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "t"
    write_training(folder, finished=True)
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert "PPO" in get_text(read_recording(folder), "summary")
    assert not (folder / "training.rrd").exists()


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({}, "it is not a folder of results; allowed: walk"),
        ({"reference.toml": "", "reference.csv": ""}, "is a gait reference, which has no view; .* 'klute-sim compare"),
        ({"assessment.json": ""}, "is an assessment, which has no view; open .* in a browser"),
        ({"comparison.json": "{}"}, r"has no comparison\.rrd: the comparison was written without"),
        ({"verdict.json": "{}"}, r"has no recording\.rrd: the diagnosis was written without"),
        ({"sweep.json": "{}"}, r"an unfinished sweep \(no sweep\.parquet\)"),
        ({"tune.json": "{}"}, r"an unfinished tuning \(no evaluations\.csv\)"),
        ({"recording.parquet": "nonsense"}, r"recording\.parquet is not a Parquet file"),
        ({"protocol.toml": "", "summary.json": "{}"}, "cannot view the bench run .*: KeyError: 'trials'"),
        ({"learning_curve.csv": "minutes,steps,episodes,episode_return,episode_steps\n"}, "no learning curve yet"),
        ({"sweep.parquet": "nonsense"}, r"sweep\.parquet is not a Parquet file"),
    ],
)
def test_unsupported_folder_is_refused_in_one_sentence(files: dict[str, str], message: str, tmp_path: Path) -> None:
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=message), folders.ensure_recording(tmp_path):
        pass
    assert {file.name for file in tmp_path.iterdir()} == set(files)


@pytest.mark.parametrize(("word", "channel"), [("joint", "angle_joint"), ("mass", "position_guide")])
def test_joint_run_shows_position_and_devices(word: str, channel: str, tmp_path: Path) -> None:
    completed = run("bench", word, "quick-release", "klute-1-1-4-pair", "--out", "run", "--step", "2", cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    contents = read_recording(tmp_path / "run")
    assert has_no_empty_view(contents)
    recording = parquet.load_recording(tmp_path / "run" / "release_50pct.parquet")
    assert np.array_equal(get_values(contents, f"trial_001/{channel}"), recording[channel])
    assert "overshoot" in get_text(contents, "metrics")


def test_summary_of_the_wrong_type_is_refused_in_one_sentence(bench: Path, tmp_path: Path) -> None:
    """A number in place of a table has no items: an AttributeError."""
    folder = shutil.copytree(bench, tmp_path / "run", ignore=shutil.ignore_patterns("*.rrd"))
    summary = json.loads((folder / "summary.json").read_text())
    (folder / "summary.json").write_text(json.dumps({**summary, "assumptions": 3}))
    with pytest.raises(InputError, match=r"cannot view the bench run .*: AttributeError"):
        read_recording(folder)


def test_missing_folder_is_refused_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "a.txt").touch()
    for name, message in (("none", "does not exist"), ("a.txt", r"neither a folder nor an \.rrd file")):
        with pytest.raises(InputError, match=message), folders.ensure_recording(tmp_path / name):
            pass


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-17.3, 4.2), (3.21e-5, 3.29e-5), (1e6, 5e6)])
def test_ticks_are_round_few_and_inside_the_range(low: float, high: float) -> None:
    ticks = chart.compute_ticks(low, high)
    assert 3 <= len(ticks) <= 7
    assert low <= ticks[0] < ticks[-1] <= high
    assert len({chart.format_tick(value, ticks) for value in ticks}) == len(ticks) or high < 1e-4


@pytest.mark.parametrize("level", [0.25, 383.0, -40.0, 0.0])
def test_constant_quantity_has_an_axis(level: float) -> None:
    """A clamped length differs by rounding errors only; the axis shows its level, with ticks that differ."""
    values = level * (1.0 + np.array([0.0, 1.0, 0.0]) * np.finfo(float).eps)
    line = chart.ChartCurve("measured", (0, 0, 0), values, np.array([0.0, 1.0, 2.0]))
    low, high = chart._compute_ranges(chart.Chart("loop", "length [mm]", "force [N]", (line,)))[0]
    assert low < level < high
    ticks = chart.compute_ticks(low, high)
    assert len({chart.format_tick(value, ticks) for value in ticks}) == len(ticks) > 1
