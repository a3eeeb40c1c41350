"""Tuning: knobs and objective by what they say, and the search on problems whose answer is known."""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from klute_sim.controllers.pressure import PressureProfile, load_default_profile
from klute_sim.device.device import Device, load_device
from klute_sim.errors import InputError, KluteSimError
from klute_sim.parameter_sweep.evaluate import METRIC_COLUMNS, CaseResult
from klute_sim.parameter_sweep.plan import GaitCase
from klute_sim.parameter_sweep.runner import ResultCallback
from klute_sim.parameter_sweep.store import open_store
from klute_sim.tuning.design_variables import DEFAULT_DEVICE_KEYS, DesignSpace
from klute_sim.tuning.folder import describe_problem
from klute_sim.tuning.objective import (
    FALL_COST,
    HUMAN_GOALS,
    TOE_CATCH_COST,
    Goals,
    TuningMetrics,
    Weights,
    compute_cost,
    compute_tracking_error,
    make_weights,
)
from klute_sim.tuning.search import FINE_DT, TuningProblem, optimize, reevaluate, select_best, select_pareto_front

pytest.importorskip("cma")
PAIR = load_device("klute-1-1-4-pair")
WALKED = TuningMetrics(
    moment_sd=0.7,
    angle_sd=0.3,
    power_sd=1.0,
    air_g=1.5,
    power_w_per_kg=2.66,
    work_j_per_kg=0.21,
    plantarflexion_deg=14.0,
    muscle_ratio_max=0.975,
    load_tracking_rms_bw=0.1,
    toe_clearance_mm=9.0,
    trips=False,
)


def changed(**values: float) -> TuningMetrics:
    return TuningMetrics(**{**WALKED.__dict__, **values})  # type: ignore[arg-type]


def test_the_objective_is_what_it_says() -> None:
    assert compute_tracking_error(WALKED, Weights()) == pytest.approx(0.49 + 0.09 + 1.0)
    assert compute_cost(WALKED, Weights(), Goals()) == pytest.approx(1.58 + 0.15)
    assert compute_cost(WALKED, Weights(moment=2.0, air=1.0), Goals()) == pytest.approx(1.58 + 0.49 + 1.5)
    assert compute_cost(changed(catches=True), Weights(), Goals()) == pytest.approx(1.73 + TOE_CATCH_COST)
    # Whatever the weights, a walk that catches comes after the worst of those that do not, and a fall after both.
    worst = changed(
        moment_sd=30.0, angle_sd=30.0, power_sd=30.0, air_g=50.0, longest_ratio=1.2, load_bw=1.0, clearance_mm=-50.0
    )
    assert compute_cost(worst, Weights(moment=1e3, angle=1e3, power=1e3, air=1e3), HUMAN_GOALS) < TOE_CATCH_COST
    assert (
        TOE_CATCH_COST + compute_cost(worst, Weights(moment=1e3, angle=1e3, power=1e3, air=1e3), HUMAN_GOALS)
        < FALL_COST
    )
    assert compute_cost(changed(longest_ratio=0.995), Weights(), Goals()) == pytest.approx(1.73 + 1e4 * 0.01**2)
    assert compute_cost(changed(clearance_mm=1.0), Weights(), Goals()) == pytest.approx(1.73 + 2.0**2)
    assert compute_cost(changed(load_bw=0.16), Weights(), Goals()) == pytest.approx(1.73 + 3e3 * 0.02**2)
    missing = 0.31 / 0.2 + 0.65 / 0.5 + 0.008 / 0.03 + 1.0 / 1.5
    assert compute_cost(WALKED, Weights(), HUMAN_GOALS) == pytest.approx(1.73 + missing)
    reached = changed(moment_sd=0.38, power_w_per_kg=3.4, work_j_per_kg=0.22, plantarflexion_deg=15.1)
    assert HUMAN_GOALS.compute_shortfall(reached) == 0.0


def test_weights_are_checked() -> None:
    assert make_weights({"air": 0.5}) == Weights(air=0.5)
    with pytest.raises(InputError, match="there is no weight of 'oil'; there are: moment, angle, power, air"):
        make_weights({"oil": 1.0})
    with pytest.raises(InputError, match="all weights are 0"):
        make_weights(dict.fromkeys(("moment", "angle", "power", "air"), 0.0))
    for value in (-1.0, math.nan):
        with pytest.raises(InputError, match="weight of air is"):
            make_weights({"air": value})


def test_knobs_where_they_start_change_nothing() -> None:
    tunable = DesignSpace(PAIR, load_default_profile(), DEFAULT_DEVICE_KEYS)
    device, profile = tunable.decode(np.zeros(len(tunable.variables)))
    assert profile.gait_pct == load_default_profile().gait_pct
    assert profile.pressure_bar == load_default_profile().pressure_bar
    assert device.parameters == PAIR.parameters


def test_knobs_stay_within_their_bounds_and_tell_how_far_they_would_go() -> None:
    tunable = DesignSpace(PAIR, load_default_profile(), ("damper.bore_mm",))
    far = np.full(len(tunable.variables), 100.0)
    device, profile = tunable.decode(far)
    assert max(profile.pressure_bar) == 5.0
    assert device.spec.collect_values()["damper.bore_mm"] == pytest.approx(6.0 * 27.0)
    assert tunable.compute_violation(far) > 1e3
    assert tunable.compute_violation(np.zeros(len(far))) == 0.0
    assert (
        DesignSpace(PAIR, load_default_profile(), ("supply.pressure_bar",)).variables[-1].upper
        == PAIR.spec.collect_values()["supply.pressure_bar"]
    )
    low = tunable.decode(-far)[1]
    assert min(low.pressure_bar) == 0.0
    for knob in tunable.variables:
        assert knob.decode(knob.normalize(0.5 * (knob.initial + knob.upper))) == pytest.approx(
            0.5 * (knob.initial + knob.upper)
        )


def test_timing_moves_a_profile_around_the_stride() -> None:
    tunable = DesignSpace(PAIR, load_default_profile())
    places = np.zeros(len(tunable.variables))
    places[-1] = 1.5  # of 2 %
    moved = tunable.decode(places)[1]
    phases = np.linspace(0.0, 1.0, 50, endpoint=False)
    assert [moved.pressure_at(p + 0.03) for p in phases] == pytest.approx(
        [load_default_profile().pressure_at(p) for p in phases]
    )


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("damper.colour", "has no number 'damper.colour'"),
        ("supply.dead_volume_l", "has no number"),
        ("muscle.count", "'muscle.count' is a whole number"),
    ],
)
def test_a_key_that_is_no_number_is_refused(key: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        DesignSpace(PAIR, load_default_profile(), (key,))


def test_a_tuned_device_has_a_name_of_its_own_and_its_numbers_are_assumed() -> None:
    tunable = DesignSpace(PAIR, load_default_profile(), ("tendon.stiffness_1_n_per_mm",))
    places = np.zeros(len(tunable.variables))
    assert tunable.decode(places)[0].name == "klute-1-1-4-pair-tuned"
    assert "tendon.stiffness_1_n_per_mm" in tunable.decode(places)[0].spec.collect_assumptions()
    assert DesignSpace(PAIR, load_default_profile()).decode(places[:-1])[0] is PAIR


def test_a_profile_above_the_supply_is_refused() -> None:
    with pytest.raises(InputError, match="asks for 9 bar; the supply of 'klute-1-1-4-pair' has 5 bar"):
        DesignSpace(PAIR, PressureProfile("high", (0.0, 50.0), (1.0, 9.0)))


def test_a_device_without_a_tendon_cannot_be_walked_and_says_why() -> None:
    with pytest.raises(InputError, match=r"no \[tendon\] section"):
        TuningProblem(
            space=DesignSpace(load_device("klute-3-4"), PressureProfile("flat", (0.0, 50.0), (2.0, 2.0))), mass=75.0
        )


class Odd:
    """Every heading another number; where the first pressure is low it falls, and where it is high it catches."""

    HEADED = (
        ("moment_distance [sd]", 0.5),
        ("angle_distance [sd]", 0.3),
        ("power_distance [sd]", 0.2),
        ("air_per_stride [g]", 1.7),
        ("ankle_power_peak [W/kg]", 3.0),
        ("ankle_work_net [J/kg]", 0.2),
        ("ankle_plantarflexion [deg]", 12.0),
        ("muscle_ratio_max [1]", 0.97),
        ("grf_vertical_tracking_rms [1]", 0.1),
        ("toe_clearance [mm]", 9.0),
    )

    def run(self, combinations: Iterable[GaitCase], finished: ResultCallback) -> None:
        for each in combinations:
            first = each.controller.describe()["pressure_bar"][0]
            values: dict[str, float | bool | None] = dict.fromkeys(METRIC_COLUMNS, 99.0)
            values |= {**dict(self.HEADED), "trips": first > 2.2}
            finished(each, CaseResult({}, "it fell") if first < 1.8 else CaseResult(values))


def test_what_is_read_of_a_walk_and_what_falls_and_catches_are_worth(tmp_path: Path) -> None:
    plain = question(air=0.1)
    asked = TuningProblem(space=plain.space, mass=75.0, weights=Weights(air=0.1), goals=HUMAN_GOALS)
    tried = optimize(asked, 60, open_store(tmp_path / "s", describe_problem(asked), "tune"), Odd().run)
    walked = 0.25 + 0.09 + 0.04 + 0.17 + 0.11 / 0.2 + 0.31 / 0.5 + 0.018 / 0.03 + 3.0 / 1.5
    fell = [each for each in tried if each.metrics is None]
    caught = [each for each in tried if each.metrics is not None and each.metrics.trips]
    rest = [each for each in tried if each.metrics is not None and not each.metrics.trips]
    assert fell
    assert caught
    assert rest
    for each in rest:
        assert each.cost == pytest.approx(walked + asked.space.compute_violation(each.x))
    assert all(each.cost >= FALL_COST and each.failure == "it fell" for each in fell)
    assert all(TOE_CATCH_COST <= each.cost < FALL_COST for each in caught)
    assert select_best(tried) in rest
    assert {id(each) for each in select_pareto_front(tried)} <= {id(each) for each in rest}
    assert any(asked.space.compute_violation(each.x) > 0.0 for each in tried)  # so that it counts above


def test_a_strategy_that_has_nothing_left_begins_anew(tmp_path: Path) -> None:
    asked = question()
    tried = optimize(asked, 1500, open_store(tmp_path / "s", describe_problem(asked), "tune"), Bowl().run)
    assert len(tried) >= 1500


def test_an_order_in_the_working_folder_does_not_stop_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = question()
    alone = optimize(asked, 60, open_store(tmp_path / "t", describe_problem(asked), "tune"), Bowl().run)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cma_signals.in").write_text("{'timeout': 0}")
    ordered = optimize(asked, 60, open_store(tmp_path / "s", describe_problem(asked), "tune"), Bowl().run)
    assert [each.cost for each in ordered] == [each.cost for each in alone]


def test_a_device_that_cannot_be_made_is_a_fall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, made = question(), DesignSpace.decode

    def refused(self: DesignSpace, places: np.ndarray) -> tuple[Device, PressureProfile]:
        if places[0] > 0.3:
            raise InputError("no such device")
        return made(self, places)

    store = open_store(tmp_path / "s", describe_problem(asked), "tune")
    monkeypatch.setattr(DesignSpace, "decode", refused)
    tried = optimize(asked, 40, store, Bowl().run)
    assert all((each.metrics is None) == (each.x[0] > 0.3) for each in tried)
    assert any(each.metrics is None for each in tried)


class Bowl:
    """In place of the rig: the nearer the pressures are to 1, 2, 3 bar the better; it counts what it is asked."""

    def __init__(self, breaks_after: int | None = None) -> None:
        self.asked, self._breaks_after = 0, breaks_after

    def run(self, combinations: Iterable[GaitCase], finished: ResultCallback) -> None:
        for each in combinations:
            if self.asked == self._breaks_after:
                raise KeyboardInterrupt
            self.asked += 1
            pressures = np.array(each.controller.describe()["pressure_bar"])
            apart = float(np.sqrt(np.sum((pressures - [1.0, 2.0, 3.0]) ** 2)))
            values: dict[str, float | bool | None] = dict.fromkeys(METRIC_COLUMNS, 0.0)
            values |= {"moment_distance [sd]": apart, "air_per_stride [g]": float(pressures.sum()), "trips": False}
            values["toe_clearance [mm]"] = 9.0
            finished(each, CaseResult(values))


def question(seed: int = 0, air: float = 0.0) -> TuningProblem:
    profile = PressureProfile("flat", (10.0, 40.0, 70.0), (2.0, 2.0, 2.0))
    return TuningProblem(space=DesignSpace(PAIR, profile), mass=75.0, weights=Weights(air=air), seed=seed)


def test_the_search_finds_what_is_there(tmp_path: Path) -> None:
    asked = question()
    tried = optimize(asked, 300, open_store(tmp_path / "s", describe_problem(asked), "tune"), Bowl().run)
    assert select_best(tried).cost < 1e-3
    assert asked.space.decode(select_best(tried).x)[1].pressure_bar == pytest.approx((1.0, 2.0, 3.0), abs=0.05)
    assert tried[0].x == pytest.approx(0.0)
    assert 300 <= len(tried) < 320
    # Air costs: the best with it takes less.
    dear = question(air=1.0)
    other = optimize(dear, 300, open_store(tmp_path / "d", describe_problem(dear), "tune"), Bowl().run)
    assert select_best(other).metrics.air_g < select_best(tried).metrics.air_g - 0.5  # type: ignore[union-attr]


class Flattering(Bowl):
    """Long steps flatter what has a low first pressure."""

    def run(self, combinations: Iterable[GaitCase], finished: ResultCallback) -> None:
        def judged(combination: GaitCase, walked: CaseResult) -> None:
            first = combination.controller.describe()["pressure_bar"][0]
            far = walked.metrics["moment_distance [sd]"]
            wrong = 0.0 if combination.dt == FINE_DT or first > 1.0 else 0.5
            finished(combination, CaseResult({**walked.metrics, "moment_distance [sd]": abs(far - wrong)}))

        super().run(combinations, judged)


def test_the_result_is_the_best_in_fine_steps(tmp_path: Path) -> None:
    asked, runner = question(), Flattering()
    store = open_store(tmp_path / "s", describe_problem(asked), "tune")
    tried = optimize(asked, 200, store, runner.run)
    count = runner.asked
    finely = reevaluate(asked, tried, store, runner.run)
    assert runner.asked == count + len(finely)
    assert np.array_equal(finely[0].x, tried[0].x)
    assert len(finely) == 1 + math.ceil(0.1 * len(tried))
    limit = sorted(each.cost for each in tried)[len(finely)]
    known = {each.x.tobytes(): each.cost for each in tried}
    assert all(known[each.x.tobytes()] <= limit for each in finely[1:])
    assert select_best(finely).cost > select_best(tried).cost  # which was flattered
    reevaluate(asked, tried, store, runner.run)
    assert runner.asked == count + len(finely)  # nothing is walked twice


def test_an_interrupted_search_goes_on_and_ends_where_it_would_have(tmp_path: Path) -> None:
    asked = question(seed=3)
    whole = optimize(asked, 60, open_store(tmp_path / "whole", describe_problem(asked), "tune"), Bowl().run)
    store = open_store(tmp_path / "half", describe_problem(asked), "tune")
    with pytest.raises(KeyboardInterrupt):
        optimize(asked, 60, store, Bowl(breaks_after=25).run)
    rest = Bowl()
    again = optimize(asked, 60, open_store(tmp_path / "half", describe_problem(asked), "tune"), rest.run)
    assert [each.cost for each in again] == [each.cost for each in whole]
    assert rest.asked == len(whole) - 25
    with pytest.raises(InputError, match=r"holds another tune \(other seed\)"):
        open_store(tmp_path / "half", describe_problem(question(seed=4)), "tune")


def test_nothing_beats_the_front(tmp_path: Path) -> None:
    asked = question(air=0.3)
    tried = optimize(asked, 150, open_store(tmp_path / "s", describe_problem(asked), "tune"), Bowl().run)
    ahead = select_pareto_front(tried)
    air = [each.metrics.air_g for each in ahead if each.metrics is not None]
    assert air == sorted(air)
    for each in ahead:
        assert not any(
            other.tracking_error < each.tracking_error and other.metrics.air_g < each.metrics.air_g  # type: ignore[union-attr]
            for other in tried
        )


def test_a_beginning_that_does_not_walk_is_refused(tmp_path: Path) -> None:
    def falls(combinations: Iterable[GaitCase], finished: ResultCallback) -> None:
        for each in combinations:
            finished(each, CaseResult({}, "the gait rig left its path"))

    asked = question()
    with pytest.raises(KluteSimError, match="where tuning begins does not walk: the gait rig left its path"):
        optimize(asked, 10, open_store(tmp_path / "s", describe_problem(asked), "tune"), falls)
