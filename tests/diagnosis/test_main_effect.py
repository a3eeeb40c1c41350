"""Rivals of an effect that explains nearly all of a misfit, beside which others explain little."""

from collections.abc import Sequence

import numpy as np
import pytest

from klute_sim.diagnosis import final_model
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise
from klute_sim.diagnosis.result import DiagnosisOptions
from klute_sim.diagnosis.selection import main_effect
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.main_effect import find_rivals_of_main_effect
from klute_sim.diagnosis.selection.selection_step import SelectionStep
from tests.diagnosis.synthetic_dataset import make_repeats
from tests.diagnosis.test_further_effects import make_fit

WALL = EffectTerm("thick_wall_bladder", "mooney_rivlin")
THRESHOLD, RISING = EffectTerm("threshold_pressure", "constant"), EffectTerm("threshold_pressure", "rising")
TAPER = EffectTerm("end_taper", "cone")
DAMPING = EffectTerm("muscle_damping", "viscous")
BASE_CHI2, MAIN_CHI2 = 100_000.0, 450.0


@pytest.fixture(autouse=True)
def leave_fits_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(main_effect, "refine_effects", lambda data, fit: fit)
    monkeypatch.setattr(main_effect, "find_naming_obstacle", lambda *_, **__: "")
    monkeypatch.setattr(ForwardSelection, "compute_validation_gains", lambda *_: {"a": 0.9})
    monkeypatch.setattr(ForwardSelection, "rejection_reason", lambda *_: "")


def make_search(*rivals: Fit, has_repeats: bool = True) -> ForwardSelection:
    """Return a search that added the wall first, of which ``rivals`` were other fits."""
    noise = {"force": Noise(3.0, (Autocorrelation(0.005, 1.0, 200),))}
    data = WeightedData(Simulator(1), make_repeats([np.linspace(0.0, 500.0, 100)] * 2), noise)
    search = ForwardSelection(data, [], [], has_repeats=has_repeats)
    refits = (make_fit(WALL, chi2=MAIN_CHI2), *rivals)
    search.history.append(SelectionStep(make_fit(chi2=BASE_CHI2), (), refits, WALL, {}, ""))
    return search


def list_names(search: ForwardSelection, final_fit: Fit) -> list[EffectTerm]:
    models = find_rivals_of_main_effect(search, make_fit(chi2=BASE_CHI2), final_fit)
    return [model.fit.hypothesis.terms[-1] for model in models]


def test_effect_that_explains_nearly_as_much_is_a_rival_in_its_best_form() -> None:
    rivals = make_fit(RISING, chi2=530.0), make_fit(THRESHOLD, chi2=900.0), make_fit(TAPER, chi2=1500.0)
    final = make_fit(WALL, DAMPING, chi2=220.0)
    search = make_search(*rivals)
    assert list_names(search, final) == [RISING]  # 0.08 % less; the taper explains 1.05 % less
    (model,) = find_rivals_of_main_effect(search, make_fit(chi2=BASE_CHI2), final)
    n = search.data.n_effective
    assert model.difference == pytest.approx(rivals[0].bic(n) - final.bic(n))


def test_rival_may_lag_by_what_the_small_effects_gain() -> None:
    far = make_fit(THRESHOLD, chi2=MAIN_CHI2 + 1900.0)
    search = make_search(far)
    assert list_names(search, make_fit(WALL, DAMPING, chi2=220.0)) == []
    search.history[0] = SelectionStep(
        make_fit(chi2=BASE_CHI2), (), (make_fit(WALL, chi2=2200.0), make_fit(THRESHOLD, chi2=4100.0)), WALL, {}, ""
    )
    assert list_names(search, make_fit(WALL, DAMPING, chi2=200.0)) == [THRESHOLD]


@pytest.mark.parametrize(
    ("terms", "chi2", "has_repeats"),
    [
        pytest.param((WALL,), MAIN_CHI2, True, id="a single effect reaches the noise"),
        pytest.param((WALL, DAMPING), 220.0, False, id="without repeats the noise is unknown"),
        pytest.param((TAPER, DAMPING), 220.0, True, id="the first effect was replaced"),
    ],
)
def test_other_models_have_no_rivals_of_a_main_effect(
    terms: Sequence[EffectTerm], chi2: float, has_repeats: bool
) -> None:
    search = make_search(make_fit(THRESHOLD, chi2=460.0), has_repeats=has_repeats)
    assert list_names(search, make_fit(*terms, chi2=chi2)) == []


def test_effects_of_like_size_have_no_rivals_of_a_main_effect() -> None:
    search = make_search(make_fit(THRESHOLD, chi2=460.0))
    search.history[0] = SelectionStep(
        make_fit(chi2=BASE_CHI2), (), (make_fit(WALL, chi2=4000.0), make_fit(THRESHOLD, chi2=4010.0)), WALL, {}, ""
    )
    assert list_names(search, make_fit(WALL, DAMPING, chi2=220.0)) == []


def test_rival_that_may_not_be_named_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    search, final = make_search(make_fit(THRESHOLD, chi2=460.0)), make_fit(WALL, DAMPING, chi2=220.0)
    with monkeypatch.context() as patch:
        patch.setattr(main_effect, "find_naming_obstacle", lambda *_, accepts_numbers_at_limit: "it is at its bound")
        assert list_names(search, final) == []
    with monkeypatch.context() as patch:
        patch.setattr(
            main_effect,
            "find_naming_obstacle",
            lambda *_, accepts_numbers_at_limit: "" if accepts_numbers_at_limit else "a number is at its limit",
        )
        assert list_names(search, final) == [THRESHOLD]  # the small effects may relieve the number
    monkeypatch.setattr(ForwardSelection, "rejection_reason", lambda *_: "validation trials get worse")
    assert list_names(search, final) == []


def test_verdict_lists_the_rivals_of_the_main_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    final = make_fit(WALL, DAMPING, chi2=220.0)
    search = make_search(make_fit(THRESHOLD, chi2=460.0))
    for name in ("compute_confidence_intervals", "compute_equation_residuals"):
        monkeypatch.setattr(final_model, name, lambda *_: [])
    monkeypatch.setattr(final_model, "find_data_driven_rival", lambda *_: None)
    monkeypatch.setattr(final_model, "select_final_fit", lambda search, fit, *_: (fit, True, []))
    monkeypatch.setattr(final_model, "has_value_at_bound", lambda fit: False)
    monkeypatch.setattr(final_model, "find_simpler_rival", lambda *_: None)
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: False)
    selected = final_model.select_adequate_model(
        search, make_fit(chi2=BASE_CHI2), final, DiagnosisOptions(), lambda *_: None
    )
    assert selected is not None
    assert selected.verdict == "indistinguishable"
    assert [model.fit.hypothesis.terms for model in selected.equivalent_models] == [(THRESHOLD,)]
    assert selected.reasons[-1] == (
        "What muscle_damping (viscous) adds beside thick_wall_bladder is small and may stand for an error of its law, "
        "so threshold_pressure (constant) alone is as likely."
    )
