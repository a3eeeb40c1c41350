"""Models whose simulation diverges where they predict: sentences say so, and JSON holds no infinite number."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from klute_sim.api.diagnosis import load_example_dataset
from klute_sim.datasets.dataset import split_dataset
from klute_sim.device.device import load_device
from klute_sim.diagnosis import imperfect_law
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.imperfect_law import decide_verdict
from klute_sim.diagnosis.rejections import list_rejections
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.diagnosis.selection.forward_selection import DIVERGENCE_REASON, ForwardSelection
from klute_sim.diagnosis.selection.predictive_model import PredictiveModel, PredictiveResult, compute_share
from klute_sim.diagnosis.selection.predictive_selection import PredictiveSelection
from klute_sim.diagnosis.selection.selection_step import SelectionStep
from klute_sim.diagnosis.verdict import verdict_to_dict
from tests.diagnosis.synthetic_dataset import make_repeats

FRICTION, TAPER = EffectTerm("seal_friction", "coulomb"), EffectTerm("end_taper", "strain")


def make_fit(*terms: EffectTerm, chi2: float = 0.0) -> Fit:
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (), terms)
    x = hypothesis.initial_point()
    return Fit(hypothesis, x, np.array([np.sqrt(chi2)]), np.ones((1, len(x))), True, [])


def make_model(*terms: EffectTerm, error: float) -> PredictiveModel:
    obstacle = "" if np.isfinite(error) else DIVERGENCE_REASON
    return PredictiveModel(make_fit(*terms), np.array([1.0, error]), np.zeros((2, 1)), obstacle)


@pytest.fixture
def result() -> PredictiveResult:
    base, diverging = make_model(error=1.0), make_model(FRICTION, error=np.inf)
    return PredictiveResult(base, base, [], [diverging, base], {}, 0.0, 0.0, "condition", 2)


def test_error_of_a_diverging_model_is_null(result: PredictiveResult, tmp_path: Path) -> None:
    dataset = load_example_dataset(tmp_path)
    diagnosis = Diagnosis(dataset=dataset, split=split_dataset(dataset), verdict="unexplained", reasons=[])
    diagnosis.prediction = result
    content = json.loads(json.dumps(verdict_to_dict(diagnosis), allow_nan=False))
    assert [model["squared_error"] for model in content["cross_validation"]["models"]] == [None, 1.0]


def test_sentences_say_that_a_simulation_diverges(result: PredictiveResult) -> None:
    step = SelectionStep(make_fit(chi2=9.0), (), (make_fit(TAPER, chi2=np.inf),), None, {}, "")
    diagnosis = SimpleNamespace(
        added_terms=(),
        absent_terms=(),
        equivalent_models=[],
        selection_history=[step],
        prediction=result,
        n_independent=100.0,
    )
    rejections = {rejection.term: rejection.reason for rejection in list_rejections(cast(Any, diagnosis))}
    assert rejections == {TAPER: DIVERGENCE_REASON, FRICTION: "a simulation diverges in a prediction"}
    sentence = f"{FRICTION} would predict best, but may not be named: {DIVERGENCE_REASON}."
    assert sentence in decide_verdict(result).reasons[-1]


def test_share_is_that_of_the_folds_that_the_model_without_effects_predicts() -> None:
    base, chosen = (
        PredictiveModel(make_fit(), np.array(errors), np.zeros((3, 0)))
        for errors in ([1.0, 3.0, np.inf], [0.5, 1.5, 0.2])
    )
    assert compute_share(base, chosen, 0.0) == pytest.approx(0.5)
    assert compute_share(replace(base, errors=np.full(3, np.inf)), chosen, 0.0) == 0.0


def test_share_is_at_most_one_where_the_noise_is_overestimated() -> None:
    base, chosen = (PredictiveModel(make_fit(), np.full(3, error), np.zeros((3, 0))) for error in (1.0, 0.2))
    assert compute_share(base, chosen, 0.1) == pytest.approx(0.8 / 0.9)
    assert compute_share(base, chosen, 0.7) == 1.0


def test_trial_that_diverges_anyway_does_not_refuse_an_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    search = ForwardSelection(WeightedData(Simulator(1), make_repeats([np.zeros(100)] * 2), {}), [], [])
    chi2 = {"a": [4.0, 1.0], "b": [np.inf, np.inf], "c": [np.inf, 2.0], "d": [2.0, np.inf]}
    monkeypatch.setattr(ForwardSelection, "compute_validation_chi2", lambda self, *fits: chi2)
    assert search.compute_validation_gains(make_fit(), make_fit(FRICTION)) == {"a": 0.75, "c": 1.0, "d": -np.inf}


def test_nothing_is_chosen_where_every_model_diverges() -> None:
    trials = make_repeats([np.linspace(0.0, 500.0, 100)] * 2)
    selection = PredictiveSelection(WeightedData(Simulator(1), trials, {}), {}, [])
    base = make_model(error=np.inf)
    decided = selection._decide(base, [make_model(FRICTION, error=np.inf), base])
    assert (decided.chosen, decided.share) == (base, 0.0)


def test_trial_that_diverges_tells_nothing_of_the_law(monkeypatch: pytest.MonkeyPatch) -> None:
    trials = make_repeats([np.linspace(0.0, 500.0, 100)] * 3)
    rows = [{"force": np.full(100, value)} for value in (1.0, np.inf, 3.0)]
    monkeypatch.setattr(WeightedData, "compute_residuals", lambda self, *_, may_diverge: [rows])
    data, residuals = imperfect_law._drop_diverging_trials(WeightedData(Simulator(1), trials, {}), [make_fit()] * 2)
    assert [e.name for e in data.experiments] == [trials[0].name, trials[2].name]
    assert residuals == [rows[0], rows[2]]
