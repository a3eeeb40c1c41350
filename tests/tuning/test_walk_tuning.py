"""Tuning in predicted walks: design variables, objective, recovery of a known optimum, and files."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import klute_sim as ks
from klute_sim.controllers.state_machine import StateMachine, load_default_state_machine, load_state_machine
from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.parameter_sweep.evaluate import CaseResult, MetricValue
from klute_sim.parameter_sweep.runner import ResultCallback
from klute_sim.parameter_sweep.store import open_store
from klute_sim.parameter_sweep.walk_metrics import WALK_METRIC_COLUMNS
from klute_sim.parameter_sweep.walk_plan import WalkCase
from klute_sim.tuning.design_variables import compute_violation
from klute_sim.tuning.machine_variables import MachineSpace
from klute_sim.tuning.search import optimize, select_best
from klute_sim.tuning.walk_objective import (
    WALK_FALL_COST,
    WalkWeights,
    compute_walk_cost,
    make_walk_weights,
    summarize_walks,
)
from klute_sim.tuning.walk_problem import WalkTuningProblem
from klute_sim.viewer.layouts import one_objective as layout
from klute_sim.walker.reflexes.walker_file import load_walker

pytest.importorskip("cma")
DEVICE, MACHINE = load_device("klute-1-1-4-pair"), load_default_state_machine()
WALKERS = (load_walker("machine-1"), load_walker("machine-2"))
WALKED: dict[str, MetricValue] = {
    **dict.fromkeys(WALK_METRIC_COLUMNS, 1.0),
    **{"duration [s]": 10.0, "speed [m/s]": 1.25, "step_asymmetry [1]": 0.0, "fell": False, "acute": True},
    **{"cost_minetti [J/kg/m]": 4.0, "cost_bhargava [J/kg/m]": 3.0},
}


def make_problem(keys: tuple[str, ...] = ("push_off_bar", "lean_deg"), **options: Any) -> WalkTuningProblem:
    return WalkTuningProblem(space=MachineSpace(DEVICE, MACHINE, keys), walkers=WALKERS, **options)


class KnownOptimum:
    """Walks whose cost is least at 3.9 bar and 16 degrees, and that fall below 3.5 bar."""

    def run(self, cases: Iterable[WalkCase], on_result: ResultCallback) -> None:
        for case in cases:
            machine = case.controller
            assert isinstance(machine, StateMachine)
            cost = 4.0 + (machine.push_off_bar - 3.9) ** 2 + 0.05 * (machine.lean_deg - 16.0) ** 2
            costs = {"cost_minetti [J/kg/m]": cost, "cost_bhargava [J/kg/m]": cost}
            on_result(case, CaseResult({**WALKED, **costs, "fell": machine.push_off_bar < 3.5}))


def test_search_finds_a_known_optimum(tmp_path: Path) -> None:
    problem = make_problem()
    evaluations = optimize(
        problem, 150, open_store(tmp_path / "s", problem.describe(), "tune-walk"), KnownOptimum().run
    )
    best = select_best(evaluations)
    machine = problem.space.decode(best.x)[1]
    assert machine.push_off_bar == pytest.approx(3.9, abs=0.05)
    assert machine.lean_deg == pytest.approx(16.0, abs=0.3)
    assert best.cost == pytest.approx(4.0, abs=0.01)
    falls = [evaluation for evaluation in evaluations if evaluation.metrics and evaluation.metrics.n_falls]
    assert all(evaluation.cost >= WALK_FALL_COST for evaluation in falls)


def test_initial_point_is_the_given_machine_and_device() -> None:
    space = MachineSpace(DEVICE, MACHINE, device_keys=("tendon.stiffness_1_n_per_mm",))
    device, machine = space.decode(np.zeros(len(space.variables)))
    assert machine == MACHINE
    value = device.spec.collect_values()["tendon.stiffness_1_n_per_mm"]
    assert value == DEVICE.spec.collect_values()["tendon.stiffness_1_n_per_mm"]
    high = space.decode(np.full(len(space.variables), 100.0))[1]
    assert high.push_off_bar == 5.0  # the supply pressure
    assert compute_violation(space.variables, np.full(len(space.variables), 100.0)) > 0.0


def test_cost_grows_with_effort_speed_error_asymmetry_and_early_falls() -> None:
    weights = WalkWeights()

    def compute(**changes: MetricValue) -> float:
        names = {"asymmetry": "step_asymmetry [1]", "speed": "speed [m/s]", "cost": "cost_minetti [J/kg/m]"}
        metrics = {**WALKED, **{names.get(name, name): value for name, value in changes.items()}}
        return compute_walk_cost(metrics, weights, 1.25, 10.0)

    assert compute() == pytest.approx(3.5)
    assert compute(cost=5.0) == pytest.approx(4.0)
    assert compute(speed=1.26) == pytest.approx(3.5)
    assert compute(speed=1.15) == compute(speed=1.35) == pytest.approx(3.5 + 10.0 * 0.08)
    assert compute(asymmetry=-0.2) == compute(asymmetry=0.2) == pytest.approx(3.5 + 0.4)
    late, early = (compute(fell=True, **{"duration [s]": duration}) for duration in (9.0, 2.0))  # type: ignore[arg-type]
    assert WALK_FALL_COST < late < early < 2.0 * WALK_FALL_COST


def test_means_are_over_the_walks_that_did_not_fall() -> None:
    fall = {**WALKED, "fell": True, "speed [m/s]": None}
    metrics = summarize_walks([WALKED, {**WALKED, "speed [m/s]": 1.35, "step_asymmetry [1]": -0.2}, fall])
    assert (metrics.n_walks, metrics.n_falls) == (3, 1)
    assert metrics.speed == pytest.approx(1.3)
    assert metrics.asymmetry == pytest.approx(0.1)
    assert summarize_walks([fall]).speed is None


def test_every_person_walks_under_every_push_and_longer_at_the_end() -> None:
    problem = make_problem(pushes=((0.0, 0.0), (5.0, 30.0)), seconds=6.0)
    cases = problem.build_cases(np.zeros(2), is_fine=False)
    assert [(case.walker.name, case.push[0], case.seconds) for case in cases] == [
        ("machine-1", 0.0, 6.0),
        ("machine-1", 5.0, 6.0),
        ("machine-2", 0.0, 6.0),
        ("machine-2", 5.0, 6.0),
    ]
    assert {case.seconds for case in problem.build_cases(np.zeros(2), is_fine=True)} == {12.0}


@pytest.mark.slow
@pytest.mark.usefixtures("in_process_runner")
def test_tuning_writes_a_machine_that_walks(tmp_path: Path) -> None:
    options: dict[str, Any] = {"machine_keys": ["push_off_bar", "swing_bar"], "walkers": ["machine-1"], "seconds": 5.0}
    result = ks.tune_walk(budget=6, n_jobs=1, folder=tmp_path / "t", **options)
    assert result.best.cost <= result.initial.cost
    assert load_state_machine(result.save() / "tuned.toml") == result.machine
    files = {"walk_evaluations.csv", "tuned.toml", "tuning.json", "figure.png", "index.html"}
    assert files <= {file.name for file in result.folder.iterdir()}
    content = json.loads((result.folder / "tuning.json").read_text())
    assert content["design_variables"]["push_off_bar"]["before"] == 4.4
    assert content["metrics"]["before"]["n_falls"] == 0
    layout.rebuild_recording(result.folder, tmp_path / "view.rrd")
    page = layout.format_page(content)
    assert "| push_off_bar | 4.4 |" in page
    text = str(result)
    for phrase in ("push_off_bar", "0 of 1", "The objective fell by", "Predicted and acute"):
        assert phrase in text
    assert repr(result).startswith("WalkTuningResult(")
    n_cases = len(list((result.folder / "cases").iterdir()))
    ks.tune_walk(budget=6, n_jobs=1, folder=tmp_path / "t", **options)
    assert len(list((result.folder / "cases").iterdir())) == n_cases


@pytest.mark.parametrize(
    ("create", "message"),
    [
        (lambda: MachineSpace(DEVICE, MACHINE, ("push_of_bar",)), "did you mean 'push_off_bar'"),
        (lambda: MachineSpace(DEVICE, MACHINE, device_keys=("tendon.colour",)), "has no number 'tendon.colour'"),
        (lambda: make_problem(speed=9.0), "speed is 9; allowed: 0.4 to 2.5"),
        (lambda: make_problem(seconds=1.0), "duration is 1; allowed: 5 s or more"),
        (lambda: make_problem(unevenness_mm=99.0), "unevenness is 99"),
        (lambda: WalkTuningProblem(space=MachineSpace(DEVICE, MACHINE), walkers=()), "there are no walkers"),
        (
            lambda: WalkTuningProblem(space=MachineSpace(DEVICE, MACHINE), walkers=(load_walker("intact-1"),)),
            "walker intact-1 walks with two legs of flesh",
        ),
        (lambda: make_walk_weights({"joy": 1.0}), "there is no weight 'joy'; allowed: effort, speed, symmetry"),
        (lambda: make_walk_weights({"effort": -1.0}), "weight of effort is -1"),
        (lambda: WalkWeights(effort=0.0, speed=0.0, symmetry=0.0), "all weights are 0"),
    ],
)
def test_invalid_values_are_refused(create: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        create()
