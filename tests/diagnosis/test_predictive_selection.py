"""Selection by the prediction of left-out conditions, on models whose errors are known."""

from dataclasses import replace

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.law_error_weights import weight_by_law_error
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.imperfect_law import compute_jackknife_intervals, decide_verdict
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise, estimate_noise_from_residuals
from klute_sim.diagnosis.selection import predictive_selection
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.naming import find_infeasible_terms, find_naming_obstacle
from klute_sim.diagnosis.selection.pair_screening import screen_pairs
from klute_sim.diagnosis.selection.predictive_model import (
    FoldPart,
    PredictiveModel,
    PredictiveResult,
    choose_model,
    choose_stable_model,
    divide_into_folds,
    is_as_good,
    list_nameable_models,
    refuse_redundant_terms,
)
from klute_sim.diagnosis.selection.predictive_selection import PredictiveSelection
from klute_sim.diagnosis.selection.screening import Candidate
from tests.diagnosis.synthetic_dataset import make_repeats

DEVICE = load_device("klute-3-4-pair")
FRICTION, TAPER = EffectTerm("seal_friction", "coulomb"), EffectTerm("end_taper", "strain")
TENSION, GAIN = EffectTerm("passive_tension", "exponential"), EffectTerm("sensor_gain", "linear", "force")
RADIUS, TURNS = (
    EffectTerm("number_error", "value", number=f"muscle.{key}") for key in ("bladder_radius_mm", "turns_per_m")
)
ALL = np.arange(6)


def make_fit(terms: tuple[EffectTerm, ...], x: list[float] | None = None) -> Fit:
    hypothesis = Hypothesis(DEVICE, (), (("force", 3.0),), terms)
    point = hypothesis.initial_point() + 1.0 if x is None else np.array(x)
    return Fit(hypothesis, point, np.zeros(1), np.ones((1, len(point))), True, [])


def make_model(terms: tuple[EffectTerm, ...], errors: list[float], obstacle: str = "") -> PredictiveModel:
    fit = make_fit(terms)
    return PredictiveModel(fit, np.array(errors), np.tile(fit.x, (len(errors), 1)), obstacle)


BASE = make_model((), [4.0, 5.0, 4.0, 5.0, 4.0, 5.0])


def test_no_set_has_as_many_names_as_there_are_conditions() -> None:
    single, pair = make_model((FRICTION,), [1.0] * 3), make_model((FRICTION, TAPER), [0.5] * 3)
    triple, refused = make_model((FRICTION, TAPER, TENSION), [0.1] * 3), make_model((TENSION,), [0.2] * 3, "at a bound")
    assert list_nameable_models([triple, refused, pair, single], 3) == [pair, single]
    assert list_nameable_models([triple, refused, pair, single], 4) == [triple, pair, single]


def test_simplest_model_within_one_standard_error_is_chosen() -> None:
    single = make_model((FRICTION,), [1.0, 1.1, 0.9, 1.0, 1.1, 0.9])
    slightly_better = make_model((FRICTION, TAPER), [0.9, 1.15, 0.85, 1.0, 1.12, 0.86])
    assert choose_model([BASE, single, slightly_better], ALL) is single
    clearly_better = make_model((FRICTION, TAPER), [0.5, 0.6, 0.4, 0.5, 0.6, 0.4])
    assert choose_model([BASE, single, clearly_better], ALL) is clearly_better
    assert choose_model([BASE], ALL) is BASE


def test_absurd_model_says_nothing_of_what_there_is_to_explain() -> None:
    """A number that took the cable off its pulley predicted 61 times worse, and nothing seemed to be missing."""
    single, absurd = make_model((FRICTION,), [0.1] * 6), make_model((RADIUS,), [300.0] * 6)
    assert choose_model([BASE, single, absurd], ALL) is single
    assert choose_model([BASE, absurd], ALL) is BASE


def test_model_that_is_far_worse_in_one_fold_and_better_in_none_is_not_as_good() -> None:
    """The pressure changes in one condition only: a delay in place of a lag is wrong there, and nowhere else."""
    lag, delay = make_model((FRICTION,), [0.1] * 6), make_model((TAPER,), [9.0, 0.1, 0.1, 0.1, 0.1, 0.1])
    base = make_model((), [20.0, 0.1, 0.1, 0.1, 0.1, 0.1])
    assert not is_as_good(delay, lag)
    assert choose_model([base, lag, delay], ALL) is lag
    assert not is_as_good(make_model((TAPER,), [9.0, 0.05, 0.1, 0.1, 0.1, 0.1]), lag)  # hardly better in another fold
    assert is_as_good(make_model((TAPER,), [30.0] + [0.05] * 5), make_model((FRICTION,), [1.0] * 6))  # clearly better
    assert is_as_good(make_model((TAPER,), [0.9, 0.1, 0.1, 0.1, 0.1, 0.1]), lag)  # not far worse
    assert choose_model([base, lag, delay], np.arange(1, 6)) is base


def test_further_term_that_takes_a_small_part_of_the_error_of_the_law_is_not_chosen() -> None:
    """It predicts better in every specimen, because all have the same error of the law, and it is no name."""
    base = make_model((), [40.0, 44.0, 36.0])
    single = make_model((FRICTION,), [4.2, 4.0, 3.8])
    absorber = make_model((TAPER, TENSION), [3.3, 3.1, 2.9])
    three = make_model((FRICTION, TAPER, TENSION), [2.6, 2.4, 2.2])
    folds = np.arange(3)
    assert choose_model([base, single, absorber], folds) is single
    assert choose_model([base, single, absorber, three], folds) is single
    # If 1 of 4 is noise, the single name leaves 3, and the pair takes more than a quarter of that.
    assert choose_model([base, single, absorber], folds, 1.0) is absorber
    # Two effects that do little alone, and an absorber beside them.
    pair = make_model((FRICTION, TAPER), [1.1, 1.0, 0.9])
    beside = make_model((FRICTION, TAPER, TENSION), [0.95, 0.85, 0.75])
    assert choose_model([base, single, pair, beside], folds) is pair
    # Without a simpler name, the share of the error that is worth a name is judged by the verdict.
    assert choose_model([base, make_model((FRICTION,), [35.0, 38.0, 32.0])], folds).terms


@pytest.mark.parametrize("fault", ["instrument", "number"])
def test_fault_beside_an_effect_must_take_half_of_what_the_effect_leaves(fault: str) -> None:
    """It contradicts a calibration or a measurement, and an imperfect law looks like one."""
    term = GAIN if fault == "instrument" else RADIUS
    base, single = make_model((), [40.0, 44.0, 36.0]), make_model((FRICTION,), [4.2, 4.0, 3.8])
    errors = [2.6, 2.4, 2.2]  # 40 % less than without the fault
    assert choose_model([base, single, make_model((FRICTION, TAPER), errors)], np.arange(3)) is not single
    assert choose_model([base, single, make_model((FRICTION, term), errors)], np.arange(3)) is single
    decisive = make_model((FRICTION, term), [2.0, 1.8, 1.6])
    assert choose_model([base, single, decisive], np.arange(3)) is decisive
    # The fault replaces another one, so it is no further fault.
    faulty = make_model((GAIN,), [4.2, 4.0, 3.8])
    assert choose_model([base, faulty, make_model((FRICTION, term), errors)], np.arange(3)) is not faulty


def test_term_that_only_moves_a_parameter_off_its_bound_is_no_name() -> None:
    at_bound = make_model((FRICTION,), [0.05, 0.06, 0.05, 0.06, 0.05, 0.06], "it is at its bound")
    idle = make_model((FRICTION, GAIN), [0.04, 0.05, 0.04, 0.05, 0.04, 0.05])
    other = make_model((TAPER, GAIN), [0.5, 0.6, 0.5, 0.6, 0.5, 0.6])
    checked = refuse_redundant_terms(BASE, [idle, at_bound, other, BASE], 6)
    assert "friction" in checked[0].obstacle
    assert "it is at its bound" in checked[0].obstacle
    assert checked[1:] == [at_bound, other, BASE]
    form = EffectTerm("seal_friction", "stribeck")
    other_form = make_model((form, GAIN), [0.04, 0.05, 0.04, 0.05, 0.04, 0.05])
    assert refuse_redundant_terms(BASE, [other_form, at_bound, BASE], 6) == [other_form, at_bound, BASE]
    needed = make_model((FRICTION, GAIN), [0.4, 0.5, 0.4, 0.5, 0.4, 0.5])
    poor = make_model((FRICTION,), [2.0, 2.1, 2.0, 2.1, 2.0, 2.1], "it is at its bound")
    assert refuse_redundant_terms(BASE, [needed, poor, BASE], 6) == [needed, poor, BASE]


def test_names_that_one_fold_decides_do_not_withhold_the_others() -> None:
    single = make_model((FRICTION,), [1.0, 1.1, 0.9, 1.0])
    pair = make_model((FRICTION, TAPER), [0.2, 0.3, 0.1, 1.0])
    base = make_model((), [4.0, 5.0, 4.0, 5.0])
    assert choose_model([base, single, pair], np.arange(4)) is pair
    chosen, stability = choose_stable_model([base, single, pair], 4)
    assert chosen is pair  # in all refits
    assert set(stability.values()) == {1.0}
    base, single = make_model((), [9.0] * 4), make_model((FRICTION,), [1.0] * 4)
    pair = make_model((FRICTION, TAPER), [0.5, 0.5, 0.95, 0.95])
    assert choose_model([base, single, pair], np.arange(4)) is pair
    assert choose_model([base, single, pair], np.arange(1, 4)) is single
    chosen, stability = choose_stable_model([base, single, pair], 4)
    assert chosen is single
    assert stability == {FRICTION: 1.0}


def test_choice_stands_where_no_model_of_the_stable_names_may_be_named() -> None:
    tension = make_model((FRICTION, TENSION), [0.1] * 6)
    taper = make_model((FRICTION, TAPER), [0.22, 0.22, 0.045, 0.045, 0.045, 0.045])
    chosen, stability = choose_stable_model([BASE, tension, taper], 6)
    assert chosen in (tension, taper)
    assert stability[FRICTION] == 1.0
    assert min(stability.values()) < 0.8


def test_folds_in_which_the_device_diverges_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """With an infinite error of the device, every other model would seem to be equally good."""
    experiments = [replace(e, group=f"condition {k}") for k, e in enumerate(make_repeats([np.ones(100)] * 4))]
    selection = PredictiveSelection(WeightedData(Simulator(1), experiments, {}), {}, [])
    errors = {0: 1.0, 1: np.inf, 2: 3.0, 3: 4.0}
    monkeypatch.setattr(
        selection, "assess", lambda fit: make_model((), [errors[part.trial] for (part,) in selection.folds])
    )
    assert selection._assess_base(make_fit(())).errors.tolist() == [1.0, 3.0, 4.0]
    assert [part.trial for (part,) in selection.folds] == [0, 2, 3]
    errors = dict.fromkeys(range(4), np.inf)
    assert len(selection._assess_base(make_fit(())).errors) == 3  # nothing would be left


def test_model_without_any_stable_name_stays_as_it_is() -> None:
    friction = make_model((FRICTION,), [0.5, 2.0, 0.5, 2.0])
    taper = make_model((TAPER,), [2.0, 0.6, 2.0, 0.6])
    chosen, stability = choose_stable_model([make_model((), [9.0] * 4), friction, taper], 4)
    assert chosen.terms
    assert max(stability.values()) < 0.8


def make_result(
    chosen: PredictiveModel, rivals: list[PredictiveModel], stability: float, share: float
) -> PredictiveResult:
    stabilities = dict.fromkeys(chosen.terms, stability)
    return PredictiveResult(BASE, chosen, rivals, [chosen, BASE], stabilities, share, 0.0, "condition", 6)


@pytest.mark.parametrize(
    ("stability", "share", "has_rival", "verdict"),
    [
        (1.0, 0.9, False, "identified-in-part"),
        (0.5, 0.9, False, "unexplained"),
        (1.0, 0.1, False, "unexplained"),
        (1.0, 0.9, True, "indistinguishable"),
    ],
)
def test_verdict_needs_stable_names_that_explain_much(
    stability: float, share: float, has_rival: bool, verdict: str
) -> None:
    chosen = make_model((FRICTION,), [1.0] * 6)
    rivals = [make_model((TAPER,), [1.0] * 6)] if has_rival else []
    decision = decide_verdict(make_result(chosen, rivals, stability, share))
    assert decision.verdict == verdict
    assert "each condition from the others (6 of them)" in decision.reasons[0]


@pytest.mark.parametrize("fault", [RADIUS, GAIN])
@pytest.mark.parametrize(
    ("rival", "circumstances", "verdict"),
    [
        (None, {}, "unexplained"),
        (TURNS, {}, "unexplained"),
        (TAPER, {}, "indistinguishable"),
        (None, {"has_one_specimen": False}, "identified-in-part"),
        (None, {"has_repeats": False}, "identified-in-part"),
        (None, {"has_exact_inputs": False}, "identified-in-part"),
    ],
)
def test_fault_alone_is_not_named_in_part(
    fault: EffectTerm, rival: EffectTerm | None, circumstances: dict[str, bool], verdict: str
) -> None:
    """A wrong number leaves nothing in one specimen, and what is left says that something else is missing.

    A creep of the load cell, which is in no catalogue, was called a wrong zero of the load cell.
    """
    rivals = [make_model((rival,), [1.0] * 6)] if rival else []
    result = make_result(make_model((fault,), [1.0] * 6), rivals, 1.0, 0.9)
    assert decide_verdict(result, **circumstances).verdict == verdict


def test_no_effect_that_predicts_better_is_unexplained() -> None:
    decision = decide_verdict(make_result(BASE, [], 1.0, 0.0))
    assert decision.verdict == "unexplained"


def test_specimens_are_left_out_from_three_on() -> None:
    trials = [e for group in "abcd" for e in make_repeats([np.zeros(20)] * 2, group)]
    folds, kind = divide_into_folds(trials)
    assert (len(folds), kind) == (4, "condition")
    assert folds[0] == [FoldPart(0), FoldPart(1)]
    marked = [replace(e, specimen="ABC"[k % 3]) for k, e in enumerate(trials)]
    folds, kind = divide_into_folds(marked)
    assert (len(folds), kind) == (3, "specimen")
    assert sorted(part.trial for fold in folds for part in fold) == list(range(8))


def test_parts_of_few_conditions_cover_every_sample_once() -> None:
    trials = [
        replace(e, command=np.zeros(20), dt=0.005) for group in "ab" for e in make_repeats([np.zeros(20)] * 3, group)
    ]
    folds, kind = divide_into_folds(trials)
    assert kind == "part"
    counts = [sum(fold[k].select(e, "force").astype(int) for fold in folds) for k, e in enumerate(trials)]
    assert all((count == 1).all() for count in counts)


def test_parts_of_a_filling_share_its_rise() -> None:
    """Only the pressure is measured, and nearly all happens in the first sixth: several parts contain some of it."""
    time = 0.005 * np.arange(1200)
    rise = 6e5 * (1.0 - np.exp(-time / 0.3))
    trials = [
        replace(e, command=np.zeros(1200), dt=0.005, measured={"pressure": e.measured["force"]})
        for e in make_repeats([rise] * 2)
    ]
    folds, kind = divide_into_folds(trials)
    assert kind == "part"
    selected = [fold[0].select(trials[0], "pressure") for fold in folds]
    assert (np.sum(selected, axis=0) == 1).all()
    shares = [np.ptp(rise[part]) / np.ptp(rise) for part in selected]
    assert sum(share > 0.1 for share in shares) >= 3
    assert max(shares) < 0.6
    assert max(np.ptp(rise[200 * k : 200 * k + 200]) for k in range(6)) > 0.9 * np.ptp(rise)  # parts of equal duration
    flat = [replace(e, measured={"pressure": e.measured["pressure"]._replace(value=np.ones(1200))}) for e in trials]
    assert [fold[0].start for fold in divide_into_folds(flat)[0]] == pytest.approx(np.arange(6) / 6)


def test_error_of_the_law_is_shared_by_repeats() -> None:
    rng = np.random.default_rng(0)
    trials = make_repeats([rng.normal(size=400)] * 4)
    residuals = [{"force": 50.0 * np.sin(np.linspace(0.0, 3.0, 400))} for _ in trials]
    noise = {"force": Noise(2.0, (Autocorrelation(0.005, 1.0, 1600),))}
    simulator = Simulator(1)
    weighted = weight_by_law_error(WeightedData(simulator, trials, noise), trials, residuals)
    one = weight_by_law_error(WeightedData(simulator, trials[:1], noise), trials[:1], residuals[:1])
    simulator.close()
    assert weighted.noise["force"].std == pytest.approx(np.sqrt(np.mean(residuals[0]["force"] ** 2)))
    # Four repeats tell as much about the law as one.
    assert len(weighted.experiments) == 1
    assert weighted.n_effective == pytest.approx(one.n_effective)
    assert weighted.n_effective < 5.0


def make_candidate(term: EffectTerm, direction: np.ndarray, residual: np.ndarray) -> Candidate:
    unit = direction / np.linalg.norm(direction)
    gain = float(unit @ residual) ** 2
    return Candidate(term, gain, 1.0, direction, unit, 1.0, np.zeros(0), np.zeros(0))


def test_pair_that_explains_together_what_neither_does_alone_comes_first() -> None:
    # The residual is the difference of two nearly equal directions: each alone explains next to nothing.
    a, b, c = np.array([1.0, 0.3, 0.0]), np.array([1.0, -0.3, 0.0]), np.array([0.0, 0.5, 1.0])
    residual = -(a - b)
    friction, taper = EffectTerm("friction_offset", "table_3_1"), EffectTerm("regulator_error", "offset")
    candidates = [make_candidate(term, vector, residual) for term, vector in ((friction, a), (taper, b), (GAIN, c))]
    fit = replace(make_fit(()), weighted_residuals=residual)
    first, second, _ = screen_pairs(fit, candidates)[0]
    assert {first.term, second.term} == {friction, taper}


def test_fewer_than_two_candidates_make_no_pair() -> None:
    candidate = make_candidate(FRICTION, np.array([1.0]), np.array([2.0]))
    assert screen_pairs(make_fit(()), []) == []
    assert screen_pairs(make_fit(()), [candidate]) == []


def test_jackknife_covers_the_spread_of_the_refits() -> None:
    fit = replace(make_fit((FRICTION,), [1.0]), jacobian=np.array([[1e6]]), weighted_residuals=np.zeros(1))
    points = np.array([[0.9], [1.0], [1.1], [1.0]])
    model = PredictiveModel(fit, np.ones(4), points)
    ((low, high),) = compute_jackknife_intervals(model)
    scale = fit.hypothesis.parameters[0].scale
    half_width = 3.1824 * np.sqrt(3.0 / 4.0 * 0.02)
    assert (low, high) == pytest.approx(((1.0 - half_width) * scale, (1.0 + half_width) * scale), rel=1e-3)


def test_jackknife_of_a_parameter_without_influence_is_its_whole_range() -> None:
    fit = replace(make_fit((FRICTION,), [1.0]), jacobian=np.zeros((1, 1)), weighted_residuals=np.zeros(1))
    (interval,) = compute_jackknife_intervals(PredictiveModel(fit, np.ones(4), np.ones((4, 1))))
    (parameter,) = fit.hypothesis.parameters
    assert interval == pytest.approx(tuple(parameter.denormalize(float(end[0])) for end in fit.hypothesis.bounds()))


def test_nothing_at_a_bound_and_no_absurd_instrument_is_named() -> None:
    trials = make_repeats([np.linspace(0.0, 500.0, 100)] * 2)
    simulator = Simulator(1)
    data = WeightedData(simulator, trials, {})
    assert find_naming_obstacle(data, make_fit((FRICTION,), [1.0])) == ""
    assert "at its bound" in find_naming_obstacle(data, make_fit((FRICTION,), [0.0]))
    assert find_naming_obstacle(data, make_fit((GAIN,), [0.5])) == ""  # 2.5 %
    assert "further off" in find_naming_obstacle(data, make_fit((GAIN,), [8.0]))  # 40 %
    simulator.close()


@pytest.mark.parametrize(("channel", "is_refused"), [("pressure", True), ("force", False)])
def test_absurd_gauge_does_not_stand_in_for_the_supply(channel: str, is_refused: bool) -> None:
    """Where the pressure alone was measured, a gauge that is off by 40 % is refused before a name is chosen."""
    trials = [
        replace(e, measured={channel: e.measured["force"]}) for e in make_repeats([np.linspace(0.0, 6e5, 100)] * 2)
    ]
    noise = {channel: Noise(3.0, (Autocorrelation(0.005, 1.0, 200),))}
    simulator = Simulator(1)
    search = ForwardSelection(WeightedData(simulator, trials, noise), [], [])
    gauge = EffectTerm("sensor_gain", "linear", channel)
    before = replace(make_fit(()), residuals=[{channel: np.zeros(100)}] * 2)
    reason = search.rejection_reason(before, make_fit((gauge,), [8.0]), {})
    assert ("further off" in reason) == is_refused
    simulator.close()


def test_exponent_of_an_isothermal_change_is_no_obstacle_to_a_name() -> None:
    trials = make_repeats([np.linspace(0.0, 500.0, 100)] * 2)
    simulator = Simulator(1)
    data = WeightedData(simulator, trials, {})
    fit = make_fit((EffectTerm("volume_coupling", "polytropic"),), [1.0, 0.0])
    exponent = fit.hypothesis.parameters[-1]
    for value, obstacle in ((1.0, ""), (1.2, ""), (1.4, "")):
        x = np.array([*fit.x[:-1], exponent.normalize(value)])
        assert find_naming_obstacle(data, replace(fit, x=x)) == obstacle
    assert "'recovery_s' at its bound" in find_naming_obstacle(data, make_fit(fit.hypothesis.terms, [0.0, 0.1]))
    simulator.close()


def test_only_the_lower_end_of_the_critical_ratio_is_a_limit_of_physics() -> None:
    trials = make_repeats([np.linspace(0.0, 500.0, 100)] * 2)
    simulator = Simulator(1)
    data = WeightedData(simulator, trials, {})
    fit = make_fit((EffectTerm("choked_valve", "symmetric"),), [1.0, 0.0])
    ratio = fit.hypothesis.parameters[-1]
    for value, is_refused in ((0.01, False), (0.3, False), (0.6, True)):
        obstacle = find_naming_obstacle(data, replace(fit, x=np.array([fit.x[0], ratio.normalize(value)])))
        assert ("'critical_ratio' at its bound" in obstacle) == is_refused
    simulator.close()


@pytest.mark.parametrize(("length_m", "is_refused"), [(0.004, True), (0.12, True), (0.13, False), (2.0, False)])
def test_hose_that_is_a_nozzle_is_not_named(length_m: float, is_refused: bool) -> None:
    trials = make_repeats([np.linspace(0.0, 500.0, 100)] * 2)
    noise = {"force": Noise(3.0, (Autocorrelation(0.005, 1.0, 200),))}
    simulator = Simulator(1)
    data = WeightedData(simulator, trials, noise)
    fit = make_fit((EffectTerm("hose", "tube"),), [1.0, 0.0])
    x = [p.normalize(value) for p, value in zip(fit.hypothesis.parameters, (length_m, 5.0), strict=True)]
    short = replace(fit, x=np.array(x))
    before = replace(make_fit(()), residuals=[{"force": np.zeros(100)}] * 2)
    reasons = find_naming_obstacle(data, short), ForwardSelection(data, [], []).rejection_reason(before, short, {})
    for reason in reasons:
        assert reason.startswith(f"hose would be {1e3 * length_m:.2g} mm long and 5 mm wide") == is_refused
    simulator.close()


@pytest.mark.parametrize(("share", "is_refused"), [(0.4, False), (1.2, False), (1.3, True), (2.3, True)])
def test_wall_thicker_than_it_is_is_not_named(share: float, is_refused: bool) -> None:
    """Thresholds that the catalogue did not have were called a wall of 1.4 to 2.3 times its influence."""
    fit = make_fit((EffectTerm("thick_wall_bladder", "mooney_rivlin"),), [share])
    (parameter,) = fit.hypothesis.parameters
    (reason,) = find_infeasible_terms(replace(fit, x=np.array([parameter.normalize(share)]))).values() or [""]
    assert reason == (f"would have {share:.2f} times the influence of the whole wall" if is_refused else "")


def test_channel_that_only_another_repeat_measured_counts() -> None:
    first, second = make_repeats([np.ones(100), np.full(90, 2.0)])[:2]
    simulator = Simulator(1)
    second = replace(second, measured={**second.measured, "pressure": second.measured["force"]})
    residuals = [{c: s.value for c, s in e.measured.items()} for e in (first, second)]
    noise = estimate_noise_from_residuals([first, second], residuals)
    kept = weight_by_law_error(WeightedData(simulator, [first, second], noise), [first, second], residuals)
    simulator.close()
    counted = [(e.name, channel) for e in kept.experiments for channel in e.measured]
    assert counted == [("g1", "force"), ("g1", "pressure")]  # the second has more samples
    longer = replace(second, measured={"force": second.measured["force"], "pressure": second.measured["pressure"]})
    first = replace(first, measured={"force": first.measured["force"], "muscle_length": first.measured["force"]})
    residuals = [{c: s.value for c, s in e.measured.items()} for e in (first, longer)]
    noise = estimate_noise_from_residuals([first, longer], residuals)
    kept = weight_by_law_error(WeightedData(simulator, [first, longer], noise), [first, longer], residuals)
    counted = [(e.name, channel) for e in kept.experiments for channel in e.measured]
    assert counted == [("g0", "force"), ("g0", "muscle_length"), ("g1", "pressure")]


def test_noise_has_the_weights_of_the_errors() -> None:
    """A channel of one trial only counts in one fold, for the noise as for the errors."""
    experiments = [replace(e, group=f"condition {k}") for k, e in enumerate(make_repeats([np.ones(50)] * 4))]
    force = experiments[0].measured["force"]
    experiments[0] = replace(experiments[0], measured={"force": force, "pressure": force})
    law = {"force": Noise(10.0, ()), "pressure": Noise(1.0, ())}
    noise_std = {"force": 1.0, "pressure": 0.8}
    selection = PredictiveSelection(WeightedData(Simulator(1), experiments, law), noise_std, [])
    residuals = {k: {c: np.full(50, noise_std[c]) for c in e.measured} for k, e in enumerate(experiments)}
    errors = [selection.compute_fold_error(fold, residuals) for fold in selection.folds]
    assert [selection.compute_fold_noise(fold) for fold in selection.folds] == pytest.approx(errors)
    assert np.mean(errors) == pytest.approx((0.5 * (0.01 + 0.64) + 3 * 0.01) / 4)
    # Without repeats, the noise of a slow channel is unknown; that of another one does not stand in for it.
    selection.noise_std = {"pressure": 0.8}
    noise = [selection.compute_fold_noise(fold) for fold in selection.folds]
    assert noise == pytest.approx([0.5 * 0.64, 0.0, 0.0, 0.0])


def test_forms_that_contain_that_of_a_leading_single_are_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Coulomb friction that takes nearly as much as the best effect may be a Stribeck friction that takes more."""

    def make_single(term: EffectTerm, chi2: float) -> Fit:
        return replace(make_fit((term,)), weighted_residuals=np.array([np.sqrt(chi2)]))

    braid = EffectTerm("braid_hysteresis", "coulomb")
    singles = [make_single(braid, 10.0), make_single(FRICTION, 18.0), make_single(TAPER, 40.0)]
    refits = {
        FRICTION: make_single(FRICTION._replace(form="stribeck"), 2.0),
        braid: make_single(braid._replace(form="maxwell_slip"), 9.9),  # it does not pay for its parameter
    }
    monkeypatch.setattr(
        predictive_selection, "refit_with_containing_forms", lambda data, fit, term, **_: [refits[term]]
    )
    monkeypatch.setattr(WeightedData, "n_effective", 100.0)
    base = replace(make_fit(()), weighted_residuals=np.array([10.0]))
    selection = object.__new__(PredictiveSelection)
    selection.data = WeightedData(Simulator(1), [], {})
    assert selection._refit_leading_forms(base, singles) == [refits[FRICTION]]
    assert selection._refit_leading_forms(base, []) == []


def test_parameter_that_the_data_do_not_determine_stays_when_a_condition_is_left_out() -> None:
    """A linear step without a limit would move it to its bound, where the linear model does not hold."""
    rng, n = np.random.default_rng(2), 200
    rows = [rng.normal(0.0, 1.0, n) for _ in range(4)]
    experiments = [replace(e, group=f"condition {k}") for k, e in enumerate(make_repeats(rows))]
    data = WeightedData(Simulator(1), experiments, {"force": Noise(1.0, (Autocorrelation(5e-3, 1.0, n),))})
    selection = PredictiveSelection(data, {}, [])
    presliding = EffectTerm("seal_friction", "presliding")
    fit = make_fit((presliding,), [1.0, 0.3])
    jacobian = np.column_stack([rng.normal(0.0, 3.0, 4 * n), 1e-3 * rng.normal(0.0, 1.0, 4 * n)])
    fit = replace(fit, weighted_residuals=np.concatenate(rows) + 0.5 * jacobian[:, 0], jacobian=jacobian)
    for fold in selection.folds:
        determined, free = selection._leave_out(fit, fold) - fit.x
        assert determined == pytest.approx(-0.5, abs=0.05)
        assert abs(free) < 0.1  # its own standard error is 40
