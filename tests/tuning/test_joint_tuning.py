"""Tuning of the controlled joint: design variables, recovery of a known optimum, and files."""

import json
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.device.device import load_device
from klute_sim.envs.joint_pid import DEFAULT_GAINS, PidController
from klute_sim.errors import InputError
from klute_sim.parameter_sweep.evaluate import CaseResult
from klute_sim.parameter_sweep.joint_metrics import JOINT_METRIC_COLUMNS
from klute_sim.parameter_sweep.joint_plan import JointCase
from klute_sim.parameter_sweep.runner import ResultCallback
from klute_sim.parameter_sweep.store import open_store
from klute_sim.tuning.gain_variables import GainSpace
from klute_sim.tuning.joint_problem import JointTuningProblem, JointWeights, make_joint_weights
from klute_sim.tuning.point_evaluation import INVALID_COST
from klute_sim.tuning.search import optimize, select_best
from klute_sim.viewer.layouts import one_objective as layout

pytest.importorskip("cma")
DEVICE = load_device("klute-3-4-pair")


def run_known_optimum(cases: Iterable[JointCase], on_result: ResultCallback) -> None:
    """Report an error of the angle that is least at a proportional gain of 9 and a mean action of 0.2."""
    for case in cases:
        error = 1.0 + np.log(case.gains["proportional"] / 9.0) ** 2 + 4.0 * (case.gains["mean"] - 0.2) ** 2
        metrics = {**dict.fromkeys(JOINT_METRIC_COLUMNS, 0.0), "angle_error_rms [deg]": float(error)}
        on_result(case, CaseResult(metrics))


def test_search_finds_a_known_optimum(tmp_path: Path) -> None:
    problem = JointTuningProblem(space=GainSpace(DEVICE, gain_keys=("proportional", "mean")))
    store = open_store(tmp_path / "s", problem.describe(), "tune-joint")
    best = select_best(optimize(problem, 150, store, run_known_optimum))
    gains = problem.space.decode(best.x)[1]
    assert gains["proportional"] == pytest.approx(9.0, rel=0.05)
    assert gains["mean"] == pytest.approx(0.2, abs=0.05)
    assert gains["integral"] == DEFAULT_GAINS["integral"]
    assert best.cost == pytest.approx(1.0, abs=0.01)


def test_initial_point_is_the_given_controller_and_device() -> None:
    space = GainSpace(DEVICE, {**DEFAULT_GAINS, "proportional": 7.0}, device_keys=("tendon.stiffness_1_n_per_mm",))
    device, gains = space.decode(np.zeros(len(space.variables)))
    assert gains == {**DEFAULT_GAINS, "proportional": 7.0}
    assert device.spec.collect_values() == DEVICE.spec.collect_values()
    high = space.decode(np.full(len(space.variables), 100.0))[1]
    assert high["proportional"] == 210.0
    assert high["mean"] == 0.9


def test_cost_is_error_and_change_of_actions_and_failures_cost_most() -> None:
    problem = JointTuningProblem(space=GainSpace(DEVICE), weights=JointWeights(angle=2.0, smoothness=10.0))
    metrics = {**dict.fromkeys(JOINT_METRIC_COLUMNS, 0.0), "angle_error_rms [deg]": 1.5, "action_change_rms [1]": 0.1}
    x = np.zeros(4)
    assert problem.make_evaluation(x, [CaseResult(metrics)], 0).cost == pytest.approx(4.0)
    failed = problem.make_evaluation(x, [CaseResult({}, "it diverges")], 0)
    assert (failed.cost, failed.metrics, failed.failure) == (INVALID_COST, None, "it diverges")
    assert problem.build_cases(x, is_fine=True)[0].episodes == 2 * problem.build_cases(x, is_fine=False)[0].episodes


@pytest.mark.slow
@pytest.mark.usefixtures("in_process_runner")
def test_tuning_writes_gains_that_control_the_joint(tmp_path: Path) -> None:
    options: dict[str, Any] = {"gain_keys": ["proportional", "integral"], "episodes": 1, "seconds": 0.5, "load": 2.0}
    result = ks.tune_joint(budget=6, n_jobs=1, folder=tmp_path / "t", **options)
    assert result.best.cost <= result.initial.cost
    written = tomllib.loads((result.save() / "tuned.toml").read_text())
    assert written == pytest.approx(result.gains)
    assert vars(PidController(**written))["proportional"] == pytest.approx(result.gains["proportional"])
    files = {"joint_evaluations.csv", "tuned.toml", "tuning.json", "figure.png", "index.html"}
    assert files <= {file.name for file in result.folder.iterdir()}
    content = json.loads((result.folder / "tuning.json").read_text())
    assert content["design_variables"]["proportional"]["before"] == DEFAULT_GAINS["proportional"]
    assert content["metrics"]["tuned"]["angle_error_rms [deg]"] > 0.0
    layout.rebuild_recording(result.folder, tmp_path / "view.rrd")
    assert "| proportional | 4 |" in layout.format_page(content)
    text = str(result)
    for phrase in ("angle_error_rms", "proportional", "The objective fell by", "2 episodes of 0.5 s"):
        assert phrase in text
    assert repr(result).startswith("JointTuningResult(")
    n_cases = len(list((result.folder / "cases").iterdir()))
    ks.tune_joint(budget=6, n_jobs=1, folder=tmp_path / "t", **options)
    assert len(list((result.folder / "cases").iterdir())) == n_cases


@pytest.mark.parametrize(
    ("create", "message"),
    [
        (lambda: GainSpace(DEVICE, gain_keys=("proportionl",)), "did you mean 'proportional'"),
        (lambda: GainSpace(DEVICE, {**DEFAULT_GAINS, "integral": 0.0}), "the gain integral is 0; a tuned gain must be"),
        (lambda: GainSpace(DEVICE, {**DEFAULT_GAINS, "mean": 2.0}), "the mean action is 2"),
        (lambda: GainSpace(DEVICE, device_keys=("tendon.colour",)), "has no number 'tendon.colour'"),
        (lambda: JointTuningProblem(space=GainSpace(DEVICE), episodes=600), "the number of episodes is 1200"),
        (lambda: JointTuningProblem(space=GainSpace(DEVICE), load_kg=-1.0), "load is -1 kg"),
        (lambda: make_joint_weights({"joy": 1.0}), "there is no weight 'joy'; allowed: angle, smoothness"),
        (lambda: make_joint_weights({"angle": -1.0}), "weight of angle is -1"),
        (lambda: JointWeights(angle=0.0, smoothness=0.0), "all weights are 0"),
    ],
)
def test_invalid_values_are_refused(create: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        create()
