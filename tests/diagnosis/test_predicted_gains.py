"""Gains of candidates beside a model, predicted from their effect without it."""

import numpy as np
import pytest

from klute_sim.datasets import dataset as datasets
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.predictive_selection import PredictiveSelection
from klute_sim.diagnosis.selection.screening import Candidate, predict_gains, screen_candidates
from klute_sim.diagnosis.workflow import fit_base_device
from tests.diagnosis.synthetic_dataset import write_dataset

FRICTION, DAMPING = EffectTerm("seal_friction", "coulomb"), EffectTerm("muscle_damping", "viscous")
DROOP, RELAXATION = EffectTerm("supply_droop", "tank"), EffectTerm("bladder_relaxation", "maxwell")
TERMS = (FRICTION, DAMPING, DROOP, RELAXATION)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> tuple[WeightedData, Fit, list[Candidate]]:
    """Return data with a hidden friction, their fit without effects, and its candidates."""
    effect = {("seal_friction", "coulomb"): {"force_n": 8.0}}
    dataset = datasets.load_dataset(write_dataset(tmp_path_factory.mktemp("data") / "d", effect))
    experiments = [e for e in prepare_experiments(dataset, datasets.split_dataset(dataset)) if e.use == "fit"]
    fit, data = fit_base_device(dataset, experiments, Simulator(1))
    return data, fit, screen_candidates(data, fit, TERMS)


def test_prediction_at_the_fit_of_the_candidates_is_theirs(base: tuple[WeightedData, Fit, list[Candidate]]) -> None:
    _, fit, candidates = base
    predicted = {c.term: c for c in predict_gains(fit, candidates)}
    assert predicted.keys() == {c.term for c in candidates}
    for candidate in candidates:
        assert predicted[candidate.term].predicted_gain == pytest.approx(candidate.predicted_gain, abs=1e-6)
        assert predicted[candidate.term].size == pytest.approx(candidate.size)


def test_what_a_model_explains_is_no_gain_beside_it(base: tuple[WeightedData, Fit, list[Candidate]]) -> None:
    data, fit, candidates = base
    damping = next(c for c in candidates if c.term == DAMPING)
    extended = fit_hypothesis(data, fit.hypothesis.with_term(FRICTION), np.append(fit.x, 0.3))
    (beside,) = predict_gains(extended, [damping])
    assert 0.0 <= beside.predicted_gain < 0.1 * damping.predicted_gain  # it stood in for the friction


def test_effects_of_the_supply_and_those_without_influence_alone_are_screened(
    base: tuple[WeightedData, Fit, list[Candidate]], monkeypatch: pytest.MonkeyPatch
) -> None:
    data, fit, candidates = base
    selection = PredictiveSelection(data, {}, TERMS)
    extended = fit_hypothesis(data, fit.hypothesis.with_term(FRICTION), np.append(fit.x, 0.3))
    screened: list[EffectTerm] = []
    module = "klute_sim.diagnosis.selection.predictive_selection"
    monkeypatch.setattr(f"{module}.MAX_SCREENED_CAUSES", 0)
    monkeypatch.setattr(f"{module}.screen_candidates", lambda data, current, terms: screened.extend(terms) or [])
    known = [c for c in candidates if c.term != RELAXATION]
    selection._extend_best(extended, known, 1, {})
    assert screened == [DROOP, RELAXATION]
