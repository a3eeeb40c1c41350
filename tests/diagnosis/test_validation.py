"""Which groups of validation trials tell about an effect."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.validation import compute_validation_chi2, select_validation_data
from tests.diagnosis.test_predictive_selection import make_fit

FRICTION = EffectTerm("braid_hysteresis", "coulomb")


@pytest.mark.parametrize(
    ("before", "after", "is_informative"),
    [
        ([3.0, 4.0], [3.0, 4.0], False),  # a held muscle has the same readings
        ([3.0, 4.0], [3.0, 3.95], False),
        ([3.0, 4.0], [3.0, 2.0], True),
        ([3.0, 4.0], [4.0, 3.0], True),  # readings differ, and neither fits better
        ([3.0, 4.0], [3.0, 4.1], True),  # a loss counts
        ([3.0, 4.0], [np.inf, 4.0], True),
    ],
)
def test_group_tells_about_an_effect_that_changes_its_readings(
    before: list[float], after: list[float], is_informative: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    fits = [make_fit(()), make_fit((FRICTION,))]
    readings = {id(fits[0].hypothesis): before, id(fits[1].hypothesis): after}
    monkeypatch.setattr(
        WeightedData, "compute_residuals", lambda self, hypothesis, points, **_: [readings[id(hypothesis)]]
    )
    monkeypatch.setattr(WeightedData, "weight_residuals", lambda self, residuals: np.array(residuals))
    experiment = SimpleNamespace(group="held", specimen=None)
    group = WeightedData(Simulator(1), [experiment], {})
    assert select_validation_data([group], *fits) == ([group] if is_informative else [])
    ten, less = (replace(fit, weighted_residuals=np.array([x])) for fit, x in zip(fits, (10.0, 9.8), strict=True))
    assert select_validation_data([group], ten, less) == [group]  # the fitted trials tell as little


def test_fitted_groups_are_left_out_where_no_validation_group_tells(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("klute_sim.diagnosis.selection.validation._differ", lambda *_: False)
    monkeypatch.setattr("klute_sim.diagnosis.selection.validation.compute_chi2", lambda data, fit: float(fit.x[0]))
    monkeypatch.setattr(
        "klute_sim.diagnosis.selection.validation.fit_hypothesis",
        lambda data, hypothesis, x, **_: replace(make_fit(()), x=x),
    )
    fits: list[Fit] = [replace(make_fit(()), x=np.array([value])) for value in (2.0, 1.0)]
    trials = [SimpleNamespace(group=name, specimen=None) for name in ("fit_1", "fit_1", "fit_2")]
    data = WeightedData(Simulator(1), trials, {})
    held = data.with_experiments([SimpleNamespace(group="held", specimen=None)])
    assert compute_validation_chi2(data, [held], fits) == {"fit_1": [2.0, 1.0], "fit_2": [2.0, 1.0]}
