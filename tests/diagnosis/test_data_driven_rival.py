"""Comparison with a data-driven term: true names stand, imitations do not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from klute_sim.diagnosis import final_model
from klute_sim.diagnosis.discrepancy import data_driven_rival
from klute_sim.diagnosis.discrepancy.data_driven_rival import (
    compute_decisive_threshold,
    compute_refusal_threshold,
    contains_names,
    find_adequate_term,
    find_data_driven_rival,
    find_decisive_term,
    find_rival_of_number,
    locate_term,
)
from klute_sim.diagnosis.discrepancy.sparse_regression import DataDrivenTermResult, _eliminate_functions
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.registration import COMMAND_DELAY
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.naming import list_kinds
from klute_sim.diagnosis.selection.screening import screen_candidates
from klute_sim.diagnosis.selection.selection_step import SelectionStep
from tests.diagnosis.test_predictive_selection import make_fit
from tests.diagnosis.test_sparse_regression import create_search

FRICTION = EffectTerm("braid_hysteresis", "coulomb")
SEAL = EffectTerm("seal_friction", "coulomb")
TAPER = EffectTerm("end_taper", "cone")


def add_terms(search: ForwardSelection, base: Fit, *terms: EffectTerm) -> Fit:
    """Return ``base`` refitted with ``terms``."""
    hypothesis = base.hypothesis
    for term in terms:
        hypothesis = hypothesis.with_term(term)
    start = hypothesis.initial_point()
    start[: len(base.x)] = base.x
    start[len(base.x) :] = np.where(start[len(base.x) :] == 0.0, 0.1, start[len(base.x) :])
    return fit_hypothesis(search.data, hypothesis, start)


def test_elimination_keeps_the_true_functions() -> None:
    functions = np.random.default_rng(1).standard_normal((200, 6))
    functions /= np.linalg.norm(functions, axis=0)
    target = 5.0 * functions[:, 1] - 3.0 * functions[:, 4]
    subsets = _eliminate_functions(functions, target)
    assert [len(subset) for subset in subsets] == [6, 5, 4, 3, 2, 1]
    assert subsets[-2:] == [[1, 4], [1]]


RATIO = EffectTerm("number_error", "value", number="muscle.braid_length_ratio")
TURNS = EffectTerm("number_error", "value", number="muscle.turns_per_m")
RATE = EffectTerm("number_error", "value", number="supply.rate_bar_per_s")


@pytest.mark.parametrize(
    ("terms", "errors", "is_likely"),
    [
        ((RATIO,), [2.9], True),
        ((RATIO,), [-3.1], False),
        ((RATIO, TURNS), [1.0, 3.5], False),
        ((RATIO, TAPER), [5.0, 0.1], True),  # a number beside an effect
        ((RATE,), [5.0], True),  # a supply may be as fast as it likes
        ((RATE, RATIO), [5.0, 3.1], False),
    ],
)
def test_number_that_is_wrong_by_an_implausible_amount_has_a_rival(
    terms: tuple[EffectTerm, ...], errors: list[float], is_likely: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    base, named = make_fit(()), make_fit(terms, errors)
    free = make_fit((EffectTerm("unknown_force", "sparse", parameter_keys=("pressure_n",)),))
    data = WeightedData(Simulator(1), [], {})
    results = [DataDrivenTermResult(free, "", "muscle and damper"), DataDrivenTermResult(None, "no term")]
    monkeypatch.setattr(data_driven_rival, "compute_equation_residuals", lambda *_: [])
    monkeypatch.setattr(data_driven_rival, "compute_bic_difference", lambda *_: 60.0)
    monkeypatch.setattr(data_driven_rival, "fit_data_driven_term", lambda *_, **__: results[0])
    rival = find_rival_of_number(ForwardSelection(data, [], []), base, named)
    assert (rival is None) == is_likely
    if rival is not None:
        assert rival.model.fit is free
        assert "times its plausible error (assumed), so an effect in the equation of muscle and" in rival.sentence
        search = ForwardSelection(data, [], [])
        assert find_rival_of_number(search, base, named, ["unknown_force"]) is None  # the number was measured
        results.pop(0)  # nothing represents the misfit
        assert find_rival_of_number(ForwardSelection(data, [], []), base, named) is None


@pytest.mark.slow
def test_true_name_is_not_beaten_and_an_imitation_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for search, base in create_search(tmp_path / "d", {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}}):
        named = add_terms(search, base, FRICTION)
        assert not search.has_misfit(named)
        assert find_data_driven_rival(search, base, named) is None
        assert find_data_driven_rival(search, base, base) is None  # nothing was named
        imitation = add_terms(search, base, EffectTerm("muscle_damping", "viscous"))
        data_driven_model = find_data_driven_rival(search, base, imitation)
        assert data_driven_model is not None
        assert data_driven_model.difference < -search.bic_threshold
        assert not search.has_misfit(data_driven_model.fit)
        assert contains_names(data_driven_model.fit, named, [FRICTION])
        delayed = replace(named.hypothesis, registration=((COMMAND_DELAY, 1.0),))  # another prior
        assert contains_names(data_driven_model.fit, fit_hypothesis(search.data, delayed), [FRICTION])
        assert not contains_names(data_driven_model.fit, imitation, imitation.hypothesis.terms)
        assert find_data_driven_rival(search, base, imitation, ("unknown_force",)) is None
        # Where the simulation has an error of its own, the term must be better by more than that.
        with monkeypatch.context() as patch:
            patch.setattr(BenchExperiment, "simulation_error", 10.0)
            simulation_chi2 = 100.0 * search.data.n_effective
            assert compute_refusal_threshold(search) == pytest.approx(search.bic_threshold + simulation_chi2)
            assert compute_decisive_threshold(search) == pytest.approx(3.0 * search.bic_threshold + simulation_chi2)
            assert find_data_driven_rival(search, base, imitation) is None
        # A term must not lose in any validation group, even where it gains in the mean.
        monkeypatch.setattr(search, "compute_validation_gains", lambda before, after: {"a": 0.5, "b": -0.1})
        assert find_data_driven_rival(search, base, imitation) is None


@pytest.mark.slow
def test_term_that_alone_reaches_the_noise_stands_beside_names_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Friction that rises with the contraction is in no catalogue, and that of a braid resembles it."""
    hidden = {("unknown_force", "sparse"): {"contraction_friction_n": 20.0, "pressure_speed_n": 15.0}}
    for search, base in create_search(tmp_path / "d", hidden):
        search.candidate_terms = [FRICTION, SEAL]
        named = search.run(base)
        assert search.has_misfit(named)
        assert find_adequate_term(search, base) is not None
        assert find_decisive_term(search, base, named) is None  # in the same equation, names may be a part of the term
        monkeypatch.setattr(data_driven_rival, "locate_term", lambda term: term.effect)
        monkeypatch.setattr(data_driven_rival, "MAX_EXCESS_FRACTION", 0.05)  # the excess of the seal is 0.03
        decisive = find_decisive_term(search, base, named)
        assert decisive is not None
        assert not search.has_misfit(decisive.adequate.fit)
        assert decisive.adequate.equation.startswith("muscle")
        assert decisive.named_fit is not None
        assert decisive.named_fit.hypothesis.terms == (FRICTION,)
        assert [rival.fit.hypothesis.terms[-1] for rival in decisive.rivals] == [SEAL]
        assert find_decisive_term(search, base, named, ("unknown_force",)) is None
        assert find_decisive_term(search, base, decisive.adequate.fit) is None  # the names are as good


def test_places_and_kinds_of_causes() -> None:
    gain, valve = EffectTerm("sensor_gain", "linear", "force"), EffectTerm("choked_valve", "symmetric")
    radius = EffectTerm("number_error", "value", number="muscle.bladder_radius_mm")
    inertia = EffectTerm("number_error", "value", number="model.geom.load.mass")
    assert [locate_term(term) for term in (gain, valve, FRICTION)] == ["instrument", "supply", "device"]
    assert [locate_term(term) for term in (radius, inertia)] == ["device", "mechanism"]
    assert list_kinds([gain, FRICTION, SEAL, radius]) == ["device", "instrument", "number"]


RADIUS, TURNS = (
    EffectTerm("number_error", "value", number=f"muscle.{k}") for k in ("bladder_radius_mm", "turns_per_m")
)
GAIN, OFFSET = (EffectTerm(f"sensor_{fault}", "linear", "force") for fault in ("gain", "offset"))
LAG = EffectTerm("sensor_lag", "first_order", "force")


@pytest.mark.parametrize(
    ("terms", "verdict"),
    [
        pytest.param((FRICTION, GAIN), "identified", id="two kinds"),
        pytest.param((FRICTION, GAIN, RADIUS), "unexplained", id="three kinds"),
        pytest.param((FRICTION, RADIUS, TURNS), "identified", id="an effect and two numbers"),
        pytest.param((GAIN, RADIUS, TURNS), "unexplained", id="three faults"),
        pytest.param((GAIN, OFFSET, RADIUS), "identified", id="one calibration and a number"),
        pytest.param((LAG, OFFSET, RADIUS), "unexplained", id="a calibration, a lag and a number"),
    ],
)
def test_coincidences_are_proxies(terms: tuple[EffectTerm, ...], verdict: str, monkeypatch: pytest.MonkeyPatch) -> None:
    fit = make_fit(terms)
    search = ForwardSelection(WeightedData(Simulator(1), [], {}), [], [])
    monkeypatch.setattr(search, "has_misfit", lambda _: False)
    assert final_model._decide_verdict(search, fit, [])[0] == verdict
    search.data.simulator.close()


@pytest.mark.slow
def test_no_term_is_decisive_where_a_pair_of_effects_reaches_the_noise(tmp_path: Path) -> None:
    hidden = {("braid_hysteresis", "coulomb"): {"slope_n_per_bar": 6.0}, ("end_taper", "cone"): {}}
    hidden["end_taper", "cone"] = {p.key: p.typical for p in TAPER.parameters}
    for search, base in create_search(tmp_path / "d", hidden):
        candidates = tuple(screen_candidates(search.data, base, [FRICTION, TAPER]))
        search.history = [SelectionStep(base, candidates, (), None, {}, "")]
        single = add_terms(search, base, FRICTION)
        assert search.has_misfit(single)
        assert find_adequate_term(search, base) is not None
        assert find_decisive_term(search, base, single) is None
        search.history = [replace(search.history[0], candidates=candidates[:1])]
        assert find_decisive_term(search, base, single) is not None
