"""Tuning: design variables, objective, and the search on problems with known solutions."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from klute_sim.controllers.pressure import PressureProfile, load_default_profile
from klute_sim.device.device import Device, load_device
from klute_sim.errors import InputError, KluteSimError
from klute_sim.parameter_sweep.evaluate import METRIC_COLUMNS, CaseResult
from klute_sim.parameter_sweep.plan import GaitCase
from klute_sim.parameter_sweep.runner import ResultCallback
from klute_sim.report.tuning.text import format_causes, format_change, format_search_size
from klute_sim.tuning.design_variables import DEFAULT_DEVICE_KEYS, DesignSpace, compute_violation
from klute_sim.tuning.objective import (
    FALL_COST,
    HUMAN_GOALS,
    TOE_CATCH_COST,
    Goals,
    TuningMetrics,
    Weights,
    compute_cost,
    compute_terms,
    compute_tracking_error,
    make_weights,
)
from klute_sim.tuning.results import open_tuning_store
from klute_sim.tuning.search import (
    FINE_DT,
    Evaluation,
    TuningProblem,
    optimize,
    reevaluate,
    select_best,
    select_metrics,
    select_pareto_front,
)

pytest.importorskip("cma")
PAIR = load_device("klute-1-1-4-pair")
HUMAN_MOMENT_PEAK_NM_PER_KG = 1.432
METRICS = TuningMetrics(
    moment_sd=0.7,
    angle_sd=0.3,
    power_sd=1.0,
    air_g=1.5,
    moment_peak_ratio=1.04,
    power_w_per_kg=2.66,
    work_j_per_kg=0.21,
    plantarflexion_deg=14.0,
    muscle_ratio_max=0.975,
    load_tracking_rms_bw=0.03,
    loading_rate_bw_per_s=20.0,
    braking_bw=-0.18,
    toe_clearance_mm=9.0,
    trips=False,
)


def make_metrics(**values: float) -> TuningMetrics:
    return TuningMetrics(**{**METRICS.__dict__, **values})  # type: ignore[arg-type]


def test_objective_adds_distances_air_penalties_and_shortfall() -> None:
    assert compute_tracking_error(METRICS, Weights()) == pytest.approx(0.49 + 0.09 + 1.0)
    assert compute_cost(METRICS, Weights(), Goals()) == pytest.approx(1.58 + 0.15)
    assert compute_cost(METRICS, Weights(moment=2.0, air=1.0), Goals()) == pytest.approx(1.58 + 0.49 + 1.5)
    assert compute_cost(make_metrics(trips=True), Weights(), Goals()) == pytest.approx(1.73 + TOE_CATCH_COST)
    # At any weights a toe catch costs more than the worst gait without one, and a failure costs more than both.
    worst = make_metrics(
        moment_sd=30.0,
        angle_sd=30.0,
        power_sd=30.0,
        air_g=50.0,
        moment_peak_ratio=10.0,
        muscle_ratio_max=1.2,
        load_tracking_rms_bw=1.0,
        loading_rate_bw_per_s=500.0,
        braking_bw=-1.0,
        toe_clearance_mm=-50.0,
    )
    assert compute_cost(worst, Weights(moment=1e3, angle=1e3, power=1e3, air=1e3), HUMAN_GOALS) < TOE_CATCH_COST
    assert (
        TOE_CATCH_COST + compute_cost(worst, Weights(moment=1e3, angle=1e3, power=1e3, air=1e3), HUMAN_GOALS)
        < FALL_COST
    )
    assert compute_cost(make_metrics(muscle_ratio_max=0.995), Weights(), Goals()) == pytest.approx(1.73 + 1e4 * 0.01**2)
    for ratio in (1.15, 0.85):
        assert compute_cost(make_metrics(moment_peak_ratio=ratio), Weights(), Goals()) == pytest.approx(1.73 + 49.0)
    assert compute_cost(make_metrics(toe_clearance_mm=1.0), Weights(), Goals()) == pytest.approx(1.73 + 2.0**2)
    assert compute_cost(make_metrics(load_tracking_rms_bw=0.06), Weights(), Goals()) == pytest.approx(
        1.73 + 3e3 * 0.02**2
    )
    assert compute_cost(make_metrics(loading_rate_bw_per_s=35.0), Weights(), Goals()) == pytest.approx(1.73 + 1.0)
    assert compute_cost(make_metrics(braking_bw=-0.25), Weights(), Goals()) == pytest.approx(1.73 + 1e3 * 0.03**2)
    shortfall = 0.31 / 0.2 + 0.65 / 0.5 + 0.008 / 0.03 + 1.0 / 1.5
    assert compute_cost(METRICS, Weights(), HUMAN_GOALS) == pytest.approx(1.73 + shortfall)
    reaching = make_metrics(moment_sd=0.38, power_w_per_kg=3.4, work_j_per_kg=0.22, plantarflexion_deg=15.1)
    assert HUMAN_GOALS.compute_shortfall(reaching) == 0.0


def test_terms_add_up_to_the_objective_and_state_their_limits() -> None:
    metrics = make_metrics(moment_peak_ratio=0.85, toe_clearance_mm=1.0)
    terms = {term.name: term for term in compute_terms(metrics, Weights(), HUMAN_GOALS)}
    assert sum(term.cost for term in terms.values()) == pytest.approx(compute_cost(metrics, Weights(), HUMAN_GOALS))
    peak = terms["the penalty of the peak moment"]
    assert (peak.cost, peak.value, peak.allowed) == (pytest.approx(49.0), pytest.approx(85.0), "92 to 108 %")
    assert {name for name, term in terms.items() if term.is_penalty and term.cost > 0.0} == {
        "the penalty of the peak moment",
        "the penalty of the toe clearance",
    }
    assert "the shortfall from the goals" not in {term.name for term in compute_terms(metrics, Weights(), Goals())}


def make_rows(**costs: tuple[float, float]) -> list[dict[str, Any]]:
    return [{"name": name, "before": before, "tuned": tuned} for name, (before, tuned) in costs.items()]


def test_sentence_names_the_part_that_made_the_objective_fall() -> None:
    rows = make_rows(tracking=(2.0, 2.1), air=(0.15, 0.16), peak=(4.0, 1.4))
    assert format_causes(rows) == ", because peak fell; tracking rose by 5 %"
    assert format_causes(make_rows(tracking=(2.0, 1.0), air=(0.15, 0.16))) == ", because tracking fell"
    assert format_causes(make_rows(tracking=(2.0, 2.0), air=(0.2, 0.1))) == ", because air fell; tracking did not"
    assert format_causes(make_rows(tracking=(2.0, 2.0), air=(0.2, 0.2))) == ""
    assert format_change(2.0, 2.0) == "The objective did not fall"
    assert format_search_size(67, 6, 7, 0) == (
        "Search: 67 evaluations (the start and 6 whole generations of 11), finer repeats of the start and 7 finalists; "
        "seed 0."
    )


def test_invalid_weights_are_refused() -> None:
    assert make_weights({"air": 0.5}) == Weights(air=0.5)
    with pytest.raises(
        InputError, match="the objective has no term 'oil' to weight; allowed: moment, angle, power, air"
    ):
        make_weights({"oil": 1.0})
    with pytest.raises(InputError, match="all weights are 0"):
        make_weights(dict.fromkeys(("moment", "angle", "power", "air"), 0.0))
    for value in (-1.0, math.nan):
        with pytest.raises(InputError, match="weight of air is"):
            make_weights({"air": value})


def test_initial_point_decodes_to_the_initial_device_and_profile() -> None:
    space = DesignSpace(PAIR, load_default_profile(), DEFAULT_DEVICE_KEYS)
    device, profile = space.decode(np.zeros(len(space.variables)))
    assert profile.gait_pct == load_default_profile().gait_pct
    assert profile.pressure_bar == load_default_profile().pressure_bar
    assert device.parameters == PAIR.parameters


def test_decoded_values_stay_within_bounds_and_the_violation_is_measured() -> None:
    space = DesignSpace(PAIR, load_default_profile(), ("damper.bore_mm",))
    far = np.full(len(space.variables), 100.0)
    device, profile = space.decode(far)
    assert max(profile.pressure_bar) == 5.0
    assert device.spec.collect_values()["damper.bore_mm"] == pytest.approx(6.0 * 27.0)
    assert compute_violation(space.variables, far) > 1e3
    assert compute_violation(space.variables, np.zeros(len(far))) == 0.0
    assert (
        DesignSpace(PAIR, load_default_profile(), ("supply.pressure_bar",)).variables[-1].upper
        == PAIR.spec.collect_values()["supply.pressure_bar"]
    )
    lowest = space.decode(-far)[1]
    assert min(lowest.pressure_bar) == 0.0
    for variable in space.variables:
        middle = 0.5 * (variable.initial + variable.upper)
        assert variable.denormalize(variable.normalize(middle)) == pytest.approx(middle)


def test_timing_shifts_the_profile_cyclically() -> None:
    space = DesignSpace(PAIR, load_default_profile())
    x = np.zeros(len(space.variables))
    x[-1] = 1.5  # in units of 2 %
    shifted = space.decode(x)[1]
    phases = np.linspace(0.0, 1.0, 50, endpoint=False)
    assert [shifted.pressure_at(p + 0.03) for p in phases] == pytest.approx(
        [load_default_profile().pressure_at(p) for p in phases]
    )


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("damper.colour", "has no number 'damper.colour'"),
        ("supply.dead_volume_l", "has no number"),
        ("muscle.count", "'muscle.count' is an integer"),
    ],
)
def test_key_that_cannot_be_tuned_is_refused(key: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        DesignSpace(PAIR, load_default_profile(), (key,))


def test_tuned_device_is_renamed_and_its_numbers_are_assumed() -> None:
    space = DesignSpace(PAIR, load_default_profile(), ("tendon.stiffness_1_n_per_mm",))
    x = np.zeros(len(space.variables))
    assert space.decode(x)[0].name == "klute-1-1-4-pair-tuned"
    assert "tendon.stiffness_1_n_per_mm" in space.decode(x)[0].spec.collect_assumptions()
    assert DesignSpace(PAIR, load_default_profile()).decode(x[:-1])[0] is PAIR


def test_profile_above_the_supply_pressure_is_refused() -> None:
    with pytest.raises(InputError, match="commands 9 bar; the supply of 'klute-1-1-4-pair' has 5 bar"):
        DesignSpace(PAIR, PressureProfile("high", (0.0, 50.0), (1.0, 9.0)))


def test_device_without_a_tendon_is_refused_with_the_reason() -> None:
    with pytest.raises(InputError, match=r"no \[tendon\] section"):
        TuningProblem(space=DesignSpace(load_device("klute-3-4"), PressureProfile("flat", (0.0, 50.0), (2.0, 2.0))))


class FailingRunner:
    """Returns fixed metrics; a low first pressure fails, a high one makes the toe catch."""

    METRICS = (
        ("moment_distance [sd]", 0.5),
        ("angle_distance [sd]", 0.3),
        ("power_distance [sd]", 0.2),
        ("air_per_stride [g]", 1.7),
        ("ankle_moment_peak [N*m/kg]", HUMAN_MOMENT_PEAK_NM_PER_KG),
        ("ankle_power_peak [W/kg]", 3.0),
        ("ankle_work_net [J/kg]", 0.2),
        ("ankle_plantarflexion [deg]", 12.0),
        ("muscle_ratio_max [1]", 0.97),
        ("grf_vertical_tracking_rms [1]", 0.03),
        ("loading_rate_max [1/s]", 20.0),
        ("grf_forward_min [1]", -0.18),
        ("toe_clearance [mm]", 9.0),
    )

    def run(self, cases: Iterable[GaitCase], on_result: ResultCallback) -> None:
        for case in cases:
            first = case.controller.describe()["pressure_bar"][0]
            values: dict[str, float | bool | None] = dict.fromkeys(METRIC_COLUMNS, 99.0)
            values |= {**dict(self.METRICS), "trips": first > 2.2}
            on_result(case, CaseResult({}, "it fell") if first < 1.8 else CaseResult(values))


def test_peak_moment_is_compared_with_that_of_the_subject() -> None:
    problem = make_problem()
    assert problem.human_moment_peak == pytest.approx(HUMAN_MOMENT_PEAK_NM_PER_KG, abs=1e-3)
    values = {**dict.fromkeys(METRIC_COLUMNS, 1.0), "ankle_moment_peak [N*m/kg]": 1.2, "trips": False}
    assert select_metrics(values, 1.5).moment_peak_ratio == pytest.approx(0.8)


def test_cost_of_valid_failed_and_toe_catching_evaluations(tmp_path: Path) -> None:
    problem = TuningProblem(space=make_problem().space, weights=Weights(air=0.1), goals=HUMAN_GOALS)
    evaluations = optimize(problem, 60, open_tuning_store(tmp_path / "s", problem), FailingRunner().run)
    cost = 0.25 + 0.09 + 0.04 + 0.17 + 0.11 / 0.2 + 0.31 / 0.5 + 0.018 / 0.03 + 3.0 / 1.5
    failed = [e for e in evaluations if e.metrics is None]
    tripping = [e for e in evaluations if e.metrics is not None and e.metrics.trips]
    valid = [e for e in evaluations if e.metrics is not None and not e.metrics.trips]
    assert failed
    assert tripping
    assert valid
    for evaluation in valid:
        assert evaluation.cost == pytest.approx(cost + compute_violation(problem.space.variables, evaluation.x))
    assert all(e.cost >= FALL_COST and e.failure == "it fell" for e in failed)
    assert all(TOE_CATCH_COST <= e.cost < FALL_COST for e in tripping)
    assert select_best(evaluations) in valid
    assert {id(e) for e in select_pareto_front(evaluations)} <= {id(e) for e in valid}
    assert any(
        compute_violation(problem.space.variables, e.x) > 0.0 for e in evaluations
    )  # the violation entered the costs


@pytest.mark.slow
def test_converged_search_restarts_until_the_budget_is_used(tmp_path: Path) -> None:
    problem = make_problem()
    evaluations = optimize(problem, 1500, open_tuning_store(tmp_path / "s", problem), QuadraticRunner().run)
    assert len(evaluations) >= 1500


def test_signal_file_of_cma_in_the_working_folder_is_ignored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = make_problem()
    without_file = optimize(problem, 60, open_tuning_store(tmp_path / "t", problem), QuadraticRunner().run)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cma_signals.in").write_text("{'timeout': 0}")
    with_file = optimize(problem, 60, open_tuning_store(tmp_path / "s", problem), QuadraticRunner().run)
    assert [e.cost for e in with_file] == [e.cost for e in without_file]


def test_invalid_device_costs_as_much_as_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    problem, decode = make_problem(), DesignSpace.decode

    def decode_or_refuse(self: DesignSpace, x: np.ndarray) -> tuple[Device, PressureProfile]:
        if x[0] > 0.3:
            raise InputError("no such device")
        return decode(self, x)

    store = open_tuning_store(tmp_path / "s", problem)
    monkeypatch.setattr(DesignSpace, "decode", decode_or_refuse)
    evaluations = optimize(problem, 40, store, QuadraticRunner().run)
    assert all((e.metrics is None) == (e.x[0] > 0.3) for e in evaluations)
    assert any(e.metrics is None for e in evaluations)


class QuadraticRunner:
    """A quadratic objective with its minimum at 1, 2, 3 bar in place of the rig; counts the cases."""

    def __init__(self, interrupt_after: int | None = None) -> None:
        self.n_cases, self._interrupt_after = 0, interrupt_after

    def run(self, cases: Iterable[GaitCase], on_result: ResultCallback) -> None:
        for case in cases:
            if self.n_cases == self._interrupt_after:
                raise KeyboardInterrupt
            self.n_cases += 1
            pressures = np.array(case.controller.describe()["pressure_bar"])
            distance = float(np.sqrt(np.sum((pressures - [1.0, 2.0, 3.0]) ** 2)))
            values: dict[str, float | bool | None] = dict.fromkeys(METRIC_COLUMNS, 0.0)
            values |= {"moment_distance [sd]": distance, "air_per_stride [g]": float(pressures.sum()), "trips": False}
            values |= {"toe_clearance [mm]": 9.0, "ankle_moment_peak [N*m/kg]": HUMAN_MOMENT_PEAK_NM_PER_KG}
            on_result(case, CaseResult(values))


def make_problem(seed: int = 0, air: float = 0.0) -> TuningProblem:
    profile = PressureProfile("flat", (10.0, 40.0, 70.0), (2.0, 2.0, 2.0))
    return TuningProblem(space=DesignSpace(PAIR, profile), weights=Weights(air=air), seed=seed)


def test_search_finds_the_minimum(tmp_path: Path) -> None:
    problem = make_problem()
    evaluations = optimize(problem, 300, open_tuning_store(tmp_path / "s", problem), QuadraticRunner().run)
    assert select_best(evaluations).cost < 1e-3
    assert problem.space.decode(select_best(evaluations).x)[1].pressure_bar == pytest.approx((1.0, 2.0, 3.0), abs=0.05)
    assert evaluations[0].x == pytest.approx(0.0)
    assert 300 <= len(evaluations) < 320
    penalized = make_problem(air=1.0)
    other = optimize(penalized, 300, open_tuning_store(tmp_path / "d", penalized), QuadraticRunner().run)
    assert select_best(other).metrics.air_g < select_best(evaluations).metrics.air_g - 0.5  # type: ignore[union-attr]


class CoarseRunner(QuadraticRunner):
    """Coarse time steps flatter points with a low first pressure."""

    def run(self, cases: Iterable[GaitCase], on_result: ResultCallback) -> None:
        def add_error(case: GaitCase, result: CaseResult) -> None:
            first = case.controller.describe()["pressure_bar"][0]
            distance = result.metrics["moment_distance [sd]"]
            error = 0.0 if case.dt == FINE_DT or first > 1.0 else 0.5
            on_result(case, CaseResult({**result.metrics, "moment_distance [sd]": abs(distance - error)}))

        super().run(cases, add_error)


def test_result_is_the_best_at_the_fine_time_step(tmp_path: Path) -> None:
    problem, runner = make_problem(), CoarseRunner()
    store = open_tuning_store(tmp_path / "s", problem)
    evaluations = optimize(problem, 200, store, runner.run)
    n_cases = runner.n_cases
    fine = reevaluate(problem, evaluations, store, runner.run)
    assert runner.n_cases == n_cases + len(fine)
    assert np.array_equal(fine[0].x, evaluations[0].x)
    assert len(fine) == 1 + math.ceil(0.1 * len(evaluations))
    limit = sorted(e.cost for e in evaluations)[len(fine)]
    coarse_costs = {e.x.tobytes(): e.cost for e in evaluations}
    assert all(coarse_costs[e.x.tobytes()] <= limit for e in fine[1:])
    assert select_best(fine).cost > select_best(evaluations).cost  # the coarse time step flattered it
    reevaluate(problem, evaluations, store, runner.run)
    assert runner.n_cases == n_cases + len(fine)  # no case is evaluated twice


def test_resumed_search_equals_an_uninterrupted_one(tmp_path: Path) -> None:
    problem = make_problem(seed=3)
    uninterrupted = optimize(problem, 60, open_tuning_store(tmp_path / "uninterrupted", problem), QuadraticRunner().run)
    store = open_tuning_store(tmp_path / "half", problem)
    with pytest.raises(KeyboardInterrupt):
        optimize(problem, 60, store, QuadraticRunner(interrupt_after=25).run)
    runner = QuadraticRunner()
    resumed = optimize(problem, 60, open_tuning_store(tmp_path / "half", problem), runner.run)
    assert [e.cost for e in resumed] == [e.cost for e in uninterrupted]
    assert runner.n_cases == len(uninterrupted) - 25
    with pytest.raises(InputError, match=r"holds another tune \(other seed\)"):
        open_tuning_store(tmp_path / "half", make_problem(seed=4))


def test_no_evaluation_dominates_the_pareto_front(tmp_path: Path) -> None:
    problem = make_problem(air=0.3)
    evaluations = optimize(problem, 150, open_tuning_store(tmp_path / "s", problem), QuadraticRunner().run)
    assert all(e.metrics is not None and not e.has_penalty for e in evaluations)
    front = select_pareto_front(evaluations)
    air = [e.metrics.air_g for e in front if e.metrics is not None]
    assert air == sorted(air)
    for point in front:
        assert not any(
            e.tracking_error < point.tracking_error and e.metrics.air_g < point.metrics.air_g  # type: ignore[union-attr]
            for e in evaluations
        )


def test_evaluation_with_a_penalty_is_not_on_the_pareto_front() -> None:
    far, near = (
        Evaluation(np.zeros(1), 0.0, make_metrics(moment_sd=distance, moment_peak_ratio=ratio))
        for distance, ratio in ((0.7, 1.0), (0.1, 1.2))
    )
    assert near.has_penalty
    assert select_pareto_front([far, near]) == [far]


def test_failing_initial_point_is_refused(tmp_path: Path) -> None:
    def fail(cases: Iterable[GaitCase], on_result: ResultCallback) -> None:
        for case in cases:
            on_result(case, CaseResult({}, "the gait rig left its path"))

    problem = make_problem()
    with pytest.raises(KluteSimError, match="initial device and controller fails: the gait rig left its path"):
        optimize(problem, 10, open_tuning_store(tmp_path / "s", problem), fail)
