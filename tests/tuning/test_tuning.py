"""Tuning: knobs and objective by what they say, and the search on problems whose answer is known."""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from klute_sim.control.pressure import Profile, tuned
from klute_sim.device.files import Device, load
from klute_sim.errors import InputError, KluteSimError
from klute_sim.sweep.plan import Combination
from klute_sim.sweep.runner import Finished
from klute_sim.sweep.store import open_folder
from klute_sim.sweep.walk import HEADINGS, Walked
from klute_sim.tuning.folder import described
from klute_sim.tuning.knobs import DEVICE, Tunable
from klute_sim.tuning.objective import CATCH, FALL, HUMAN, Goals, Tracked, Weights, cost, named, tracking
from klute_sim.tuning.search import FINE_STEP, Question, again, best, front, search

pytest.importorskip("cma")
PAIR = load("klute-1-1-4-pair")
WALKED = Tracked(
    moment_sd=0.7,
    angle_sd=0.3,
    power_sd=1.0,
    air_g=1.5,
    power_w_per_kg=2.66,
    work_j_per_kg=0.21,
    plantarflexion_deg=14.0,
    longest_ratio=0.975,
    load_bw=0.1,
    clearance_mm=9.0,
    catches=False,
)


def changed(**values: float) -> Tracked:
    return Tracked(**{**WALKED.__dict__, **values})  # type: ignore[arg-type]


def test_the_objective_is_what_it_says() -> None:
    assert tracking(WALKED, Weights()) == pytest.approx(0.49 + 0.09 + 1.0)
    assert cost(WALKED, Weights(), Goals()) == pytest.approx(1.58 + 0.15)
    assert cost(WALKED, Weights(moment=2.0, air=1.0), Goals()) == pytest.approx(1.58 + 0.49 + 1.5)
    assert cost(changed(catches=True), Weights(), Goals()) == pytest.approx(1.73 + CATCH)
    # Whatever the weights, a walk that catches comes after the worst of those that do not, and a fall after both.
    worst = changed(
        moment_sd=30.0, angle_sd=30.0, power_sd=30.0, air_g=50.0, longest_ratio=1.2, load_bw=1.0, clearance_mm=-50.0
    )
    assert cost(worst, Weights(moment=1e3, angle=1e3, power=1e3, air=1e3), HUMAN) < CATCH
    assert CATCH + cost(worst, Weights(moment=1e3, angle=1e3, power=1e3, air=1e3), HUMAN) < FALL
    assert cost(changed(longest_ratio=0.995), Weights(), Goals()) == pytest.approx(1.73 + 1e4 * 0.01**2)
    assert cost(changed(clearance_mm=1.0), Weights(), Goals()) == pytest.approx(1.73 + 2.0**2)
    assert cost(changed(load_bw=0.16), Weights(), Goals()) == pytest.approx(1.73 + 3e3 * 0.02**2)
    missing = 0.31 / 0.2 + 0.65 / 0.5 + 0.008 / 0.03 + 1.0 / 1.5
    assert cost(WALKED, Weights(), HUMAN) == pytest.approx(1.73 + missing)
    reached = changed(moment_sd=0.38, power_w_per_kg=3.4, work_j_per_kg=0.22, plantarflexion_deg=15.1)
    assert HUMAN.missed(reached) == 0.0


def test_weights_are_checked() -> None:
    assert named({"air": 0.5}) == Weights(air=0.5)
    with pytest.raises(InputError, match="there is no weight of 'oil'; there are: moment, angle, power, air"):
        named({"oil": 1.0})
    with pytest.raises(InputError, match="all weights are 0"):
        named(dict.fromkeys(("moment", "angle", "power", "air"), 0.0))
    for value in (-1.0, math.nan):
        with pytest.raises(InputError, match="weight of air is"):
            named({"air": value})


def test_knobs_where_they_start_change_nothing() -> None:
    tunable = Tunable(PAIR, tuned(), DEVICE)
    device, profile = tunable.made(np.zeros(len(tunable.knobs)))
    assert profile.gait_pct == tuned().gait_pct
    assert profile.pressure_bar == tuned().pressure_bar
    assert device.parameters == PAIR.parameters


def test_knobs_stay_within_their_bounds_and_tell_how_far_they_would_go() -> None:
    tunable = Tunable(PAIR, tuned(), ("damper.bore_mm",))
    far = np.full(len(tunable.knobs), 100.0)
    device, profile = tunable.made(far)
    assert max(profile.pressure_bar) == 5.0
    assert device.spec.numbers()["damper.bore_mm"] == pytest.approx(6.0 * 27.0)
    assert tunable.beyond(far) > 1e3
    assert tunable.beyond(np.zeros(len(far))) == 0.0
    assert Tunable(PAIR, tuned(), ("supply.pressure_bar",)).knobs[-1].high == PAIR.spec.numbers()["supply.pressure_bar"]
    low = tunable.made(-far)[1]
    assert min(low.pressure_bar) == 0.0
    for knob in tunable.knobs:
        assert knob.value(knob.place(0.5 * (knob.start + knob.high))) == pytest.approx(0.5 * (knob.start + knob.high))


def test_timing_moves_a_profile_around_the_stride() -> None:
    tunable = Tunable(PAIR, tuned())
    places = np.zeros(len(tunable.knobs))
    places[-1] = 1.5  # of 2 %
    moved = tunable.made(places)[1]
    phases = np.linspace(0.0, 1.0, 50, endpoint=False)
    assert [moved.pressure(p + 0.03) for p in phases] == pytest.approx([tuned().pressure(p) for p in phases])


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
        Tunable(PAIR, tuned(), (key,))


def test_a_tuned_device_has_a_name_of_its_own_and_its_numbers_are_assumed() -> None:
    tunable = Tunable(PAIR, tuned(), ("tendon.stiffness_1_n_per_mm",))
    places = np.zeros(len(tunable.knobs))
    assert tunable.made(places)[0].name == "klute-1-1-4-pair-tuned"
    assert "tendon.stiffness_1_n_per_mm" in tunable.made(places)[0].spec.assumed()
    assert Tunable(PAIR, tuned()).made(places[:-1])[0] is PAIR


def test_a_profile_above_the_supply_is_refused() -> None:
    with pytest.raises(InputError, match="asks for 9 bar; the supply of 'klute-1-1-4-pair' has 5 bar"):
        Tunable(PAIR, Profile("high", (0.0, 50.0), (1.0, 9.0)))


def test_a_device_without_a_tendon_cannot_be_walked_and_says_why() -> None:
    with pytest.raises(InputError, match=r"no \[tendon\] section"):
        Question(tunable=Tunable(load("klute-3-4"), Profile("flat", (0.0, 50.0), (2.0, 2.0))), mass=75.0)


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

    def run(self, combinations: Iterable[Combination], finished: Finished) -> None:
        for each in combinations:
            first = each.controller.describe()["pressure_bar"][0]
            values: dict[str, float | bool | None] = dict.fromkeys(HEADINGS, 99.0)
            values |= {**dict(self.HEADED), "trips": first > 2.2}
            finished(each, Walked({}, "it fell") if first < 1.8 else Walked(values))


def test_what_is_read_of_a_walk_and_what_falls_and_catches_are_worth(tmp_path: Path) -> None:
    plain = question(air=0.1)
    asked = Question(tunable=plain.tunable, mass=75.0, weights=Weights(air=0.1), goals=HUMAN)
    tried = search(asked, 60, open_folder(tmp_path / "s", described(asked), "tune"), Odd().run)
    walked = 0.25 + 0.09 + 0.04 + 0.17 + 0.11 / 0.2 + 0.31 / 0.5 + 0.018 / 0.03 + 3.0 / 1.5
    fell = [each for each in tried if each.tracked is None]
    caught = [each for each in tried if each.tracked is not None and each.tracked.catches]
    rest = [each for each in tried if each.tracked is not None and not each.tracked.catches]
    assert fell
    assert caught
    assert rest
    for each in rest:
        assert each.cost == pytest.approx(walked + asked.tunable.beyond(each.places))
    assert all(each.cost >= FALL and each.failure == "it fell" for each in fell)
    assert all(CATCH <= each.cost < FALL for each in caught)
    assert best(tried) in rest
    assert {id(each) for each in front(tried)} <= {id(each) for each in rest}
    assert any(asked.tunable.beyond(each.places) > 0.0 for each in tried)  # so that it counts above


def test_a_strategy_that_has_nothing_left_begins_anew(tmp_path: Path) -> None:
    asked = question()
    tried = search(asked, 1500, open_folder(tmp_path / "s", described(asked), "tune"), Bowl().run)
    assert len(tried) >= 1500


def test_an_order_in_the_working_folder_does_not_stop_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = question()
    alone = search(asked, 60, open_folder(tmp_path / "t", described(asked), "tune"), Bowl().run)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cma_signals.in").write_text("{'timeout': 0}")
    ordered = search(asked, 60, open_folder(tmp_path / "s", described(asked), "tune"), Bowl().run)
    assert [each.cost for each in ordered] == [each.cost for each in alone]


def test_a_device_that_cannot_be_made_is_a_fall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked, made = question(), Tunable.made

    def refused(self: Tunable, places: np.ndarray) -> tuple[Device, Profile]:
        if places[0] > 0.3:
            raise InputError("no such device")
        return made(self, places)

    store = open_folder(tmp_path / "s", described(asked), "tune")
    monkeypatch.setattr(Tunable, "made", refused)
    tried = search(asked, 40, store, Bowl().run)
    assert all((each.tracked is None) == (each.places[0] > 0.3) for each in tried)
    assert any(each.tracked is None for each in tried)


class Bowl:
    """In place of the rig: the nearer the pressures are to 1, 2, 3 bar the better; it counts what it is asked."""

    def __init__(self, breaks_after: int | None = None) -> None:
        self.asked, self._breaks_after = 0, breaks_after

    def run(self, combinations: Iterable[Combination], finished: Finished) -> None:
        for each in combinations:
            if self.asked == self._breaks_after:
                raise KeyboardInterrupt
            self.asked += 1
            pressures = np.array(each.controller.describe()["pressure_bar"])
            apart = float(np.sqrt(np.sum((pressures - [1.0, 2.0, 3.0]) ** 2)))
            values: dict[str, float | bool | None] = dict.fromkeys(HEADINGS, 0.0)
            values |= {"moment_distance [sd]": apart, "air_per_stride [g]": float(pressures.sum()), "trips": False}
            values["toe_clearance [mm]"] = 9.0
            finished(each, Walked(values))


def question(seed: int = 0, air: float = 0.0) -> Question:
    profile = Profile("flat", (10.0, 40.0, 70.0), (2.0, 2.0, 2.0))
    return Question(tunable=Tunable(PAIR, profile), mass=75.0, weights=Weights(air=air), seed=seed)


def test_the_search_finds_what_is_there(tmp_path: Path) -> None:
    asked = question()
    tried = search(asked, 300, open_folder(tmp_path / "s", described(asked), "tune"), Bowl().run)
    assert best(tried).cost < 1e-3
    assert asked.tunable.made(best(tried).places)[1].pressure_bar == pytest.approx((1.0, 2.0, 3.0), abs=0.05)
    assert tried[0].places == pytest.approx(0.0)
    assert 300 <= len(tried) < 320
    # Air costs: the best with it takes less.
    dear = question(air=1.0)
    other = search(dear, 300, open_folder(tmp_path / "d", described(dear), "tune"), Bowl().run)
    assert best(other).tracked.air_g < best(tried).tracked.air_g - 0.5  # type: ignore[union-attr]


class Flattering(Bowl):
    """Long steps flatter what has a low first pressure."""

    def run(self, combinations: Iterable[Combination], finished: Finished) -> None:
        def judged(combination: Combination, walked: Walked) -> None:
            first = combination.controller.describe()["pressure_bar"][0]
            far = walked.outcomes["moment_distance [sd]"]
            wrong = 0.0 if combination.step == FINE_STEP or first > 1.0 else 0.5
            finished(combination, Walked({**walked.outcomes, "moment_distance [sd]": abs(far - wrong)}))

        super().run(combinations, judged)


def test_the_result_is_the_best_in_fine_steps(tmp_path: Path) -> None:
    asked, runner = question(), Flattering()
    store = open_folder(tmp_path / "s", described(asked), "tune")
    tried = search(asked, 200, store, runner.run)
    count = runner.asked
    finely = again(asked, tried, store, runner.run)
    assert runner.asked == count + len(finely)
    assert np.array_equal(finely[0].places, tried[0].places)
    assert len(finely) == 1 + math.ceil(0.1 * len(tried))
    limit = sorted(each.cost for each in tried)[len(finely)]
    known = {each.places.tobytes(): each.cost for each in tried}
    assert all(known[each.places.tobytes()] <= limit for each in finely[1:])
    assert best(finely).cost > best(tried).cost  # which was flattered
    again(asked, tried, store, runner.run)
    assert runner.asked == count + len(finely)  # nothing is walked twice


def test_an_interrupted_search_goes_on_and_ends_where_it_would_have(tmp_path: Path) -> None:
    asked = question(seed=3)
    whole = search(asked, 60, open_folder(tmp_path / "whole", described(asked), "tune"), Bowl().run)
    store = open_folder(tmp_path / "half", described(asked), "tune")
    with pytest.raises(KeyboardInterrupt):
        search(asked, 60, store, Bowl(breaks_after=25).run)
    rest = Bowl()
    again = search(asked, 60, open_folder(tmp_path / "half", described(asked), "tune"), rest.run)
    assert [each.cost for each in again] == [each.cost for each in whole]
    assert rest.asked == len(whole) - 25
    with pytest.raises(InputError, match=r"holds another tune \(other seed\)"):
        open_folder(tmp_path / "half", described(question(seed=4)), "tune")


def test_nothing_beats_the_front(tmp_path: Path) -> None:
    asked = question(air=0.3)
    tried = search(asked, 150, open_folder(tmp_path / "s", described(asked), "tune"), Bowl().run)
    ahead = front(tried)
    air = [each.tracked.air_g for each in ahead if each.tracked is not None]
    assert air == sorted(air)
    for each in ahead:
        assert not any(
            other.tracking < each.tracking and other.tracked.air_g < each.tracked.air_g  # type: ignore[union-attr]
            for other in tried
        )


def test_a_beginning_that_does_not_walk_is_refused(tmp_path: Path) -> None:
    def falls(combinations: Iterable[Combination], finished: Finished) -> None:
        for each in combinations:
            finished(each, Walked({}, "the gait rig left its path"))

    asked = question()
    with pytest.raises(KluteSimError, match="where tuning begins does not walk: the gait rig left its path"):
        search(asked, 10, open_folder(tmp_path / "s", described(asked), "tune"), falls)
