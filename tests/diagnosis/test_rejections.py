"""Reasons of rejected candidates say what the selection decided by."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from klute_sim.device.device import load_device
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.rejections import list_rejections
from klute_sim.diagnosis.selection.forward_selection import SelectionStep
from klute_sim.diagnosis.selection.predictive_model import PredictiveModel, PredictiveResult

VALVE, LAG = EffectTerm("choked_valve", "downstream"), EffectTerm("pressure_lag", "first_order")
DELAY, HOSE, DROOP = (
    EffectTerm(*names) for names in (("pressure_delay", "dead_time"), ("hose", "tube"), ("supply_droop", "tank"))
)


def make_model(*terms: EffectTerm, error: float, obstacle: str = "") -> PredictiveModel:
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (), terms)
    x = hypothesis.initial_point()
    fit = Fit(hypothesis, x, np.zeros(1), np.ones((1, len(x))), True, [])
    return PredictiveModel(fit, np.full(4, error), np.zeros((4, len(x))), obstacle)


def test_reason_tells_a_better_prediction_from_a_worse_one() -> None:
    base, chosen = make_model(error=1.0), make_model(VALVE, error=0.014)
    models = [
        make_model(VALVE, LAG, error=0.001),
        make_model(DELAY, error=0.012),
        chosen,
        make_model(DROOP, error=0.5),
        make_model(HOSE, error=0.6, obstacle="hose has 'length_m' at its bound, 20"),
        base,
    ]
    result = PredictiveResult(base, chosen, [], models, {VALVE: 1.0}, 0.986, 0.0, "condition", 4)
    diagnosis = SimpleNamespace(
        added_terms=(VALVE,),
        absent_terms=(),
        equivalent_models=[],
        selection_history=[],
        prediction=result,
        n_independent=100.0,
    )
    reasons = {rejection.term: rejection.reason for rejection in list_rejections(cast(Any, diagnosis))}
    assert reasons == {
        LAG: (
            "with choked_valve (downstream) the squared error of prediction changes by -99.9 %; the chosen model has "
            "fewer effects, and its squared error is larger by 1.3 % of that without added effects: too small or too "
            "uncertain a gain for a further effect, or other models reach it, too"
        ),
        DELAY: (
            "the squared error of prediction changes by -98.8 %; "
            "too few of the selections without one condition choose it again"
        ),
        DROOP: "the squared error of prediction changes by -50 %; the chosen model predicts as well or better",
        HOSE: "the squared error of prediction changes by -40 %; hose has 'length_m' at its bound, 20",
    }


def test_effect_that_may_be_absent_is_no_effect_that_the_model_does_without() -> None:
    fit = make_model(VALVE, DELAY, error=1.0).fit
    steps = [SelectionStep(fit, (), (), term, {}, "BIC falls by 20") for term in (VALVE, DELAY, HOSE)]
    diagnosis = SimpleNamespace(
        added_terms=(VALVE,),
        absent_terms=(DELAY,),
        equivalent_models=[],
        selection_history=steps,
        prediction=None,
        n_independent=100.0,
    )
    reasons = {rejection.term: rejection.reason for rejection in list_rejections(cast(Any, diagnosis))}
    assert reasons == {
        DELAY: "it was found, too, but its 95 % interval contains its absence: the repeats do not prove it",
        HOSE: "it was added first, but the final model explains the data as well without it",
    }
