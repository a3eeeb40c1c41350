"""Wrong numbers of a device as candidates, and the numbers that depend on fitted ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.device.device import Device, list_presets, load_device
from klute_sim.device.schema.limits import find_limits
from klute_sim.diagnosis.device_file import augment_device
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.fitting.dependent_numbers import (
    SAME_ANGLE,
    SAME_RADIUS,
    SAME_RATIO,
    complete_numbers,
    limit_to_valid,
)
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.number_error import (
    NUMBER_ERROR_NAME,
    compute_plausible_error,
    list_error_candidates,
)
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.candidates import list_contradicted_numbers, list_further_terms
from klute_sim.diagnosis.selection.naming import find_naming_obstacle, find_numbers_at_limit, find_terms_at_bound
from klute_sim.laws.mckibben import compute_braid_radius
from klute_sim.plausibility.device_numbers import RANGES, check_device_numbers, limit_to_plausible
from klute_sim.report.diagnosis.text import format_term

NOMINAL = load_device("klute-3-4-pair")
RADIUS = "muscle.bladder_radius_mm"


def make_number_term(key: str) -> EffectTerm:
    return EffectTerm(NUMBER_ERROR_NAME, "value", number=key)


def make_trial(device: Device = NOMINAL) -> BenchExperiment:
    return BenchExperiment("a", "g", "fit", device, 0.0, 0.01, np.zeros(3), {}, unit_length=np.full(3, 0.34))


def make_fit(hypothesis: Hypothesis, x: np.ndarray) -> Fit:
    return Fit(hypothesis, x, np.zeros(len(x)), np.eye(len(x)), True, [])


def test_candidates_are_all_numbers_but_counts_zeros_and_the_foot() -> None:
    spec = load_device("klute-1-1-4-pair").spec
    candidates = list_error_candidates(spec)
    values = spec.collect_values()
    assert "muscle.count" not in candidates
    assert not [key for key in candidates if key.startswith("foot.")]
    assert all(values[key] != 0.0 for key in candidates)
    assert {"tendon.slack_length_mm", "supply.gas_temperature_c", "damper.bore_mm"} <= candidates.keys()
    assert all(error > 0.0 for error in candidates.values())


LAGGING = NOMINAL.with_effect("pressure_lag", form="first_order", time_constant_s=0.03)
TIME_CONSTANT = "effects.pressure_lag.time_constant_s"


def test_numbers_of_declared_effects_are_candidates() -> None:
    """Their words name the effect. At its lower bound, the device has no such effect."""
    errors = list_error_candidates(LAGGING.with_effect("unknown_pressure", form="sparse", delay_s=0.01).spec)
    assert [key for key in errors if key.startswith("effects.")] == [TIME_CONSTANT]
    assert errors[TIME_CONSTANT] == pytest.approx(0.015)
    term = make_number_term(TIME_CONSTANT)
    assert format_term(term) == "time constant of the pressure lag"
    hypothesis = Hypothesis(LAGGING, (), (), (term,))
    (lower,), (upper,) = hypothesis.bounds()
    assert find_terms_at_bound(make_fit(hypothesis, np.array([lower]))) == []
    assert find_terms_at_bound(make_fit(hypothesis, np.array([upper]))) == [term]
    (setup,) = hypothesis.build_setups(np.array([1.0]), [make_trial(LAGGING)])
    expected = LAGGING.with_effect("pressure_lag", form="first_order", time_constant_s=0.045)
    assert setup.parameters == expected.parameters


@pytest.mark.parametrize(("key", "may_change_sign"), [("model.site.a.pos_x", True), ("model.geom.a.mass", False)])
def test_only_a_coordinate_may_change_its_sign(key: str, may_change_sign: bool) -> None:
    bounds = {}
    for sign in (1.0, -1.0):
        nominal = sign * 0.2 * 6.0 * compute_plausible_error(key, 1.0)
        hypothesis = Hypothesis(NOMINAL, (), (), (make_number_term(key),), rig_numbers=((key, nominal),))
        bounds[sign] = [hypothesis.parameters[0].lower, hypothesis.parameters[0].upper]
    assert (bounds[1.0][0] < 0.0) == may_change_sign
    if may_change_sign:  # the mirrored model has the mirrored bounds
        assert bounds[-1.0] == pytest.approx([-bounds[1.0][1], -bounds[1.0][0]])


@pytest.mark.parametrize(("quantity", "may_change_sign"), [("springref", True), ("ipos_x", True), ("stiffness", False)])
def test_uncertain_number_with_a_sign_may_change_it(quantity: str, may_change_sign: bool) -> None:
    key = f"model.joint.a.{quantity}"
    hypothesis = Hypothesis(NOMINAL, ((key, 0.2),), (), rig_numbers=((key, 0.05),))
    assert (hypothesis.parameters[0].lower < 0.0) == may_change_sign


def test_wrong_number_changes_the_device() -> None:
    term = make_number_term("tendon.slack_length_mm")
    hypothesis = Hypothesis(NOMINAL, (("tendon.stiffness_1_n_per_mm", 6.0),), ()).with_term(term)
    assert hypothesis.n_prior_parameters == 1
    x = np.array([0.0, 1.5])
    error = compute_plausible_error("tendon.slack_length_mm", 100.0)
    trial = BenchExperiment("a", "g", "fit", NOMINAL, 0.0, 0.01, np.zeros(3), {}, unit_length=np.full(3, 0.34))
    (setup,) = hypothesis.build_setups(x, [trial])
    assert setup.parameters.tendon.slack_length == pytest.approx(1e-3 * (100.0 + 1.5 * error))
    assert augment_device(make_fit(hypothesis, x), "data").spec.collect_values()["tendon.slack_length_mm"] == (
        pytest.approx(100.0 + 1.5 * error)
    )
    # At the nominal value nothing changes, to the last bit.
    assert hypothesis.build_setups(np.zeros(2), [trial])[0].parameters == NOMINAL.parameters


@settings(max_examples=60, deadline=None)
@given(
    name=st.sampled_from(list_presets()),
    offsets=st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6),
    fits_radius=st.booleans(),
)
def test_every_fit_is_a_valid_device_file(name: str, offsets: list[float], fits_radius: bool) -> None:
    device = load_device(name)
    values = device.spec.collect_values()
    fractions = {"muscle.braid_length_ratio": 0.2, "muscle.turns_per_m": 0.2, "muscle.bladder_thickness_mm": 0.2}
    fractions |= {"muscle.c10_kpa": 0.6, "supply.pressure_bar": 0.6, **({RADIUS: 0.2} if fits_radius else {})}
    hypothesis = Hypothesis(device, tuple((key, part * values[key]) for key, part in fractions.items()), ())
    lower, upper = hypothesis.bounds()
    x = np.clip(np.array(offsets[: len(fractions)]), lower, upper)
    fitted = augment_device(make_fit(hypothesis, x), "data")
    assert check_device_numbers(fitted.spec.collect_values(), "") == []
    # The file simulates what the fit simulated.
    (setup,) = hypothesis.build_setups(x, [make_trial(device)])
    assert setup.parameters.muscle == pytest.approx(fitted.parameters.muscle, rel=1e-12)


def test_radius_follows_braid_and_turns_unless_it_is_fitted() -> None:
    values = NOMINAL.spec.collect_values()
    turns = 0.9 * values["muscle.turns_per_m"]
    changed = complete_numbers(values, {"muscle.turns_per_m": turns})
    assert changed[RADIUS] == pytest.approx(values[RADIUS] / 0.9)
    assert complete_numbers(values, {"muscle.c10_kpa": 100.0}) == {"muscle.c10_kpa": 100.0}
    both = complete_numbers(values, {"muscle.turns_per_m": turns, RADIUS: values[RADIUS]})
    braid_radius = 1e3 * compute_braid_radius(values["muscle.braid_length_ratio"], 1.0, turns)
    assert 0.95 * braid_radius < both[RADIUS] < 1.06 * braid_radius


def test_radius_at_the_same_braid_angle_changes_the_turns() -> None:
    """tan(angle) = 2 pi R N / L0, and B / L0 = 1 / cos(angle), which is the ratio of the file."""
    term = EffectTerm(NUMBER_ERROR_NAME, SAME_ANGLE, number=RADIUS)
    hypothesis = Hypothesis(NOMINAL, (), ()).with_term(term)
    fitted = augment_device(make_fit(hypothesis, np.array([-2.0])), "data")
    before, after = NOMINAL.spec.collect_values(), fitted.spec.collect_values()
    assert after[RADIUS] == pytest.approx(before[RADIUS] - 0.2)
    assert after[RADIUS] * after["muscle.turns_per_m"] == pytest.approx(before[RADIUS] * before["muscle.turns_per_m"])
    changed = {key for key, value in before.items() if after[key] != value}
    assert changed == {RADIUS, "muscle.turns_per_m"}
    alone = augment_device(make_fit(Hypothesis(NOMINAL, (), (), (make_number_term(RADIUS),)), np.array([-2.0])), "data")
    assert alone.spec.collect_values()["muscle.turns_per_m"] == before["muscle.turns_per_m"]
    assert format_term(term) == "bladder radius of the muscle at the same braid angle"
    # Alone, the radius stays near that of the braid.
    (wide,), (narrow,) = (h.bounds()[1] for h in (hypothesis, Hypothesis(NOMINAL, (), (), (make_number_term(RADIUS),))))
    assert wide > narrow
    assert hypothesis.build_setups(np.zeros(1), [make_trial()])[0].parameters == NOMINAL.parameters


def test_turns_at_the_same_radius_change_the_length_of_the_braid() -> None:
    term = EffectTerm(NUMBER_ERROR_NAME, SAME_RADIUS, number="muscle.turns_per_m")
    hypothesis = Hypothesis(NOMINAL, (), ()).with_term(term)
    before = NOMINAL.spec.collect_values()
    after = before | hypothesis.correct_numbers(NOMINAL, None, hypothesis.values(np.array([1.5])))
    assert after["muscle.turns_per_m"] == pytest.approx(1.03 * before["muscle.turns_per_m"])
    radii = [
        compute_braid_radius(v["muscle.braid_length_ratio"], 1.0, v["muscle.turns_per_m"]) for v in (before, after)
    ]
    assert radii[1] == pytest.approx(radii[0])
    assert {key for key, value in before.items() if after[key] != value} == {
        "muscle.turns_per_m",
        "muscle.braid_length_ratio",
    }
    assert format_term(term) == "turns of the muscle and braid length at the same radius"
    assert hypothesis.build_setups(np.zeros(1), [make_trial()])[0].parameters == NOMINAL.parameters


@pytest.mark.parametrize("is_reversed", [False, True])
def test_wrong_radius_and_wrong_angle_do_not_depend_on_their_order(is_reversed: bool) -> None:
    """The length of the braid follows from the angle alone: B / L0 = 1 / cos(angle)."""
    terms = [
        EffectTerm(NUMBER_ERROR_NAME, SAME_RADIUS, number="muscle.turns_per_m"),
        EffectTerm(NUMBER_ERROR_NAME, SAME_ANGLE, number=RADIUS),
    ]
    hypothesis = Hypothesis(NOMINAL, (), (), tuple(terms[::-1] if is_reversed else terms))
    x = np.array([1.5, -2.0])
    both = hypothesis.correct_numbers(NOMINAL, None, hypothesis.values(x[::-1] if is_reversed else x))
    alone = Hypothesis(NOMINAL, (), (), (terms[0],))
    angle_only = alone.correct_numbers(NOMINAL, None, alone.values(x[:1]))
    assert both["muscle.braid_length_ratio"] == angle_only["muscle.braid_length_ratio"]
    before = NOMINAL.spec.collect_values()[RADIUS]
    assert both["muscle.turns_per_m"] == pytest.approx(angle_only["muscle.turns_per_m"] * before / both[RADIUS])


def test_moduli_of_another_rubber_change_in_proportion() -> None:
    term = EffectTerm(NUMBER_ERROR_NAME, SAME_RATIO, number="muscle.c10_kpa")
    hypothesis = Hypothesis(NOMINAL, (), ()).with_term(term)
    before = NOMINAL.spec.collect_values()
    corrected = hypothesis.correct_numbers(NOMINAL, None, hypothesis.values(np.array([3.0])))
    assert corrected.keys() == {"muscle.c10_kpa", "muscle.c01_kpa"}
    assert [corrected[key] / before[key] for key in corrected] == pytest.approx([1.3, 1.3])
    assert format_term(term) == "c10 of the muscle and c01 in the same ratio"
    assert hypothesis.build_setups(np.zeros(1), [make_trial()])[0].parameters == NOMINAL.parameters


def test_radius_stays_if_braid_or_turns_are_wrong() -> None:
    values = NOMINAL.spec.collect_values()
    turns = {"muscle.turns_per_m": 1.01 * values["muscle.turns_per_m"]}
    assert complete_numbers(values, turns, turns) == turns
    many = {"muscle.turns_per_m": 1.1 * values["muscle.turns_per_m"]}  # The file has to stay valid.
    assert complete_numbers(values, many, many)[RADIUS] < values[RADIUS]
    hypothesis = Hypothesis(NOMINAL, (), (), (make_number_term("muscle.turns_per_m"),))
    assert hypothesis.correct_numbers(NOMINAL, None, list(turns.values())) == pytest.approx(turns)
    # An uncertain braid moves the radius, wrong turns beside it do not.
    braid = {"muscle.braid_length_ratio": 1.001 * values["muscle.braid_length_ratio"]}
    changed = complete_numbers(values, {**braid, **turns}, turns)
    assert changed[RADIUS] == pytest.approx(complete_numbers(values, braid)[RADIUS])


@pytest.mark.parametrize("key", [RADIUS, "muscle.bladder_thickness_mm"])
def test_bladder_ends_where_the_braid_holds_it(key: str) -> None:
    """Beyond that the number would change nothing, and its fit would have no bound to report."""
    hypothesis = Hypothesis(NOMINAL, (), (), (make_number_term(key),))
    (parameter,) = hypothesis.parameters
    for end in (parameter.lower, parameter.upper):
        assert hypothesis.correct_numbers(NOMINAL, None, [end])[key] == pytest.approx(end, rel=1e-12)
    assert parameter.lower < parameter.initial < parameter.upper
    wide = limit_to_valid(NOMINAL.spec.collect_values(), RADIUS, 3.0, 12.0)
    assert 6.0 < wide[0] < 6.4 < wide[1] < 6.7  # 5 % about the braid
    assert limit_to_valid(NOMINAL.spec.collect_values(), "muscle.c10_kpa", 1.0, 900.0) == (1.0, 900.0)


def test_bladder_on_one_tendon_ends_where_its_own_braid_holds_it() -> None:
    values = NOMINAL.spec.collect_values()
    shared = Hypothesis(NOMINAL, (), (), (make_number_term(RADIUS),)).parameters[0]
    numbers = (
        (f"flexor/{RADIUS}", values[RADIUS]),
        ("extensor/muscle.turns_per_m", 0.9 * values["muscle.turns_per_m"]),
    )
    numbers += ((f"extensor/{RADIUS}", 1.1 * values[RADIUS]),)
    flexor, extensor = (
        Hypothesis(NOMINAL, ((f"{tendon}/{RADIUS}", 5.0),), (), rig_numbers=numbers).parameters[0]
        for tendon in ("flexor", "extensor")
    )
    assert (flexor.lower, flexor.upper) == pytest.approx((shared.lower, shared.upper))
    assert extensor.lower == pytest.approx(flexor.lower / 0.9)  # fewer turns, a wider braid
    assert extensor.upper == pytest.approx(flexor.upper / 0.9)


def test_uncertain_number_may_be_wrong_besides() -> None:
    key, deviation = "tendon.slack_length_mm", 1.0
    hypothesis = Hypothesis(NOMINAL, ((key, deviation),), (), (make_number_term(key),))
    declared = NOMINAL.spec.collect_values()[key]
    assert hypothesis.collect_numbers([declared, declared]) == {key: declared}
    assert hypothesis.collect_numbers([declared - 0.5, declared + 4.0]) == {key: pytest.approx(declared + 3.5)}
    # Screening starts at the bound of the uncertain number: the neutral term changes nothing there.
    (setup,) = hypothesis.build_setups(np.array([3.0, 0.0]), [make_trial()])
    assert setup.parameters.tendon.slack_length == pytest.approx(1e-3 * (declared + 3.0))


def test_contradicted_number_is_one_whose_plausible_error_is_larger_than_its_declared_one() -> None:
    slack, rubber = "tendon.slack_length_mm", "muscle.c10_kpa"
    values = NOMINAL.spec.collect_values()
    narrow = Hypothesis(NOMINAL, ((slack, 1.0), (rubber, 0.1 * values[rubber])), ())
    assert list_contradicted_numbers(make_fit(narrow, np.array([3.0, 2.9]))) == {slack}
    assert list_contradicted_numbers(make_fit(narrow, np.array([2.9, -3.0]))) == {rubber}
    wide = Hypothesis(NOMINAL, ((slack, 10.0),), ())
    assert list_contradicted_numbers(make_fit(wide, np.array([3.0]))) == set()
    # A bladder that fills its braid cannot be wider, whatever was declared: the data contradict nothing.
    radius = Hypothesis(NOMINAL, ((RADIUS, 0.2),), ())
    lower, upper = radius.bounds()
    assert upper[0] < 3.0
    assert list_contradicted_numbers(make_fit(radius, upper)) == set()
    assert list_contradicted_numbers(make_fit(radius, np.array([-3.0]))) == ({RADIUS} if lower[0] == -3.0 else set())


def test_declared_number_is_a_candidate_where_a_fit_contradicts_it() -> None:
    slack, rubber = "tendon.slack_length_mm", "muscle.c10_kpa"
    terms = [make_number_term(slack), make_number_term(rubber)]
    hypothesis = Hypothesis(NOMINAL, ((slack, 1.0),), ())
    assert list_further_terms(terms, make_fit(hypothesis, np.array([2.9]))) == terms[1:]
    assert list_further_terms(terms, make_fit(hypothesis, np.array([3.0]))) == terms
    with_rubber = make_fit(hypothesis.with_term(terms[1]), np.array([3.0, 0.1]))
    assert list_further_terms(terms, with_rubber) == terms[:1]


def test_number_at_the_limit_of_its_declared_uncertainty_forbids_a_name() -> None:
    slack, friction = "tendon.slack_length_mm", EffectTerm("braid_hysteresis", "coulomb")
    data = WeightedData(None, [make_trial()], {})
    declared = Hypothesis(NOMINAL, ((slack, 1.0),), ())
    named = declared.with_term(friction)
    assert find_numbers_at_limit(make_fit(named, np.array([-3.0, 0.1]))) == [slack]
    assert slack in find_naming_obstacle(data, make_fit(named, np.array([-3.0, 0.1])))
    assert slack in find_naming_obstacle(data, make_fit(named, np.array([-2.97, 0.1])))  # just short of it
    assert not find_naming_obstacle(data, make_fit(named, np.array([-2.9, 0.1])))
    assert not find_naming_obstacle(data, make_fit(declared, np.array([3.0])))  # nothing is named
    # A limit of physics, here that of a positive number, is a value like others.
    wide = Hypothesis(NOMINAL, ((slack, 1000.0),), ()).with_term(friction)
    lower, _ = wide.bounds()
    assert find_numbers_at_limit(make_fit(wide, np.array([lower[0], 0.1]))) == []


def test_fitted_numbers_stay_plausible_if_the_declared_ones_are() -> None:
    low, high, _ = RANGES["muscle.c10_kpa"]
    assert limit_to_plausible("muscle.c10_kpa", 100.0, 0.1, 1e6) == (low, high)
    assert limit_to_plausible("muscle.c10_kpa", 100.0, 50.0, 200.0) == (50.0, 200.0)
    assert limit_to_plausible("muscle.c10_kpa", 0.1 * low, 0.0, 1e6) == (0.0, 1e6)
    assert limit_to_plausible("effects.hose.length_m", 1.0, 0.0, 2.0) == (0.0, 2.0)
    assert limit_to_plausible("supply.gas_temperature_c", 20.0, -50.0, 25.0) == (-30.0, 25.0)


def test_limits_are_those_of_the_device_file() -> None:
    assert find_limits("muscle.braid_length_ratio")[0] == 1.001
    lower, upper = find_limits("tendon.stiffness_1_n_per_mm")
    assert lower > 0.0
    assert upper >= 1e3
    assert find_limits("effects.seal_friction.force_n") == (0.0, 500.0)
