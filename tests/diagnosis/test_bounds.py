"""No effect with a parameter at its bound is named, nor an alternative to a name: a simpler form is, or nothing."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis import final_model, workflow
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.imperfect_law import ImperfectLawDecision
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise
from klute_sim.diagnosis.result import DiagnosisOptions, Verdict
from klute_sim.diagnosis.selection import bounds, predictive_selection, robustness
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.naming import find_naming_obstacle, find_terms_at_bound
from klute_sim.diagnosis.selection.predictive_model import PredictiveModel
from klute_sim.diagnosis.selection.predictive_selection import PredictiveSelection
from klute_sim.diagnosis.selection.robustness import (
    EquivalentModel,
    find_equivalent_models,
    refine_and_simplify,
    select_final_fit,
)
from klute_sim.diagnosis.selection.selection_step import SelectionStep
from tests.diagnosis.synthetic_dataset import make_repeats

DEVICE = load_device("klute-3-4-pair")
COULOMB, STRIBECK = EffectTerm("seal_friction", "coulomb"), EffectTerm("seal_friction", "stribeck")
PRESLIDING = EffectTerm("seal_friction", "presliding")
RELAXATION, THRESHOLD = EffectTerm("bladder_relaxation", "maxwell"), EffectTerm("threshold_pressure", "constant")
GAIN, HOSE = EffectTerm("sensor_gain", "linear", "force"), EffectTerm("hose", "tube")
AT_BOUND, INSIDE = 3.0, 0.6
"""Stick fractions of a Stribeck friction: its largest one, and one within its bounds."""


def make_fit(*terms: EffectTerm, chi2: float = 0.0, **values: float) -> Fit:
    """Return a fit of ``terms`` with typical parameters, or those of ``values``, and its ``chi2``."""
    hypothesis = Hypothesis(DEVICE, (), (("force", 3.0),), terms)
    x = [
        p.normalize(values[p.name]) if p.name in values else 0.0 if p.is_logarithmic else 1.0
        for p in hypothesis.parameters
    ]
    return Fit(hypothesis, np.array(x), np.array([np.sqrt(chi2)]), np.ones((1, len(x))), True, [])


@pytest.fixture
def data() -> Iterator[WeightedData]:
    noise = {"force": Noise(3.0, (Autocorrelation(0.005, 1.0, 200),))}
    simulator = Simulator(1)
    yield WeightedData(simulator, make_repeats([np.linspace(0.0, 500.0, 100)] * 2), noise)
    simulator.close()


Refits = Mapping[tuple[EffectTerm, ...], Fit]


@pytest.fixture
def replace_fits(monkeypatch: pytest.MonkeyPatch) -> Callable[[Refits], None]:
    """Return a function that replaces refined fits, and refits with a simpler form, by the one of their terms.

    Other simpler forms explain nothing.
    """

    def install(refits: Refits) -> None:
        def refine(data: WeightedData, hypothesis: Hypothesis, *_: Any, **__: Any) -> Fit:
            return refits[hypothesis.terms]

        def simplify(data: WeightedData, fit: Fit, term: EffectTerm, simpler: EffectTerm) -> Fit:
            terms = tuple(simpler if t == term else t for t in fit.hypothesis.terms)
            return refits[terms] if terms in refits else make_fit(*terms, chi2=1e3)

        def check(data: WeightedData, fit: Fit, rng: np.random.Generator) -> tuple[Fit, bool]:
            return refits[fit.hypothesis.terms], True

        monkeypatch.setattr(bounds, "fit_hypothesis", refine)
        monkeypatch.setattr(robustness, "fit_hypothesis", refine)
        monkeypatch.setattr(bounds, "refit_with_replacement", simplify)
        monkeypatch.setattr(robustness, "check_convergence", check)
        monkeypatch.setattr(predictive_selection, "check_convergence", check)

    return install


@pytest.mark.parametrize(
    ("chi2", "displacement", "expected"),
    [(0.0, 0.5, PRESLIDING), (5.0, 0.5, COULOMB), (0.0, 0.05, COULOMB)],
    ids=["explains more", "explains no more", "is at its bound, too"],
)
def test_form_at_its_bound_becomes_the_simpler_one_with_the_lowest_bic(
    chi2: float,
    displacement: float,
    expected: EffectTerm,
    data: WeightedData,
    replace_fits: Callable[[Refits], None],
) -> None:
    presliding = make_fit(PRESLIDING, GAIN, chi2=chi2, presliding_mm=displacement)
    replace_fits({(COULOMB, GAIN): make_fit(COULOMB, GAIN, chi2=6.0), (PRESLIDING, GAIN): presliding})
    shaped = make_fit(STRIBECK, GAIN, stick_fraction=AT_BOUND)
    assert find_terms_at_bound(shaped) == [STRIBECK]
    assert bounds.simplify_at_bound(data, shaped).hypothesis.terms == (expected, GAIN)


def test_form_within_its_bounds_and_the_only_form_remain(data: WeightedData) -> None:
    inside = make_fit(STRIBECK, stick_fraction=INSIDE)
    assert bounds.simplify_at_bound(data, inside) is inside
    only_form = make_fit(RELAXATION, time_constant_s=100.0)
    assert find_terms_at_bound(only_form) == [RELAXATION]
    assert bounds.simplify_at_bound(data, only_form) is only_form


@pytest.mark.parametrize("is_explained", [True, False])
def test_final_fit_at_a_bound_takes_a_simpler_form_that_explains_the_data(
    is_explained: bool,
    data: WeightedData,
    replace_fits: Callable[[Refits], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The last fit moves the shape to its bound, where nobody looked again."""
    search = ForwardSelection(data, [], [])
    replace_fits({(STRIBECK,): make_fit(STRIBECK, stick_fraction=AT_BOUND), (COULOMB,): make_fit(COULOMB)})
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: not is_explained)
    fit, has_converged = refine_and_simplify(
        search, make_fit(STRIBECK, stick_fraction=INSIDE), np.random.default_rng(0)
    )
    assert fit.hypothesis.terms == ((COULOMB,) if is_explained else (STRIBECK,))
    assert has_converged


@pytest.mark.parametrize(
    ("chi2", "has_misfit", "expected"),
    [
        pytest.param(0.5, False, PRESLIDING, id="explains the data"),
        pytest.param(500.0, False, COULOMB, id="decisively worse"),
        pytest.param(0.5, True, COULOMB, id="leaves a misfit"),
    ],
)
def test_final_fit_at_a_bound_takes_a_form_that_contains_it(
    chi2: float,
    has_misfit: bool,
    expected: EffectTerm,
    data: WeightedData,
    replace_fits: Callable[[Refits], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    replace_fits({(t,): make_fit(t, chi2=chi2 if t is PRESLIDING else 0.0) for t in (COULOMB, PRESLIDING)})
    monkeypatch.setattr(robustness, "simplify_at_bound", lambda data, fit: fit)
    monkeypatch.setattr(robustness, "extend_at_bound", lambda data, fit: make_fit(PRESLIDING, chi2=chi2))
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: has_misfit)
    fit, has_converged = refine_and_simplify(
        ForwardSelection(data, [], []), make_fit(COULOMB), np.random.default_rng(0)
    )
    assert (fit.hypothesis.terms, has_converged) == ((expected,), True)


@pytest.mark.parametrize(
    ("number", "end", "is_obstacle"),
    [
        ("muscle.bladder_radius_mm", 1, False),  # the bladder fills its braid
        ("muscle.bladder_thickness_mm", 0, True),
        ("muscle.turns_per_m", 0, True),
        ("muscle.turns_per_m", 1, True),
        ("supply.rate_bar_per_s", 0, True),
        ("supply.rate_bar_per_s", 1, False),  # too fast to show how fast
    ],
)
def test_number_is_named_at_a_limit_of_the_muscle_but_not_of_its_plausible_error(
    number: str, end: int, is_obstacle: bool
) -> None:
    term = EffectTerm("number_error", "value", number=number)
    fit = make_fit(term)
    at_end = replace(fit, x=np.array([fit.hypothesis.bounds()[end][0]]))
    assert bool(find_terms_at_bound(at_end)) == is_obstacle
    assert not find_terms_at_bound(replace(fit, x=0.9 * at_end.x))


@pytest.mark.parametrize("has_equivalent", [True, False])
@pytest.mark.parametrize("verdict", ["identified", "unexplained"])
@pytest.mark.parametrize("at_bound", [make_fit(RELAXATION, time_constant_s=100.0), make_fit(HOSE, length_m=0.02)])
def test_adequate_model_at_a_bound_is_not_named(
    at_bound: Fit, verdict: Verdict, has_equivalent: bool, data: WeightedData, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An equivalent model takes its place; without any, left-out conditions decide. A short hose is a nozzle."""
    search, options = ForwardSelection(data, [], []), DiagnosisOptions()
    other = make_fit(COULOMB)

    def find_models(search: ForwardSelection, fit: Fit) -> list[EquivalentModel]:
        return [EquivalentModel(other, 3.0)] if has_equivalent and fit is at_bound else []

    monkeypatch.setattr(final_model, "find_data_driven_rival", lambda *_: None)
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: False)
    monkeypatch.setattr(robustness, "refine_and_simplify", lambda search, fit, rng: (fit, True))
    monkeypatch.setattr(robustness, "find_equivalent_models", find_models)
    monkeypatch.setattr(final_model, "_decide_verdict", lambda *_: (verdict, []))
    monkeypatch.setattr(final_model, "compute_confidence_intervals", lambda *_: [])
    monkeypatch.setattr(final_model, "compute_equation_residuals", lambda *_: [])
    selected = final_model.select_adequate_model(search, make_fit(), at_bound, options, lambda *_: None)
    if has_equivalent:
        assert selected is not None
        assert selected.final_fit is other
    else:
        assert (selected is None) == (verdict == "identified")


@pytest.mark.parametrize("is_smaller", [True, False])
@pytest.mark.parametrize("has_misfit", [True, False])
def test_model_that_leaves_a_misfit_replaces_none_that_reaches_the_noise(
    is_smaller: bool, has_misfit: bool, data: WeightedData, monkeypatch: pytest.MonkeyPatch
) -> None:
    best, other = make_fit(RELAXATION, time_constant_s=1.0 if is_smaller else 100.0), make_fit(COULOMB)

    def find_models(search: ForwardSelection, fit: Fit) -> list[EquivalentModel]:
        return [EquivalentModel(other, 3.0)] if fit is best else []

    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: has_misfit and fit is other)
    monkeypatch.setattr(robustness, "refine_and_simplify", lambda search, fit, rng: (fit, True))
    monkeypatch.setattr(robustness, "find_smaller_model", lambda *_: other if is_smaller else None)
    monkeypatch.setattr(robustness, "find_equivalent_models", find_models)
    fit, _, _ = select_final_fit(ForwardSelection(data, [], []), best, 0, lambda *_: None)
    assert fit is (best if has_misfit else other)


@pytest.mark.parametrize(("rise", "is_adopted"), [(-1.0, True), (5.0, True), (7.0, False)])
def test_smaller_model_that_fits_worse_once_refined_is_not_adopted(
    rise: float, is_adopted: bool, data: WeightedData, monkeypatch: pytest.MonkeyPatch
) -> None:
    best, smaller = make_fit(THRESHOLD), make_fit(COULOMB)
    refined = replace(smaller, weighted_residuals=np.array([np.sqrt(100.0 + rise)]))
    best = replace(best, weighted_residuals=np.array([10.0]))
    search = ForwardSelection(data, [], [])
    assert len(best.x) == len(smaller.x)
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: False)
    monkeypatch.setattr(
        robustness, "refine_and_simplify", lambda search, fit, rng: (refined if fit is smaller else fit, True)
    )
    monkeypatch.setattr(robustness, "find_smaller_model", lambda *_: smaller)
    monkeypatch.setattr(robustness, "find_equivalent_models", lambda *_: [])
    fit, _, _ = select_final_fit(search, best, 0, lambda *_: None)
    assert fit is (refined if is_adopted else best)


def test_better_model_among_the_equivalents_of_an_equivalent_one_is_found(
    data: WeightedData, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the verdict would say that BIC differs by no more than the threshold, and it would differ by more."""
    chain = [make_fit(term) for term in (COULOMB, THRESHOLD, GAIN)]

    def find_models(search: ForwardSelection, fit: Fit) -> list[EquivalentModel]:
        rank = chain.index(fit)
        return [EquivalentModel(chain[rank + 1], -10.0)] if rank < 2 else [EquivalentModel(chain[1], 10.0)]

    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: False)
    monkeypatch.setattr(robustness, "refine_and_simplify", lambda search, fit, rng: (fit, True))
    monkeypatch.setattr(robustness, "find_equivalent_models", find_models)
    fit, _, (rival,) = select_final_fit(ForwardSelection(data, [], []), chain[0], 0, lambda *_: None)
    assert (fit, rival.fit) == (chain[2], chain[1])


def test_predictions_decide_where_an_adequate_model_may_not_be_named(
    data: WeightedData, monkeypatch: pytest.MonkeyPatch
) -> None:
    search, fit, decision = ForwardSelection(data, [], []), make_fit(COULOMB), ImperfectLawDecision("unexplained", [])
    monkeypatch.setattr(ForwardSelection, "run", lambda self, base_fit: fit)
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: False)
    monkeypatch.setattr(workflow, "select_adequate_model", lambda *_: None)
    monkeypatch.setattr(workflow, "select_by_prediction", lambda *_: (None, None))
    monkeypatch.setattr(workflow, "compute_explained_rms_ratio", lambda *_: 1.0)
    monkeypatch.setattr(workflow, "find_adequate_model", lambda *_: fit)
    monkeypatch.setattr(workflow, "decide_verdict", lambda result, **_: decision)
    monkeypatch.setattr(workflow, "select_proxies", lambda *arguments: arguments)
    selected: Any = workflow._select_model(search, [], make_fit(), DiagnosisOptions(), lambda *_: None)
    assert selected[2] is fit
    assert selected[4] is decision


@pytest.mark.parametrize("has_repeats", [True, False])
def test_reason_states_the_bound_of_a_model_that_reaches_the_noise(
    has_repeats: bool, data: WeightedData, monkeypatch: pytest.MonkeyPatch
) -> None:
    search = ForwardSelection(data, [], [], has_repeats=has_repeats)
    monkeypatch.setattr(ForwardSelection, "find_relevant_misfits", lambda self, fit: {})
    sentences = final_model._describe_misfit(search, make_fit(RELAXATION, time_constant_s=100.0))
    assert len(sentences) == has_repeats
    assert all("bladder_relaxation has 'time_constant_s' at its bound, 100, so it is not" in s for s in sentences)
    assert not final_model._describe_misfit(search, make_fit(RELAXATION, time_constant_s=1.0))


def test_alternatives_at_bounds_and_absurd_instruments_are_no_rivals(
    data: WeightedData, replace_fits: Callable[[Refits], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    best, base = make_fit(THRESHOLD, chi2=20.0), make_fit(chi2=500.0)
    rivals = [
        make_fit(STRIBECK, stick_fraction=INSIDE, chi2=15.0),
        make_fit(COULOMB, chi2=23.0),
        make_fit(RELAXATION, time_constant_s=1.0, chi2=22.0),
        make_fit(GAIN, gain=1.05, chi2=22.0),
    ]
    step = SelectionStep(base, (), (best, *rivals), THRESHOLD, {}, "")
    search = ForwardSelection(data, [], [], history=[step])
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: False)
    monkeypatch.setattr(ForwardSelection, "compute_validation_gains", lambda self, before, after: {})

    def find_alternatives(**refined: Fit) -> list[tuple[EffectTerm, ...]]:
        refits = {fit.hypothesis.terms: fit for fit in [*rivals, *refined.values()]}
        replace_fits(refits)
        return [model.fit.hypothesis.terms for model in find_equivalent_models(search, best)]

    assert set(find_alternatives()) == {(STRIBECK,), (COULOMB,), (RELAXATION,), (GAIN,)}
    at_bound = make_fit(STRIBECK, stick_fraction=AT_BOUND, chi2=15.0)
    assert set(find_alternatives(a=at_bound)) == {(COULOMB,), (RELAXATION,), (GAIN,)}  # once, in the simpler form
    too_simple = make_fit(COULOMB, chi2=120.0)
    assert set(find_alternatives(a=at_bound, b=too_simple)) == {(RELAXATION,), (GAIN,)}
    only_form = make_fit(RELAXATION, time_constant_s=100.0, chi2=22.0)
    assert set(find_alternatives(a=only_form)) == {(STRIBECK,), (COULOMB,), (GAIN,)}
    absurd = make_fit(GAIN, gain=1.4, chi2=22.0)
    assert "further off" in find_naming_obstacle(data, absurd)
    assert set(find_alternatives(a=absurd)) == {(STRIBECK,), (COULOMB,), (RELAXATION,)}


def test_value_that_is_not_determined_is_no_flaw_of_an_alternative(
    data: WeightedData, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stick fraction of both models is arbitrary: at its bound in the alternative, unless that starts inside."""
    best = make_fit(STRIBECK, RELAXATION, stick_fraction=INSIDE, time_constant_s=1.0)
    rival = make_fit(STRIBECK, THRESHOLD, stick_fraction=AT_BOUND)
    step = SelectionStep(make_fit(STRIBECK, chi2=500.0), (), (best, rival), RELAXATION, {}, "")
    search = ForwardSelection(data, [], [], history=[step])
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: False)
    monkeypatch.setattr(ForwardSelection, "compute_validation_gains", lambda self, before, after: {})
    monkeypatch.setattr(robustness, "refine_effects", lambda data, fit: fit)
    monkeypatch.setattr(robustness, "refit_without_term", lambda data, fit, term: make_fit(chi2=500.0))
    monkeypatch.setattr(robustness, "screen_candidates", lambda data, fit, terms: [])

    def start_at(data: WeightedData, hypothesis: Hypothesis, x: np.ndarray) -> Fit:
        return Fit(hypothesis, x, np.zeros(1), np.ones((1, len(x))), True, [])

    monkeypatch.setattr(robustness, "fit_hypothesis", start_at)
    (model,) = find_equivalent_models(search, best)
    assert model.fit.hypothesis.terms == (STRIBECK, THRESHOLD)
    values = {p.name: value for p, value in zip(model.fit.hypothesis.parameters, model.fit.values, strict=True)}
    assert values["stick_fraction"] == pytest.approx(INSIDE)


@pytest.mark.parametrize(
    ("coarse_chi2", "refined_chi2", "n_fits", "is_reproducible", "chi2"),
    [(10.5, 0.0, 2, True, 10.0), (12.0, 10.2, 3, True, 10.0), (12.0, 12.0, 3, False, 10.0), (8.0, 7.0, 3, False, 7.0)],
    ids=["agrees", "agrees once it is refined", "ends elsewhere", "ends elsewhere and is better"],
)
def test_restart_that_ends_elsewhere_is_refined(
    coarse_chi2: float,
    refined_chi2: float,
    n_fits: int,
    is_reproducible: bool,
    chi2: float,
    data: WeightedData,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Coarse simulations have an error of their own at each beginning of a fit."""
    fits = iter(make_fit(COULOMB, chi2=value) for value in (10.0, coarse_chi2, refined_chi2))
    monkeypatch.setattr(robustness, "fit_hypothesis", lambda *arguments, **options: next(fits))
    best, has_converged = robustness.check_convergence(data, make_fit(COULOMB, chi2=11.0), np.random.default_rng(0))
    assert (best.chi2, has_converged) == (pytest.approx(chi2), is_reproducible)
    assert len(list(fits)) == 3 - n_fits


@pytest.mark.parametrize(
    ("gains", "validation_chi2", "is_listed"),
    [
        ((0.03, 0.03), 1000.0, True),
        ((0.03, 0.0), 1000.0, False),
        ((0.2, 0.03), 1000.0, False),
        ((0.12, 0.03), 100.0, True),  # a difference of 9 decides nothing
        ((0.05, -0.03), 100.0, False),
    ],
)
def test_rival_need_not_improve_validation_trials_more_than_the_best_model_does(
    gains: tuple[float, float],
    validation_chi2: float,
    is_listed: bool,
    data: WeightedData,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The comparison of whole models may find a term that alone would not pass the selection."""
    best, rival = make_fit(COULOMB, RELAXATION, time_constant_s=1.0), make_fit(COULOMB, THRESHOLD)
    step = SelectionStep(make_fit(COULOMB, chi2=500.0), (), (best, rival), RELAXATION, {}, "")
    search = ForwardSelection(data, [], [], history=[step])
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: False)
    fractions = {id(step.initial_fit): 1.0, id(best): 1.0 - gains[0], id(rival): 1.0 - gains[1]}
    chi2 = {key: validation_chi2 * fraction for key, fraction in fractions.items()}
    monkeypatch.setattr(
        ForwardSelection, "compute_validation_chi2", lambda self, *fits: {"v": [chi2[id(fit)] for fit in fits]}
    )
    monkeypatch.setattr(robustness, "refine_effects", lambda data, fit: fit)
    monkeypatch.setattr(robustness, "refit_without_term", lambda data, fit, term: make_fit(chi2=500.0))
    monkeypatch.setattr(robustness, "screen_candidates", lambda data, fit, terms: [])
    rivals = [model.fit.hypothesis.terms for model in find_equivalent_models(search, best)]
    assert rivals == ([(COULOMB, THRESHOLD)] if is_listed else [])


def test_choice_by_prediction_is_made_again_where_a_refined_fit_reaches_a_bound(
    data: WeightedData, replace_fits: Callable[[Refits], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    selection = PredictiveSelection(data, {}, [])
    errors = {(): [9.0] * 6, (STRIBECK,): [1.0] * 6, (COULOMB,): [2.0] * 6, (RELAXATION,): [2.1] * 6}

    def assess(fit: Fit) -> PredictiveModel:
        points = np.tile(fit.x, (6, 1))
        return PredictiveModel(fit, np.array(errors[fit.hypothesis.terms]), points, find_naming_obstacle(data, fit))

    monkeypatch.setattr(selection, "assess", assess)
    shaped, simple = make_fit(STRIBECK, stick_fraction=INSIDE), make_fit(COULOMB)
    relaxed = make_fit(RELAXATION, time_constant_s=1.0)
    refits = {fit.hypothesis.terms: fit for fit in (shaped, simple, relaxed)}
    base, *others = models = [assess(fit) for fit in (make_fit(), shaped, relaxed)]

    replace_fits(refits)
    result = selection._decide_refined(base, models)
    assert result.chosen.terms == (STRIBECK,)
    assert result.chosen.is_reproducible
    assert not result.rivals

    at_bound = make_fit(STRIBECK, stick_fraction=AT_BOUND)
    replace_fits({**refits, (STRIBECK,): at_bound})
    result = selection._decide_refined(base, models)
    assert result.chosen.terms == (COULOMB,)  # which was not among the models
    assert [rival.terms for rival in result.rivals] == [(RELAXATION,)]
    assert all(model.is_reproducible for model in (result.chosen, *result.rivals))
    assert "at its bound" in next(model.obstacle for model in result.models if model.terms == (STRIBECK,))

    replace_fits({**refits, (STRIBECK,): at_bound, (RELAXATION,): make_fit(RELAXATION, time_constant_s=100.0)})
    result = selection._decide_refined(base, models)
    assert result.chosen.terms == (COULOMB,)
    assert not result.rivals  # it reaches a bound, too

    # Models are compared by the errors of fits that are equally coarse.
    finer = replace(others[0], errors=np.array([3.0] * 6))
    monkeypatch.setattr(selection, "assess", lambda fit: finer if fit is shaped else assess(fit))
    replace_fits(refits)
    result = selection._decide_refined(base, models)
    assert result.chosen.terms == (STRIBECK,)
    assert result.chosen.error == 1.0


@pytest.mark.parametrize(
    ("error", "error_as_declared", "is_admitted"), [(1.0, 1.4, True), (1.0, 1.5, False), (4.1, 4.1, False)]
)
def test_names_that_need_no_number_at_its_limit_may_be_named(
    error: float, error_as_declared: float, is_admitted: bool, data: WeightedData, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The law's error moves numbers, too: of a gain of 9, at most 5 % may be lost with the number as declared.

    A gain of less than 60 % is not worth a name.
    """
    rubber = "muscle.c10_kpa"
    hypothesis = Hypothesis(DEVICE, ((rubber, 5.0), ("muscle.turns_per_m", 0.1)), (), (COULOMB,))
    fit = Fit(hypothesis, np.array([-3.0, 0.2, 0.5]), np.zeros(1), np.ones((1, 3)), True, [])
    seen: list[Fit] = []

    def refit(_: WeightedData, reduced: Hypothesis, x: np.ndarray) -> Fit:
        seen.append(Fit(reduced, x, np.zeros(1), np.ones((1, len(x))), True, []))
        return seen[-1]

    def assess(_: PredictiveSelection, assessed: Fit) -> PredictiveModel:
        points = np.tile(assessed.x, (2, 1))
        if assessed is fit:
            return PredictiveModel(fit, np.full(2, error), points, find_naming_obstacle(data, fit))
        return PredictiveModel(assessed, np.full(2, error_as_declared), points)

    monkeypatch.setattr(bounds, "fit_hypothesis", refit)
    monkeypatch.setattr(PredictiveSelection, "assess", assess)
    base = PredictiveModel(make_fit(), np.full(2, 10.0), np.empty((2, 0)))
    selection = PredictiveSelection(data, {}, [])
    model = selection.assess(fit)
    assert rubber in model.obstacle
    admitted = selection._admit_numbers(base, model)
    assert all(refitted.hypothesis.uncertainties == (("muscle.turns_per_m", 0.1),) for refitted in seen)
    assert all(refitted.x == pytest.approx([0.2, 0.5]) for refitted in seen)
    assert (admitted.obstacle == "") == is_admitted
    assert admitted.fit is fit

    # The same holds for a simpler form that takes the place of one at its bound.
    monkeypatch.setattr(predictive_selection, "simplify_at_bound", lambda *_: fit)
    shaped = PredictiveModel(make_fit(STRIBECK), np.full(2, 20.0), np.empty((2, 0)), "at its bound")
    simplified, *others = selection._add_simplified(base, shaped, [base, shaped])
    assert (simplified.fit, others) == (fit, [base, shaped])
    assert (simplified.obstacle == "") == is_admitted
