"""Further effects that explain no more than errors of the simulation beside a large effect."""

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.selection_step import SelectionStep
from tests.diagnosis.synthetic_dataset import make_repeats

TANK, FRICTION = EffectTerm("supply_droop", "tank"), EffectTerm("seal_friction", "coulomb")


def make_fit(*terms: EffectTerm, chi2: float) -> Fit:
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), (), (("force", 3.0),), terms)
    x = np.full(len(hypothesis.parameters), 0.1)
    return Fit(hypothesis, x, np.array([np.sqrt(chi2)]), np.ones((1, len(x))), True, [])


@pytest.mark.parametrize(
    ("known_gain", "has_misfit", "has_repeats", "is_accepted"),
    [
        pytest.param(30_000.0, False, True, False, id="0.06 % of a large effect"),
        pytest.param(2_000.0, False, True, True, id="1 % of an effect"),
        pytest.param(30_000.0, True, True, True, id="repeats show that something is missing"),
        pytest.param(30_000.0, False, False, True, id="the noise was estimated again after the first effect"),
    ],
)
def test_effect_as_small_as_an_error_of_the_simulation_is_not_added(
    known_gain: float, has_misfit: bool, has_repeats: bool, is_accepted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The moment at which a tank was empty differed by a step, and a wall 4 % too thick was named for it."""
    noise = {"force": Noise(3.0, (Autocorrelation(0.005, 1.0, 200),))}
    data = WeightedData(Simulator(1), make_repeats([np.linspace(0.0, 500.0, 100)] * 2), noise)
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: has_misfit)
    search = ForwardSelection(data, [], [], has_repeats=has_repeats)
    before, after = make_fit(TANK, chi2=970.0), make_fit(TANK, FRICTION, chi2=950.0)
    search.history.append(SelectionStep(make_fit(chi2=970.0 + known_gain), (), (before,), TANK, {}, ""))
    reason = search.rejection_reason(before, after, {"a": 0.5})
    assert (reason == "") == is_accepted
    if reason:
        assert "explains less than 0.1 % of what the effects before it do" in reason
