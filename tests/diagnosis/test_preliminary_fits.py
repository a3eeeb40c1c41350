"""Preliminary fits: coarse changes of a reference, near the usual fit, with fewer simulations; complete on request."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets import dataset as datasets
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting import least_squares
from klute_sim.diagnosis.fitting.fit_cache import FitCache
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import (
    Fit,
    complete_fit,
    compute_jacobian,
    extend_jacobian,
    fit_hypothesis,
)
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.refits import refit_without_term
from klute_sim.diagnosis.workflow import fit_base_device
from tests.diagnosis.synthetic_dataset import write_dataset

FRICTION = EffectTerm("seal_friction", "coulomb")
OFFSET = EffectTerm("regulator_error", "offset")


@pytest.fixture(scope="module")
def base_fit(tmp_path_factory: pytest.TempPathFactory) -> tuple[WeightedData, Fit]:
    """Return data with a hidden friction, and their fit without effects."""
    effect = {("seal_friction", "coulomb"): {"force_n": 8.0}}
    dataset = datasets.load_dataset(write_dataset(tmp_path_factory.mktemp("data") / "d", effect))
    experiments = [e for e in prepare_experiments(dataset, datasets.split_dataset(dataset)) if e.use == "fit"]
    base, data = fit_base_device(dataset, experiments, Simulator(1))
    return data, base


def fit_preliminarily(data: WeightedData, base: Fit, term: EffectTerm = FRICTION) -> Fit:
    hypothesis = base.hypothesis.with_term(term)
    start = np.append(base.x, 0.3)
    return fit_hypothesis(
        data, hypothesis, start, extend_jacobian(data, hypothesis, start, base.jacobian), reference=base
    )


@pytest.mark.parametrize("term", [FRICTION, OFFSET], ids=str)
def test_preliminary_fit_ends_near_the_usual_one(base_fit: tuple[WeightedData, Fit], term: EffectTerm) -> None:
    data, base = base_fit
    before = data.simulator.n_rollouts
    preliminary = fit_preliminarily(data, base, term)
    n_preliminary = data.simulator.n_rollouts - before
    usual = fit_hypothesis(data, base.hypothesis.with_term(term), np.append(base.x, 0.3))
    assert preliminary.is_preliminary
    assert not usual.is_preliminary
    n_usual = data.simulator.n_rollouts - before - n_preliminary
    assert n_preliminary < (0.7 if term == FRICTION else 1.5) * n_usual  # pressure kinks mislead secants of an offset
    assert preliminary.x == pytest.approx(usual.x, abs=0.03)
    # The BIC that is compared is off by less than what decides.
    assert preliminary.chi2 == pytest.approx(usual.chi2, abs=1.0)


def test_preliminary_fit_of_a_supply_effect_compares_with_others(tmp_path: Path) -> None:
    """The error of coarse simulations is another one with a lag, so the residuals must come from normal ones."""
    dataset = datasets.load_dataset(
        write_dataset(tmp_path / "d", {("pressure_lag", "first_order"): {"time_constant_s": 0.05}})
    )
    experiments = [e for e in prepare_experiments(dataset, datasets.split_dataset(dataset)) if e.use == "fit"]
    base, data = fit_base_device(dataset, experiments, Simulator(1))
    first = fit_preliminarily(data, base, EffectTerm("pressure_lag", "first_order"))
    second = fit_hypothesis(data, first.hypothesis, first.x, first.jacobian, reference=first)
    final = fit_hypothesis(data, first.hypothesis, second.x, fine=True)
    assert first.chi2 == pytest.approx(final.chi2, abs=60.0)  # half of what drops a candidate before the second fit
    assert second.chi2 == pytest.approx(final.chi2, abs=0.5)
    for fit in (first, second):
        (residuals,) = data.compute_residuals(fit.hypothesis, [fit.x])
        n_priors = fit.hypothesis.n_prior_parameters
        assert np.array_equal(fit.weighted_residuals[:-n_priors], data.weight_residuals(residuals))


def test_continued_fit_that_coarse_simulations_mislead_is_repeated(
    base_fit: tuple[WeightedData, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    data, base = base_fit
    fit = fit_preliminarily(data, base)
    monkeypatch.setattr(least_squares, "MAX_CHI2_RISE", -np.inf)  # any step is misled
    assert not fit_hypothesis(data, fit.hypothesis, fit.x, fit.jacobian, reference=fit).is_preliminary
    assert fit_preliminarily(data, base).is_preliminary  # that of another model may be higher


def test_preliminary_fit_without_a_step_has_the_residuals_of_its_reference(base_fit: tuple[WeightedData, Fit]) -> None:
    data, base = base_fit
    same = fit_hypothesis(data, base.hypothesis, base.x, base.jacobian, max_nfev=1, reference=base)
    assert np.allclose(same.weighted_residuals, base.weighted_residuals, atol=1e-9)
    for row, expected in zip(same.residuals, base.residuals, strict=True):
        assert set(row) == set(expected)
        assert all(np.allclose(row[channel], expected[channel], atol=1e-9) for channel in row)


def test_completed_fit_has_a_computed_jacobian(
    base_fit: tuple[WeightedData, Fit],
) -> None:
    data, base = base_fit
    preliminary = fit_preliminarily(data, base)
    complete = complete_fit(data, preliminary)
    assert not complete.is_preliminary
    assert complete_fit(data, complete) is complete
    assert np.array_equal(complete.x, preliminary.x)
    assert np.array_equal(complete.weighted_residuals, preliminary.weighted_residuals)
    assert np.array_equal(complete.jacobian, compute_jacobian(data, complete.hypothesis, complete.x, coarse=True))


def test_extended_jacobian_holds_the_known_columns_and_that_of_the_new_term(
    base_fit: tuple[WeightedData, Fit],
) -> None:
    data, base = base_fit
    hypothesis, x = base.hypothesis.with_term(FRICTION), np.append(base.x, 0.3)
    extended = extend_jacobian(data, hypothesis, x, base.jacobian)
    assert np.array_equal(extended[:, :-1], base.jacobian)
    assert np.array_equal(extended[:, -1], compute_jacobian(data, hypothesis, x, coarse=True)[:, -1])


def test_fit_without_a_term_is_that_from_the_start(base_fit: tuple[WeightedData, Fit]) -> None:
    data, base = base_fit
    reduced = refit_without_term(data, complete_fit(data, fit_preliminarily(data, base)), FRICTION)
    assert not reduced.is_preliminary
    assert reduced.hypothesis == base.hypothesis
    assert reduced.chi2 == pytest.approx(base.chi2, abs=0.5)


def test_preliminary_fit_is_cached_apart_from_others(
    base_fit: tuple[WeightedData, Fit], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    data, base = base_fit
    cached_data = WeightedData(data.simulator, data.experiments, data.noise, FitCache("these data"))
    first = fit_preliminarily(cached_data, base)

    def refuse(*_: object) -> None:
        raise AssertionError("the fit is computed again")

    with monkeypatch.context() as context:
        context.setattr(least_squares, "_compare", refuse)
        again = fit_preliminarily(cached_data, base)
    assert again.is_preliminary
    assert np.array_equal(first.weighted_residuals, again.weighted_residuals)
    assert np.array_equal(first.jacobian, again.jacobian)
    for row, expected in zip(again.residuals, first.residuals, strict=True):
        assert all(np.array_equal(row[channel], expected[channel]) for channel in expected)
    usual = fit_hypothesis(cached_data, first.hypothesis, np.append(base.x, 0.3))
    assert not usual.is_preliminary
