"""``klute-sim tune`` end to end with few short evaluations."""

import json
from pathlib import Path

import pytest

from klute_sim.controllers.pressure import load_profile
from klute_sim.device.device import load_device
from klute_sim.parameter_sweep.store import RESULTS_FOLDER
from klute_sim.viewer.layouts.tuning import EVALUATIONS_FILE
from tests.command_line import run

pytest.importorskip("cma")


def test_few_evaluations_reduce_the_objective_and_the_search_can_be_resumed(tmp_path: Path) -> None:
    done = run("tune", "--budget", "14", "--also", "tendon.stiffness_1_n_per_mm", "--out", "t", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    output = json.loads(done.stdout)
    assert output["cost"]["tuned"] < output["cost"]["before"]
    assert output["evaluations"] >= 14
    assert output["files"] == sorted(["device.toml", EVALUATIONS_FILE, "tuned.csv", "tuning.json", "tuning.png"])
    assert {file.name for file in (tmp_path / "t").iterdir()} == {*output["files"], "tune.json", RESULTS_FOLDER}
    variables = output["design_variables"]
    pressures = [variable["tuned"] for name, variable in variables.items() if name.startswith("pressure at")]
    assert sorted(load_profile(tmp_path / "t" / "tuned.csv").pressure_bar) == pytest.approx(sorted(pressures), abs=1e-4)
    device = load_device(tmp_path / "t" / "device.toml")
    tuned = device.spec.collect_values()["tendon.stiffness_1_n_per_mm"]
    assert tuned == pytest.approx(variables["tendon.stiffness_1_n_per_mm"]["tuned"], rel=1e-4)
    assert device.spec.sources["tendon.stiffness_1_n_per_mm"].startswith("assumed: found by klute-sim tune")
    rows = {row["name"]: row for row in output["table"]}
    for row in rows.values():
        assert row["before"] != row["tuned"]
    squares = [
        sum(rows[f"{name} to human, stance rms [sd]"][side] ** 2 for name in ("moment", "angle", "power"))
        for side in ("before", "tuned")
    ]
    assert squares[1] < squares[0]
    assert rows["peak net power [W/kg]"]["human"] == pytest.approx(3.29, abs=0.02)
    n_results = len(list((tmp_path / "t" / RESULTS_FOLDER).iterdir()))
    resumed = run("tune", "--budget", "14", "--also", "tendon.stiffness_1_n_per_mm", "--out", "t", cwd=tmp_path)
    assert resumed.returncode == 0, resumed.stderr
    assert len(list((tmp_path / "t" / RESULTS_FOLDER).iterdir())) == n_results
    assert "The objective fell by" in resumed.stdout
    assert "peak plantarflexion [deg]" in resumed.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--weight", "air"], "--weight is 'air'; allowed: a term and a number, such as air=0.5"),
        (["--weight", "oil=1"], "the objective has no term 'oil' to weight"),
        (["--also", "damper.colour"], "has no number 'damper.colour'"),
        (["--profile", "none.csv"], "pressure profile none.csv cannot be read"),
        (["--device", "nobody"], "no device 'nobody'"),
        (["--device", "klute-3-4"], "its file has no [tendon] section"),
        (
            ["--weight", "moment=0", "--weight", "angle=0", "--weight", "power=0", "--weight", "air=0"],
            "all weights are 0",
        ),
        (["--mass", "7"], "mass is 7; allowed: 20 to 250 kg"),
        (["--budget", "0"], "0"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_no_file(arguments: list[str], message: str, tmp_path: Path) -> None:
    done = run("tune", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
