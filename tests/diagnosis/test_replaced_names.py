"""Names beside an imperfect law without which other models predict as well."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.imperfect_law import decide_verdict
from klute_sim.diagnosis.selection import predictive_selection
from klute_sim.diagnosis.selection.predictive_model import (
    are_proxies,
    count_faults,
    list_certain_models,
    list_reduced_models,
)
from klute_sim.diagnosis.selection.predictive_selection import PredictiveSelection
from tests.diagnosis.test_predictive_selection import BASE, FRICTION, GAIN, TAPER, TENSION, make_model, make_result


def test_names_that_refused_models_replace_stand_in_for_something_else() -> None:
    pair = make_model((FRICTION, GAIN), [0.2] * 6)
    other = make_model((TAPER,), [0.21] * 6, "it is at its bound")
    assert are_proxies(pair, [pair, other, BASE])
    # Not where one of the names is in all such models, and they predict worse or may be named (as rivals).
    partly = make_model((FRICTION, TAPER), [0.21] * 6, "it is at its bound")
    assert not are_proxies(pair, [pair, partly, BASE])
    worse = make_model((TAPER,), [0.3] * 6, "it is at its bound")
    nameable = make_model((TAPER,), [0.21] * 6)
    assert not are_proxies(pair, [pair, worse, nameable, BASE])
    single = make_model((FRICTION,), [0.2] * 6)
    assert not are_proxies(single, [single, other, BASE])
    decision = decide_verdict(replace(make_result(pair, [], 1.0, 0.9), has_proxies=True))
    assert decision.verdict == "unexplained"
    assert "something else is missing" in decision.reasons[-1]


@pytest.mark.parametrize(("gain", "is_impossible"), [(1.2, False), (1.4, True), (0.6, True), (2.0, True)])
def test_gain_that_no_load_cell_has_stands_in_for_nothing(gain: float, is_impossible: bool) -> None:
    """A load cell that reads double, at the bound, is no rival of an effect that is twice as large."""
    pair = make_model((FRICTION, TENSION), [0.2] * 6)
    doubled = make_model((GAIN,), [0.2] * 6, "it is further off than instruments are")
    hypothesis = doubled.fit.hypothesis
    refused = replace(doubled.fit, x=np.array([hypothesis.parameters[0].normalize(gain)]))
    assert are_proxies(pair, [pair, replace(doubled, fit=refused), BASE]) != is_impossible


def test_number_of_a_declared_effect_is_no_fault() -> None:
    """Its law may be imperfect, as that of an effect which is missing."""
    keys = "muscle.turns_per_m", "effects.braid_hysteresis.slope_n_per_bar"
    numbers = [EffectTerm("number_error", "value", number=key) for key in keys]
    models = [SimpleNamespace(terms=terms) for terms in ([numbers[0]], [numbers[1]], [FRICTION, GAIN])]
    assert [count_faults(cast(Any, model)) for model in models] == [1, 0, 1]


def test_name_that_another_model_replaces_is_left_out() -> None:
    pair, single = make_model((FRICTION, GAIN), [0.2] * 6), make_model((FRICTION,), [0.5] * 6)
    gain = make_model((GAIN,), [3.0] * 6)
    assert list_reduced_models(pair, [pair, single, gain], [pair, single, gain, BASE]) == []
    for obstacle in ("", "it is at its bound"):  # a refused model that predicts as well is evidence against the name
        other = make_model((FRICTION, TAPER, TENSION), [0.21] * 6, obstacle)
        assert list_reduced_models(pair, [pair, single, gain], [pair, other, single, gain, BASE]) == [single]
    worse = make_model((FRICTION, TAPER), [0.23] * 6)
    assert list_reduced_models(pair, [pair, worse, single], [pair, worse, single, BASE]) == []


@pytest.mark.parametrize(("error", "n_names"), [(0.5, 1), (2.0, 2)])
def test_names_that_explain_too_little_alone_stay_together(error: float, n_names: int) -> None:
    selection = object.__new__(PredictiveSelection)
    selection.folds, selection.fold_kind = [[]] * 6, "condition"
    pair, single = make_model((FRICTION, GAIN), [0.2] * 6), make_model((FRICTION,), [error] * 6)
    other = make_model((FRICTION, TAPER, TENSION), [0.21] * 6, "it is at its bound")
    chosen = selection._decide(BASE, [pair, other, single, BASE]).chosen
    assert chosen.identities == {term.identity for term in (FRICTION, GAIN)[:n_names]}


@pytest.mark.parametrize(
    ("error", "remaining_obstacle", "is_certain"),
    [(0.5, "", True), (0.5, "it is at its bound", False), (3.0, "", False)],
)
def test_names_that_nothing_replaces_are_as_likely_with_numbers_at_their_limits(
    error: float, remaining_obstacle: str, is_certain: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a joint with an imperfect law, the inertia alone needed a friction that the wall or a ratio would change."""
    selection = object.__new__(PredictiveSelection)
    selection.data, selection.folds, selection.fold_kind = WeightedData(Simulator(1), [], {}), [[]] * 6, "condition"

    def find_obstacle(data: WeightedData, fit: Fit, *, accepts_numbers_at_limit: bool) -> str:
        assert accepts_numbers_at_limit
        return remaining_obstacle

    monkeypatch.setattr(predictive_selection, "find_naming_obstacle", find_obstacle)
    single = make_model((FRICTION,), [error] * 6, "a number is at its limit")
    pair, other = make_model((FRICTION, GAIN), [0.2] * 6), make_model((FRICTION, TAPER), [0.21] * 6)
    result = selection._decide(BASE, [pair, other, single, BASE])
    assert result.chosen is pair
    assert result.certain is (single if is_certain else None)
    decision = decide_verdict(replace(result, rivals=[]))
    assert decision.verdict == ("indistinguishable" if is_certain else "identified-in-part")
    if is_certain:
        assert "without sensor_gain of force, so this may stand for the error of the law. seal" in decision.reasons[-1]
    # Not where nothing replaces the other name, or everything is replaced.
    assert selection._decide(BASE, [pair, single, BASE]).certain is None
    assert not list_certain_models(pair, [pair, other, make_model((GAIN,), [0.2] * 6), single, BASE])
