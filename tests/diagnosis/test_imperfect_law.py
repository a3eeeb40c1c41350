"""Sentences on models of an imperfect law that predict as well as each other."""

from dataclasses import replace

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.imperfect_law import compute_explained_rms_ratio, decide_verdict
from klute_sim.diagnosis.selection.predictive_model import PredictiveModel, PredictiveResult
from klute_sim.diagnosis.selection.predictive_selection import PredictiveSelection

DRIFT = EffectTerm("sensor_drift", "linear", "force")
OFFSET = EffectTerm("sensor_offset", "linear", "force")
TENSION = EffectTerm("passive_tension", "exponential")


def make_model(*terms: EffectTerm, error: float) -> PredictiveModel:
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (("force", 3.0),), terms)
    x = hypothesis.initial_point()
    fit = Fit(hypothesis, x, np.array([np.sqrt(error)]), np.ones((1, len(x))), True, [])
    return PredictiveModel(fit, np.full(6, error), np.tile(x, (6, 1)))


@pytest.mark.parametrize(
    ("rivals", "expected"),
    [
        ([(DRIFT, TENSION)], "Beside sensor_drift of force, passive_tension (exponential) would"),
        ([(TENSION, DRIFT), (DRIFT,)], "passive_tension (exponential) and sensor_drift of force or sensor_drift of"),
        ([(TENSION,)], "passive_tension (exponential) would"),
    ],
)
def test_what_rivals_share_with_the_chosen_model_is_said_once(
    rivals: list[tuple[EffectTerm, ...]], expected: str
) -> None:
    base, chosen = make_model(error=9.0), make_model(DRIFT, OFFSET, error=1.0)
    others = [make_model(*terms, error=1.0) for terms in rivals]
    stability = dict.fromkeys(chosen.terms, 1.0)
    result = PredictiveResult(base, chosen, others, [chosen, *others, base], stability, 0.9, 0.0, "condition", 6)
    decision = decide_verdict(result)
    assert decision.verdict == "indistinguishable"
    assert decision.reasons[-1].startswith(expected)


@pytest.mark.parametrize(("share", "is_said"), [(1.0, True), (0.99, False)])
def test_share_of_one_says_that_the_noise_is_overestimated(share: float, is_said: bool) -> None:
    base, chosen = make_model(error=9.0), make_model(TENSION, error=1.0)
    result = PredictiveResult(base, chosen, [], [chosen, base], {TENSION: 1.0}, share, 2.0, "condition", 6)
    decision = decide_verdict(result)
    assert decision.verdict == "identified-in-part"
    assert any("noise is estimated too large" in reason for reason in decision.reasons) == is_said


@pytest.mark.parametrize(("fraction", "verdict"), [(0.8, "unexplained"), (1.2, "identified-in-part")])
def test_effect_smaller_than_the_noise_is_not_named_where_the_law_is_imperfect(fraction: float, verdict: str) -> None:
    base, chosen = make_model(error=9.0), make_model(TENSION, error=1.0)
    result = PredictiveResult(base, chosen, [], [chosen, base], {TENSION: 1.0}, 0.9, 2.0, "condition", 6)
    decision = decide_verdict(result, explained_rms_ratio=fraction)
    assert decision.verdict == verdict
    assert ("an RMS of 0.80 times the noise" in decision.reasons[-1]) == (verdict == "unexplained")


def test_explained_misfit_is_that_of_the_channel_with_most() -> None:
    readings = np.random.default_rng(0).standard_normal((2, 4, 100))
    base, chosen = (
        replace(
            model, fit=replace(model.fit, residuals=[{"force": s * force, "pressure": 1e3 * p} for force in rows[:2]])
        )
        for model, rows, s, p in (
            (make_model(error=9.0), readings[0], 5.0, readings[0][2]),
            (make_model(TENSION, error=1.0), readings[0], 3.0, readings[0][3]),
        )
    )
    result = PredictiveResult(base, chosen, [], [chosen, base], {TENSION: 1.0}, 0.9, 2.0, "condition", 6)
    noise = {"force": 2.0, "pressure": 1e5}
    data = WeightedData(Simulator(1), [], {})
    selection = PredictiveSelection(data, noise, [], lambda _: None)
    rms = np.sqrt(np.mean(readings[0][:2] ** 2))
    assert compute_explained_rms_ratio(selection, result) == pytest.approx(4.0 * rms / 2.0)
    assert compute_explained_rms_ratio(PredictiveSelection(data, {}, [], lambda _: None), result) == np.inf
    worse = replace(result, base=chosen, chosen=base)
    assert compute_explained_rms_ratio(selection, worse) < 0.1
