"""Models whose simulation diverges where they predict: sentences say so, and JSON holds no infinite number."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from klute_sim.api.diagnosis import load_example_dataset
from klute_sim.datasets.dataset import split_dataset
from klute_sim.device.device import load_device
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.imperfect_law import decide_verdict
from klute_sim.diagnosis.rejections import list_rejections
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.diagnosis.selection.forward_selection import DIVERGENCE_REASON, SelectionStep
from klute_sim.diagnosis.selection.predictive_model import PredictiveModel, PredictiveResult
from klute_sim.diagnosis.verdict import verdict_to_dict

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
        added_terms=(), equivalent_models=[], selection_history=[step], prediction=result, n_independent=100.0
    )
    rejections = {rejection.term: rejection.reason for rejection in list_rejections(cast(Any, diagnosis))}
    assert rejections == {TAPER: DIVERGENCE_REASON, FRICTION: "a simulation diverges in a prediction"}
    assert f"The best is {FRICTION}: {DIVERGENCE_REASON}." in decide_verdict(result).reasons[-1]
