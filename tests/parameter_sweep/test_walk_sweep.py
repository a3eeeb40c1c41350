"""Sweeps of predicted walks: cases, metrics, resumption, table and refusals."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

import klute_sim as ks
from klute_sim.api.sweep import build_machines
from klute_sim.controllers.pressure import create_off_controller
from klute_sim.controllers.state_machine import StateMachine, load_default_state_machine
from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.parameter_sweep.evaluate import evaluate_case
from klute_sim.parameter_sweep.table import WALK_COLUMN_TYPES
from klute_sim.parameter_sweep.walk_metrics import WALK_METRIC_COLUMNS
from klute_sim.parameter_sweep.walk_plan import WalkSweepPlan
from klute_sim.viewer.layouts import sweep as layout
from klute_sim.walker.reflexes.walker_file import load_walker

pytestmark = pytest.mark.usefixtures("in_process_runner")
DEVICE = load_device("klute-1-1-4-pair")


def make_plan(**changes: Any) -> WalkSweepPlan:
    machine = load_default_state_machine()
    options: dict[str, Any] = {"devices": {"a": DEVICE}, "controllers": {"machine": machine}, "seconds": 1.0}
    return WalkSweepPlan(**(options | changes))


def test_walkers_are_those_of_each_prosthesis_and_vary_fastest() -> None:
    plan = make_plan(spring_feet={6.0: DEVICE}, slopes_deg=(0.0, 1.0))
    cases = list(plan.iter_cases())
    adapted = [case for case in cases if not case.is_acute]
    assert {case.walker.condition["prosthesis"] for case in cases if case.foot_stiffness is None} == {"device"}
    assert {case.walker.condition["prosthesis"] for case in cases if case.foot_stiffness is not None} == {"spring-foot"}
    assert [case.slope_deg for case in cases][:2] == [0.0, 0.0]
    assert {case.walker.name for case in adapted} >= {"machine-1", "machine-2", "spring-foot-1"}


def test_metrics_are_those_of_a_single_walk() -> None:
    (case,) = make_plan(walkers=[load_walker("machine-1")], seconds=6.0).iter_cases()
    metrics = evaluate_case(case).metrics
    run = ks.simulate_walk(walker="machine-1", seconds=6.0)
    assert tuple(metrics) == WALK_METRIC_COLUMNS
    assert metrics["speed [m/s]"] == run.outcomes.speed_m_per_s
    assert metrics["cost_bhargava [J/kg/m]"] == run.outcomes.cost_bhargava_j_per_kg_m
    assert metrics["load_peak_left [1]"] == run.outcomes.legs["left"].peak_load_bw
    assert (metrics["fell"], metrics["acute"]) == (False, False)


def test_a_fall_is_an_outcome_and_not_a_failure() -> None:
    off = create_off_controller()
    (case,) = make_plan(controllers={"off": off}, walkers=[load_walker("machine-1")], seconds=20.0).iter_cases()
    result = evaluate_case(case)
    assert result.failure is None
    assert (result.metrics["fell"], result.metrics["acute"]) == (True, True)
    assert float(result.metrics["duration [s]"] or 0.0) < 20.0


def test_key_depends_on_every_input_and_on_no_name() -> None:
    (case,) = make_plan(walkers=[load_walker("machine-1")]).iter_cases()
    changes: list[dict[str, Any]] = [
        {"walker": load_walker("machine-2")},
        {"controller": replace(load_default_state_machine(), lean_deg=15.0)},
        {"foot_stiffness": 8.0},
        {"slope_deg": 1.0},
        {"unevenness_mm": 1.0},
        {"push": (1.0, 0.0)},
        {"seconds": 2.0},
        {"seed": 1},
        {"dt": 5e-4},
        {"software": {**case.software, "mujoco": "0.1"}},
        {"device": load_device("klute-3-4-pair")},
    ]
    keys = {case.key, *(replace(case, **change).key for change in changes)}
    assert len(keys) == 1 + len(changes)
    assert replace(case, device_name="b", controller_name="c").key == case.key


@pytest.mark.slow
def test_sweep_of_walks_resumes_and_writes_its_table(tmp_path: Path) -> None:
    options: dict[str, Any] = {
        **{"machine": {"push_off_bar": [3.4, 4.4], "lean_deg": [14.0]}, "walkers": "machine-1"},
        **{"pushes": [(0.0, 0.0), (5.0, 30.0)], "folder": tmp_path / "s", "seconds": 7.0, "n_jobs": 1},
    }
    result = ks.sweep_walks(**options)
    assert (len(result.rows), result.n_failed, result.n_resumed) == (4, 0, 0)
    assert [row["push_off_pressure [bar]"] for row in result.rows] == [3.4, 3.4, 4.4, 4.4]
    assert [row["push [N*s]"] for row in result.rows] == [0.0, 5.0, 0.0, 5.0]
    assert [row["acute"] for row in result.rows] == [True, True, False, False]
    assert ks.sweep_walks(**options).n_resumed == 4
    text = str(result)
    for phrase in ("4 conditions, 4 walks", "1 of 1", "adapted", "2 of 4 walks the person has not adapted"):
        assert phrase in text
    folder = result.save(with_csv=True)
    table = pq.read_table(folder / "sweep.parquet")
    assert table.column_names == list(WALK_COLUMN_TYPES)
    assert table.to_pylist() == result.rows
    assert result.plot().axes[0].get_xlabel() == "push off pressure [bar]"
    with pytest.raises(InputError, match="there is no column 'mass'"):
        result.plot(over="mass")


def test_viewer_charts_the_cost_over_the_pressure_of_push_off(tmp_path: Path) -> None:
    machine = {"push_off_bar": [3.4, 4.4]}
    result = ks.sweep_walks(machine=machine, walkers="machine-1", folder=tmp_path / "s", seconds=5.0, n_jobs=1)
    charts = layout.build_charts(result.rows)
    assert list(charts) == ["push_off_pressure [bar]"]
    cost = next(chart for chart in charts["push_off_pressure [bar]"] if "Minetti" in chart.y_label)
    assert cost.curves[0].x.tolist() == [3.4, 4.4]
    assert "4.4" in layout.format_page(result.rows)


def test_machines_are_every_combination_of_their_numbers() -> None:
    machines = build_machines({"push_off_bar": [3.0, 4.0], "swing_bar": [0.0, 1.0]})
    assert list(machines)[1] == "machine, push_off_bar 3, swing_bar 1"
    second = list(machines.values())[1]
    assert second == replace(load_default_state_machine(), push_off_bar=3.0, swing_bar=1.0)
    assert isinstance(second, StateMachine)
    assert build_machines({}) == {}
    with pytest.raises(InputError, match=r"has no 'push_of_bar'; did you mean 'push_off_bar'\?"):
        build_machines({"push_of_bar": [3.0]})
    with pytest.raises(InputError, match="push_off_bar of the state machine is 30"):
        build_machines({"push_off_bar": [30.0]})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"walkers": [load_walker("intact-1")]}, "walker intact-1 walks with two legs of flesh"),
        ({"unevennesses_mm": (80.0,)}, "unevenness is 80; allowed: 0 to 50 mm"),
        ({"slopes_deg": (20.0,)}, "slope is 20"),
        ({"seconds": 0.1}, "duration is 0.1"),
        ({"pushes": ((500.0, 0.0),)}, "push is 500"),
        ({"spring_feet": {99.0: DEVICE}}, "stiffness of the spring foot is 99"),
    ],
)
def test_invalid_values_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make_plan(**changes)
