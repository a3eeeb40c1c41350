"""A form that contains a simpler one does not explain less than it does."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection import bounds, nested_forms
from klute_sim.diagnosis.selection.naming import find_terms_at_bound
from klute_sim.diagnosis.selection.nested_forms import (
    refit_with_containing_forms,
    restart_nested_forms,
    select_best_fits,
)
from klute_sim.diagnosis.workflow import fit_base_device
from tests.diagnosis.synthetic_dataset import write_dataset

SYMMETRIC, ASYMMETRIC = EffectTerm("choked_valve", "symmetric"), EffectTerm("choked_valve", "asymmetric")
VALVE = {"fill_resistance_s_bar_per_dm3": 0.4, "exhaust_factor": 1.8, "critical_ratio": 0.4}


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[WeightedData, Fit]]:
    folder = tmp_path_factory.mktemp("nested") / "data"
    dataset = load_dataset(write_dataset(folder, {("choked_valve", "asymmetric"): VALVE}, groups=("fit_1", "fit_2")))
    simulator = Simulator(1)
    experiments = prepare_experiments(dataset, split_dataset(dataset))
    fit, data = fit_base_device(dataset, [replace(e, use="fit") for e in experiments], simulator)
    yield data, fit
    simulator.close()


def fit_valve(data: WeightedData, base_fit: Fit, term: EffectTerm, max_nfev: int, **values: float) -> Fit:
    """Return a fit with ``term`` that begins with ``values``."""
    hypothesis = base_fit.hypothesis.with_term(term)
    start = hypothesis.initial_point()
    start[: len(base_fit.x)] = base_fit.x
    for index, parameter in enumerate(hypothesis.parameters):
        if parameter.name in values:
            start[index] = parameter.normalize(values[parameter.name])
    return fit_hypothesis(data, hypothesis, start, max_nfev=max_nfev)


@pytest.mark.slow
def test_fit_in_a_local_minimum_begins_at_the_simpler_form(prepared: tuple[WeightedData, Fit]) -> None:
    data, base_fit = prepared
    simple = fit_valve(data, base_fit, SYMMETRIC, 30, resistance_s_bar_per_dm3=0.6, critical_ratio=0.5)
    stuck = fit_valve(data, base_fit, ASYMMETRIC, 1, fill_resistance_s_bar_per_dm3=0.006, exhaust_factor=2.0)
    assert stuck.chi2 > 2.0 * simple.chi2
    unchanged, restarted = restart_nested_forms(data, [simple, stuck], max_nfev=30)
    assert unchanged is simple
    assert restarted.chi2 < 0.9 * simple.chi2
    exact = fit_valve(data, base_fit, ASYMMETRIC, 30, **VALVE)
    assert restarted.chi2 - exact.chi2 < 0.1 * (simple.chi2 - exact.chi2)


@pytest.mark.slow
@pytest.mark.parametrize("index", [0, 1])
def test_form_at_its_bound_becomes_one_that_contains_it(
    prepared: tuple[WeightedData, Fit], index: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A valve with another exhaust was fitted as a symmetric one with a critical ratio at its bound, and not named."""
    data, base_fit = prepared
    gain = EffectTerm("sensor_gain", "linear", "force")
    terms, expected = [gain], [gain]
    terms.insert(index, SYMMETRIC)
    expected.insert(index, ASYMMETRIC)
    hypothesis = replace(base_fit.hypothesis, terms=tuple(terms))
    x = hypothesis.initial_point()
    x[: len(base_fit.x)] = base_fit.x
    names = [p.name for p in hypothesis.parameters]
    resistance, ratio = names.index("resistance_s_bar_per_dm3"), names.index("critical_ratio")
    x[resistance] = hypothesis.parameters[resistance].normalize(0.6)
    x[ratio] = hypothesis.bounds()[1][ratio]
    symmetric = fit_hypothesis(data, hypothesis, x)
    at_bound = replace(symmetric, x=np.where(np.arange(len(x)) == ratio, x, symmetric.x))
    assert find_terms_at_bound(at_bound) == [SYMMETRIC]
    (refit,) = refit_with_containing_forms(data, at_bound, SYMMETRIC)
    assert list(refit.hypothesis.terms) == expected
    assert refit.chi2 < 0.9 * symmetric.chi2
    values = {p.name: value for p, value in zip(refit.hypothesis.parameters, refit.values, strict=True)}
    assert values["exhaust_factor"] == pytest.approx(VALVE["exhaust_factor"], rel=0.2)
    assert values["gain"] == pytest.approx(1.0, abs=0.01)
    monkeypatch.setattr(bounds, "refit_with_containing_forms", lambda data, fit, term: [refit])
    for is_inside in (True, False):
        monkeypatch.setattr(bounds, "has_value_at_bound", lambda fit, is_inside=is_inside: not is_inside)
        assert bounds.extend_at_bound(data, at_bound) is (refit if is_inside else None)


def test_form_that_no_other_contains_stays_at_its_bound(prepared: tuple[WeightedData, Fit]) -> None:
    hypothesis = prepared[1].hypothesis.with_term(ASYMMETRIC)
    x = np.where([p.name == "critical_ratio" for p in hypothesis.parameters], hypothesis.bounds()[1], 0.5)
    at_bound = Fit(hypothesis, x, np.zeros(1), np.ones((1, len(x))), True, [])
    assert find_terms_at_bound(at_bound) == [ASYMMETRIC]
    assert bounds.extend_at_bound(prepared[0], at_bound) is None


def make_fit(term: EffectTerm, chi2: float) -> Fit:
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (("force", 3.0),), (term,))
    x = np.zeros(len(hypothesis.parameters))
    return Fit(hypothesis, x, np.array([np.sqrt(chi2)]), np.ones((1, len(x))), True, [])


@pytest.mark.parametrize(
    ("terms", "chi2"),
    [
        ((SYMMETRIC, ASYMMETRIC), (100.0, 100.5)),  # within the accuracy of preliminary fits
        ((SYMMETRIC, ASYMMETRIC), (100.0, 60.0)),
        ((EffectTerm("hose", "tube"), ASYMMETRIC), (100.0, 900.0)),  # another effect
        ((EffectTerm("seal_friction", "coulomb"), EffectTerm("seal_friction", "viscous")), (100.0, 900.0)),
    ],
    ids=["equal", "better", "other effect", "as many parameters"],
)
def test_other_fits_stay(
    prepared: tuple[WeightedData, Fit], terms: tuple[EffectTerm, EffectTerm], chi2: tuple[float, float]
) -> None:
    fits = [make_fit(*pair) for pair in zip(terms, chi2, strict=True)]
    assert all(a is b for a, b in zip(restart_nested_forms(prepared[0], fits, max_nfev=5), fits, strict=True))


def test_best_fit_of_each_cause_is_selected() -> None:
    hose = make_fit(EffectTerm("hose", "tube"), 70.0)
    symmetric, asymmetric = make_fit(SYMMETRIC, 100.0), make_fit(ASYMMETRIC, 60.0)
    assert select_best_fits([symmetric, hose, asymmetric]) == [asymmetric, hose]


@pytest.mark.parametrize("force", [3.0, 15.0])
def test_refit_begins_at_the_value_of_the_simpler_form_whatever_the_scales(
    force: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The typical friction of a seal is 15 N without an influence of the pressure and 8 N with it."""
    monkeypatch.setattr(nested_forms, "fit_hypothesis", lambda data, hypothesis, start, **_: (hypothesis, start))
    term = EffectTerm("seal_friction", "coulomb")
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (("force", 3.0),), (term,))
    x = np.array([hypothesis.parameters[0].normalize(force)])
    fit = Fit(hypothesis, x, np.zeros(1), np.zeros((1, 1)), True, [])
    refits: list[Any] = refit_with_containing_forms(WeightedData(Simulator(1), [], {}), fit, term)
    assert refits
    for refitted, start in refits:
        (carried,) = (p.denormalize(v) for p, v in zip(refitted.parameters, start, strict=True) if p.name == "force_n")
        assert carried == pytest.approx(force)
        assert (start >= refitted.bounds()[0]).all()
        assert (start <= refitted.bounds()[1]).all()
