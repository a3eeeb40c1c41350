"""Rivals that differ from the best model by the shape of a law only."""

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection import robustness
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.robustness import find_equivalent_models
from klute_sim.diagnosis.selection.selection_step import SelectionStep

LAMINAR = EffectTerm("laminar_orifice", "smooth")
VISCOUS, POWER_LAW = EffectTerm("muscle_damping", "viscous"), EffectTerm("muscle_damping", "power_law")
COLD_OIL = EffectTerm("oil_temperature", "walther")
DEVICE = load_device("klute-3-4-pair")


def make_fit(*terms: EffectTerm, chi2: float) -> Fit:
    hypothesis = Hypothesis(DEVICE, (), (), terms)
    x = np.array([0.0 if p.is_logarithmic else 1.0 for p in hypothesis.parameters])
    return Fit(hypothesis, x, np.array([np.sqrt(chi2)]), np.ones((1, len(x))), True, [])


@pytest.mark.parametrize(
    ("rival", "chi2", "is_listed"),
    [
        pytest.param(POWER_LAW, 100.0, False, id="an exponent that gains nothing"),
        pytest.param(POWER_LAW, 98.5, False, id="less than AIC requires"),
        pytest.param(POWER_LAW, 97.5, True, id="an exponent that the data ask for"),
        pytest.param(VISCOUS, 101.0, True, id="as many parameters"),
        pytest.param(COLD_OIL, 100.0, True, id="the only form of its effect"),
    ],
)
def test_exponent_that_gains_nothing_is_no_rival(
    rival: EffectTerm, chi2: float, is_listed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power law of the speed, with an exponent of 0.8, imitates an orifice that is laminar at low speed."""
    best, other = make_fit(LAMINAR, chi2=100.0), make_fit(rival, chi2=chi2)
    step = SelectionStep(make_fit(chi2=500.0), (), (best, other), LAMINAR, {}, "")
    data = WeightedData.__new__(WeightedData)
    monkeypatch.setattr(WeightedData, "n_effective", 400.0, raising=False)
    search = ForwardSelection(data, [], [], history=[step])
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: False)
    monkeypatch.setattr(ForwardSelection, "rejection_reason", lambda *_: "")
    monkeypatch.setattr(ForwardSelection, "compute_validation_gains", lambda *_: {})
    monkeypatch.setattr(robustness, "refine_effects", lambda data, fit: fit)
    monkeypatch.setattr(robustness, "find_naming_obstacle", lambda data, fit: "")
    rivals = [model.fit.hypothesis.terms for model in find_equivalent_models(search, best)]
    assert rivals == ([(rival,)] if is_listed else [])
