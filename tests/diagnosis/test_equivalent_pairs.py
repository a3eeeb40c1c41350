"""Pairs of effects that explain the data as well as the pair that was named, with two other names."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection import robustness
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.robustness import find_equivalent_pairs
from klute_sim.diagnosis.selection.selection_step import SelectionStep

DEVICE = load_device("klute-3-4")
TAPER, GAIN = EffectTerm("end_taper", "length"), EffectTerm("sensor_gain", "linear", "force")
TURNS, RADIUS, WALL = (
    EffectTerm("number_error", "value", number=f"muscle.{key}")
    for key in ("turns_per_m", "bladder_radius_mm", "bladder_thickness_mm")
)


def make_fit(*terms: EffectTerm, chi2: float) -> Fit:
    hypothesis = Hypothesis(DEVICE, (), (("force", 3.0),), terms)
    x = hypothesis.initial_point() + 0.1
    return Fit(hypothesis, x, np.array([np.sqrt(chi2)]), np.ones((1, len(x))), True, [])


BASE, NAMED = make_fit(chi2=400e3), make_fit(TAPER, WALL, chi2=16.0e3)


@pytest.fixture
def search(monkeypatch: pytest.MonkeyPatch) -> ForwardSelection:
    """A search whose second terms leave what the table says: only the pair of radius and turns reaches the noise."""
    left = {frozenset([TURNS, RADIUS]): 16.001e3, frozenset([GAIN, RADIUS]): 20e3, frozenset([TAPER, RADIUS]): 18e3}
    candidates = tuple(
        SimpleNamespace(term=term, predicted_gain=gain) for term, gain in ((RADIUS, 9e3), (WALL, 7e3), (TURNS, 4e3))
    )
    singles = (make_fit(TAPER, chi2=19e3), make_fit(GAIN, chi2=24e3), make_fit(TURNS, chi2=28e3))

    def refit(self: ForwardSelection, fit: Fit, added: list[Any], *_: float) -> list[Fit]:
        terms = *fit.hypothesis.terms, added[0].term
        return [make_fit(*terms, chi2=left.get(frozenset(terms), 30e3))]

    monkeypatch.setattr(robustness, "predict_gains", lambda fit, candidates: candidates)
    monkeypatch.setattr(
        robustness,
        "screen_candidates",
        lambda data, fit, terms: [c for c in candidates if c.term in terms],
    )
    monkeypatch.setattr(robustness, "refine_effects", lambda data, fit: fit)
    monkeypatch.setattr(robustness, "find_naming_obstacle", lambda data, fit: "")
    monkeypatch.setattr(WeightedData, "n_effective", 16e3, raising=False)
    monkeypatch.setattr(ForwardSelection, "refit_candidates", refit)
    monkeypatch.setattr(ForwardSelection, "has_misfit", lambda self, fit: fit.chi2 > 17e3)
    monkeypatch.setattr(ForwardSelection, "rejection_reason", lambda *_: "")
    monkeypatch.setattr(ForwardSelection, "compute_validation_gains", lambda *_: {})
    step = SelectionStep(BASE, cast(Any, candidates), singles, TAPER, {}, "")
    return ForwardSelection(WeightedData.__new__(WeightedData), [], [], history=[step])


def test_pair_with_two_other_names_is_found(search: ForwardSelection) -> None:
    """Wrong radius and turns, and tapered ends with a thinner wall, look the same."""
    (pair,) = find_equivalent_pairs(search, NAMED)
    assert pair.hypothesis.terms == (TURNS, RADIUS)


def test_first_term_that_leaves_much_begins_no_pair(search: ForwardSelection, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robustness, "MAX_REMAINDER_FRACTION", 0.03)
    assert NAMED.chi2 + 0.03 * (BASE.chi2 - NAMED.chi2) < 28e3
    assert find_equivalent_pairs(search, NAMED) == []


@pytest.mark.parametrize(("excess", "is_listed"), [(5.0, True), (25.0, True), (35.0, False)])
def test_pair_is_listed_up_to_the_same_excess_as_other_rivals(
    excess: float, is_listed: bool, search: ForwardSelection
) -> None:
    """Of BIC: 6, or 30 where it reaches the noise."""
    pair = make_fit(TURNS, RADIUS, chi2=NAMED.chi2 + excess)
    assert len(robustness._merge_rivals(search, NAMED, [], [pair, NAMED])) == is_listed
    poor = make_fit(TURNS, RADIUS, chi2=18e3)
    assert robustness._merge_rivals(search, make_fit(TAPER, WALL, chi2=18e3 - 25.0), [], [poor]) == []


@pytest.mark.parametrize("named", [make_fit(TAPER, chi2=16e3), make_fit(TAPER, WALL, GAIN, chi2=16e3)])
def test_only_pairs_have_equivalent_pairs(search: ForwardSelection, named: Fit) -> None:
    assert find_equivalent_pairs(search, named) == []
    search.history.clear()
    assert find_equivalent_pairs(search, NAMED) == []
