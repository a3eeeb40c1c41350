"""Models of the selection by prediction that reach the noise, beside what the forward selection ended with."""

import numpy as np
import pytest

from klute_sim.diagnosis import imperfect_law
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.imperfect_law import find_adequate_model
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.predictive_model import PredictiveModel, PredictiveResult
from klute_sim.diagnosis.selection.predictive_selection import PredictiveSelection
from tests.diagnosis.synthetic_dataset import make_repeats
from tests.diagnosis.test_further_effects import make_fit

BRAID, SEAL = EffectTerm("braid_hysteresis", "coulomb"), EffectTerm("seal_friction", "coulomb")
TAPER = EffectTerm("end_taper", "cone")


@pytest.mark.parametrize(
    ("terms", "chi2", "has_misfit", "is_found"),
    [
        pytest.param((TAPER, SEAL), 202.0, False, False, id="two effects explain less"),
        pytest.param((TAPER, SEAL), 192.0, False, True, id="two effects explain as much, for their number"),
        pytest.param((TAPER, SEAL), 202.0, True, True, id="the one effect leaves a misfit"),
        pytest.param((SEAL,), 212.0, False, True, id="one effect explains less"),
    ],
)
def test_more_names_are_no_answer_where_fewer_explain_more(
    terms: tuple[EffectTerm, ...], chi2: float, has_misfit: bool, is_found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A friction of the braid at the bound of its form was called a taper and a friction of the seal."""
    noise = {"force": Noise(3.0, (Autocorrelation(0.005, 1.0, 200),))}
    data = WeightedData(Simulator(1), make_repeats([np.linspace(0.0, 500.0, 100)] * 2), noise)
    at_bound, other = make_fit(BRAID, chi2=200.0), make_fit(*terms, chi2=chi2)
    monkeypatch.setattr(imperfect_law, "fit_hypothesis", lambda *_: other)
    monkeypatch.setattr(imperfect_law, "find_naming_obstacle", lambda *_: "")
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: fit is at_bound and has_misfit)
    monkeypatch.setattr(ForwardSelection, "compute_validation_gains", lambda *_: {})
    monkeypatch.setattr(ForwardSelection, "rejection_reason", lambda *_: "")
    search = ForwardSelection(data, [], [])
    assert find_adequate_model(search, make_fit(chi2=500.0), at_bound, *make_predictions(data, other)) == (
        other if is_found else None
    )


def make_predictions(data: WeightedData, fit: Fit) -> tuple[PredictiveSelection, PredictiveResult]:
    """Return a selection by prediction of which ``fit`` is the only model."""
    model = PredictiveModel(fit, np.ones(6), np.tile(fit.x, (6, 1)))
    return PredictiveSelection(data, {}, []), PredictiveResult(model, model, [], [model], {}, 1.0, 0.0, "condition", 6)
