"""``ks.sweep``, ``ks.tune`` and ``ks.simulate_baselines`` from Python: results, summaries, figures and files."""

from pathlib import Path

import pytest

import klute_sim as ks
from klute_sim.parameter_sweep.store import RESULTS_FOLDER
from klute_sim.report.sweep.figure import GAIT_METRICS
from tests.gait.reference_files import write_reference_folder
from tests.report.figure_checks import check_figure

pytestmark = pytest.mark.usefixtures("in_process_runner")


@pytest.mark.slow
def test_sweep_returns_rows_and_resumes_in_its_folder(tmp_path: Path) -> None:
    reports: list[tuple[float, str]] = []
    options = {"masses": [60.0, 75.0], "strides": 1, "time_step": 1e-3, "n_jobs": 1, "folder": tmp_path / "s"}
    result = ks.sweep(controllers="off", progress=lambda *report: reports.append(report), **options)
    assert [row["mass [kg]"] for row in result.rows] == [60.0, 75.0]
    assert (result.n_resumed, result.n_failed) == (0, 0)
    assert reports[-1] == (1.0, "simulating")
    assert repr(result) == f"SweepResult(2 cases, 0 failed, folder={str(tmp_path / 's')!r})"
    assert "2 cases" in str(result)
    assert result.plot(over="mass [kg]").axes[0].get_xlabel() == "mass [kg]"
    with pytest.raises(ks.InputError, match="there is no column 'masses'; allowed: device"):
        result.plot(over="masses")
    assert {file.name for file in result.save(with_csv=True).iterdir()} == {
        *("sweep.parquet", "sweep.csv", "sweep.json", "figure.png", "index.html"),
        RESULTS_FOLDER,
    }
    assert ks.sweep(ks.load_device("klute-1-1-4-pair"), controllers=["off"], **options).n_resumed == 2


def test_sweep_with_passive_feet_alone_simulates_no_device(tmp_path: Path) -> None:
    result = ks.sweep(spring_feet=[6.0], strides=1, time_step=1e-3, n_jobs=1, folder=tmp_path / "s")
    assert [row["device"] for row in result.rows] == ["spring foot 6"]


def test_one_reference_stands_for_a_list_of_one(tmp_path: Path) -> None:
    folder = write_reference_folder(tmp_path / "me", mass=62.0, stature=1.66)
    result = ks.sweep(references=str(folder), strides=1, time_step=1e-3, n_jobs=1, folder=tmp_path / "s")
    assert [(row["reference"], row["mass [kg]"]) for row in result.rows] == [(str(folder), 62.0)]


@pytest.mark.slow
def test_tuning_result_has_the_tuned_profile_and_writes_the_files_of_the_command(tmp_path: Path) -> None:
    pytest.importorskip("cma")
    result = ks.tune(budget=1, n_jobs=1, folder=tmp_path / "t")
    assert result.best.cost <= result.initial.cost
    assert result.device.name == "klute-1-1-4-pair"
    assert len(result.profile.pressure_bar) == len(result.problem.space.profile.pressure_bar)
    assert set(result.metrics["peak net power [W/kg]"]) == {"before", "tuned", "human"}
    saved = result.save(tmp_path / "copy")
    assert {"tuned.csv", "tuning.json", "figure.png", "index.html"} <= {file.name for file in saved.iterdir()}
    assert "Search: 1 evaluation, finer repeats of the start and 0 finalists; seed 0." in str(result)
    assert repr(result).startswith("TuningResult(1 evaluations, cost ")


@pytest.mark.slow
def test_baseline_table_has_a_row_per_run(tmp_path: Path) -> None:
    result = ks.simulate_baselines(["spring-foot-6"], strides=1, time_step=1e-3, n_jobs=1, folder=tmp_path / "b")
    assert [row["condition"] for row in result.rows] == ["level", "slower", "faster", "downhill", "uphill"]
    assert repr(result) == f"BaselineTable(1 baselines, 5 runs, folder={str(tmp_path / 'b')!r})"
    assert "5 degrees uphill" in str(result)
    figure = result.plot()
    assert [axis.get_title() for axis in figure.axes] == list(GAIT_METRICS.values())
    check_figure(figure)
    assert [axis.get_title() for axis in result.plot("speed [m/s]").axes] == ["speed [m/s]"]
    with pytest.raises(ks.InputError, match="there is no metric 'work'; allowed: "):
        result.plot("work")
    assert {"table.json", "figure.png", "index.html"} <= {file.name for file in result.save().iterdir()}
