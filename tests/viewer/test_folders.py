"""What is shown of every kind of folder is what is in its files."""

import csv
import json
import os
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


def shown(folder: Path) -> RrdContents:
    with folders.ensure_recording(folder) as file:
        return rrd_reader.read_rrd(file)


def values(found: RrdContents, entity: str) -> np.ndarray:
    return np.array([row[0] for row in found.entities[entity].rows["scalars"]])


def text(found: RrdContents, entity: str) -> str:
    return str(found.entities[entity].static["text"][0])


def names(found: RrdContents) -> list[str]:
    return [view.name for view in rrd_reader.iter_views(found.root)]


def every_view_has_something(found: RrdContents) -> bool:
    return all(view.select_entities(found.entities) for view in rrd_reader.iter_views(found.root))


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("bench")
    done = run("bench", "isokinetic", "--out", "run", "--step", "2", cwd=home)
    assert done.returncode == 0, done.stderr
    return home / "run"


def test_a_bench_run_shows_its_trials_and_readings(bench: Path) -> None:
    found = shown(bench)
    assert (bench / "recording.rrd").is_file()
    told = json.loads((bench / "summary.json").read_text())["trials"]
    tabs = [child.name for child in found.root.children]  # type: ignore[union-attr]
    assert tabs[0] == "all trials"
    assert tabs[1] == told[0]["name"]
    assert tabs[-1] == told[-1]["name"]
    assert every_view_has_something(found)
    kept = parquet.read(bench / f"{told[-1]['name']}.parquet")
    here = f"trial_{len(told):03d}"
    assert np.array_equal(values(found, f"{here}/pressure"), kept["pressure"])
    assert np.array_equal(values(found, f"{here}/channels/delivered_power"), kept["delivered_power"])
    assert found.entities[f"{here}/pressure"].get_times("time") == pytest.approx(kept["time"], abs=2e-9)
    line = next(line for line in text(found, "readings").splitlines() if told[0]["name"] in line)
    assert f"{told[0]['readings']['force_n']:.4g}" in line
    curves = [path for path in found.entities if path.startswith("every/curve_")]
    assert len(curves) == len(told)


def training(folder: Path, *, finished: bool) -> dict[str, Any]:
    folder.mkdir()
    rows = [[0.1 * k, 100 * k, 4, 50.0 + k, 90.0] for k in range(1, 6)]
    with (folder / "learning_curve.csv").open("w", newline="") as file:
        csv.writer(file).writerows([LEARNING_CURVE_COLUMNS, *rows])
    summary = {"algorithm": "ppo", "seed": 3, "steps": 500, "minutes": 0.5, "better_in": 2, "episodes": 3}
    summary |= {"gain": 1.5, "gain_standard_error": 0.2, "policy": {"return": 61.0}, "profile": {"return": 59.5}}
    if finished:
        (folder / "summary.json").write_text(json.dumps(summary))
    return summary


def test_a_training_shows_its_curve_and_what_it_came_to(tmp_path: Path) -> None:
    training(tmp_path / "done", finished=True)
    found = shown(tmp_path / "done")
    assert values(found, "curve/episode_return").tolist() == [51.0, 52.0, 53.0, 54.0, 55.0]
    assert found.entities["curve/episode_return"].get_times("steps").tolist() == [100, 200, 300, 400, 500]
    assert set(values(found, "evaluated/profile")) == {59.5}
    assert "| return | 61 | 59.5 |" in text(found, "summary")
    training(tmp_path / "going", finished=False)
    going = shown(tmp_path / "going")
    assert "evaluated/profile" not in going.entities
    assert text(going, "summary").startswith("# Training, not finished\n\n500 steps in 0.5 minutes")


def test_a_long_training_is_shown_whole() -> None:
    """The viewer alone would show a thousand steps before and after the cursor."""
    window = training_view.build_blueprint(8000).root_container
    curves = window.contents[0].contents
    for plot in (curves[0], *curves[1].contents):
        assert plot.properties["TimeAxis"].view_range.as_arrow_array().to_pylist() == [{"start": 0, "end": 8000}]


def tuning(folder: Path) -> None:
    folder.mkdir()
    knots = {"gait_pct": [0.0, 50.0], "pressure_bar": [1.0, 4.0]}
    (folder / "tune.json").write_text(json.dumps({"profile": {"kind": "profile", "name": "own", **knots}}))
    (folder / "tuned.csv").write_text("gait_pct,pressure_bar\n0,1.5\n50,3\n")
    (folder / "tried.csv").write_text(
        "walk,generation,cost,tracking_sd2,air_g\n0,0,2.0,1.8,1.5\n1,1,1e12,,\n2,1,3.0,2.5,1.4\n3,2,1.0,0.9,1.6\n"
    )
    table = [{"name": "air in a stride [g]", "before": 1.5, "tuned": 1.6, "human": None}]
    told = {"cost": {"before": 2.0, "tuned": 1.0}, "walks": 4, "seed": 7, "table": table, "remarks": ["Take care."]}
    told |= {"knobs": {"timing [%]": {"before": 0.0, "tuned": -1.5}}, "front": [{"air_g": 1.6, "tracking_sd2": 0.9}]}
    (folder / "tuning.json").write_text(json.dumps(told))


def test_a_tuning_shows_the_objective_and_leaves_out_what_did_not_walk(tmp_path: Path) -> None:
    tuning(tmp_path / "t")
    found = shown(tmp_path / "t")
    assert values(found, "objective/each") == pytest.approx([2.0, np.nan, 3.0, 1.0], nan_ok=True)
    assert values(found, "objective/least").tolist() == [2.0, 2.0, 2.0, 1.0]
    assert found.entities["objective/each"].get_times("generation").tolist() == [0, 1, 1, 2]
    told = text(found, "result")
    assert told.startswith("# The objective fell by 50 % in 4 walks (seed 7)\n\n1 of them")
    assert "| timing [%] | 0 | -1.5 |" in told
    assert every_view_has_something(found)


def row(controller: str, mass: float, power: float | None) -> dict[str, Any]:
    return {
        **{"device": "d", "device_sha256": "0", "controller": controller, "speed_asked [m/s]": None},
        **{"slope [deg]": 0.0, "mass [kg]": mass, "strides [1]": 2, "step [s]": 1e-3, "speed [m/s]": 1.2},
        **dict.fromkeys(sweep.CHARTED_METRICS, power),
        "failure": "it fell" if power is None else None,
    }


def test_a_sweep_shows_each_outcome_over_what_was_varied(tmp_path: Path) -> None:
    rows = [row("profile", 90.0, 2.0), row("profile", 60.0, 3.0), row("off", 60.0, 1.0), row("off", 90.0, None)]
    pq.write_table(pa.Table.from_pylist(rows), tmp_path / "sweep.parquet")
    drawn = sweep.build_charts(rows)
    assert list(drawn) == ["mass [kg]"]
    assert len(drawn["mass [kg]"]) == len(sweep.CHARTED_METRICS)
    profile = next(
        curve for curve in drawn["mass [kg]"][0].curves if curve.name == "profile" and not curve.markers_only
    )
    assert (profile.x.tolist(), profile.y.tolist()) == ([60.0, 90.0], [3.0, 2.0])
    assert list(sweep.build_charts(rows[1:3])) == ["row of the table"]
    found = shown(tmp_path)
    assert names(found)[-1] == "table"
    assert "| 4 | off | 90 | 1.2 | - | - |" in text(found, "table")
    assert "it fell" in text(found, "table")
    assert every_view_has_something(found)


def test_a_recording_is_made_anew_when_its_folder_has_gone_on(tmp_path: Path) -> None:
    folder = tmp_path / "t"
    training(folder, finished=False)
    assert "not finished" in text(shown(folder), "summary")
    made = (folder / "training.rrd").stat().st_mtime_ns
    shown(folder)
    assert (folder / "training.rrd").stat().st_mtime_ns == made
    (folder / "summary.json").write_text(json.dumps(training(tmp_path / "other", finished=True)))
    os.utime(folder / "summary.json", ns=(made + 10**9, made + 10**9))
    assert "PPO, seed 3" in text(shown(folder), "summary")


def test_a_folder_that_cannot_be_written_to_is_left_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "t"
    training(folder, finished=True)
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert "PPO" in text(shown(folder), "summary")
    assert not (folder / "training.rrd").exists()


@pytest.mark.parametrize(
    ("files", "says"),
    [
        ({}, "no folder that can be viewed; those are: gait run"),
        ({"reference.toml": "", "reference.csv": ""}, "is a reference, which has no view; .* 'klute-sim compare"),
        ({"comparison.json": "{}"}, r"has no comparison\.rrd: the comparison was made without"),
        ({"verdict.json": "{}"}, r"has no recording\.rrd: the diagnosis was made without"),
        ({"sweep.json": "{}"}, r"a sweep without sweep\.parquet: let the command"),
        ({"tune.json": "{}"}, r"a tuning without tried\.csv: let the command"),
        ({"recording.parquet": "nonsense"}, r"recording\.parquet cannot be read"),
        ({"protocol.toml": "", "summary.json": "{}"}, "a bench run that cannot be shown: KeyError: 'trials'"),
        ({"learning_curve.csv": "minutes,steps,episodes,episode_return,episode_steps\n"}, "no learning curve yet"),
        ({"sweep.parquet": "nonsense"}, "a sweep that cannot be shown"),
    ],
)
def test_what_cannot_be_shown_is_one_sentence(files: dict[str, str], says: str, tmp_path: Path) -> None:
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=says), folders.ensure_recording(tmp_path):
        pass
    assert {file.name for file in tmp_path.iterdir()} == set(files)


def test_what_is_no_folder_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "a.txt").touch()
    for name, says in (("none", "no run folder"), ("a.txt", r"is no \.rrd file")):
        with pytest.raises(InputError, match=says), folders.ensure_recording(tmp_path / name):
            pass


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-17.3, 4.2), (3.21e-5, 3.29e-5), (1e6, 5e6)])
def test_ticks_are_round_few_and_inside(low: float, high: float) -> None:
    found = chart.compute_ticks(low, high)
    assert 3 <= len(found) <= 7
    assert low <= found[0] < found[-1] <= high
    assert len({chart.format_tick(value, found) for value in found}) == len(found) or high < 1e-4
