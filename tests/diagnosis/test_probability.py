"""Probabilities of names: logistic in the evidence, complementary, and within [0, 1]."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.diagnosis import probability
from klute_sim.diagnosis.evidence import NameEvidence, collect_evidence
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.probability import (
    NAMING_VERDICTS,
    compute_logistic,
    list_name_features,
    list_nothing_features,
    load_calibration,
    measure_misfit_size,
)
from klute_sim.diagnosis.result import ChannelRms

margins, sizes = st.floats(0.0, 1.0), st.floats(0.0, 1e4)


@given(st.sampled_from(NAMING_VERDICTS), margins, sizes)
def test_a_name_has_a_probability_that_grows_with_its_margin(verdict: str, margin: float, size: float) -> None:
    coefficients = load_calibration()["names"]
    probability = compute_logistic(coefficients, list_name_features(verdict, margin, size))
    assert 0.0 < probability < 1.0
    assert compute_logistic(coefficients, list_name_features(verdict, 1.0, size)) >= probability


def test_the_calibration_separates_verdicts() -> None:
    """Names of `identified` are more probable than proxies; nothing is missing where the verdict says so."""
    calibration = load_calibration()
    identified, proxy = (
        compute_logistic(calibration["names"], list_name_features(verdict, 0.3, 2.0))
        for verdict in ("identified", "unexplained")
    )
    assert identified > 0.8 > 0.5 > proxy
    claimed, denied = (
        compute_logistic(calibration["nothing_missing"], list_nothing_features(verdict, 2.0))
        for verdict in ("nothing-missing", "identified")
    )
    assert claimed > 0.9 > 0.2 > denied
    assert list_nothing_features("nothing-missing", 0.2) == list_nothing_features("nothing-missing", 5.0)
    faint, strong = (
        compute_logistic(calibration["nothing_missing"], list_nothing_features("identified", size))
        for size in (0.3, 5.0)
    )
    assert faint > strong


def test_logistic_against_the_closed_form() -> None:
    assert compute_logistic([0.0, 0.0], [3.0, 4.0]) == 0.5
    assert compute_logistic([1.0, -2.0], [2.0, 0.5]) == pytest.approx(1.0 / (1.0 + np.exp(-1.0)))


def test_misfit_size_is_that_beyond_the_noise_in_the_worst_channel() -> None:
    rms = {
        "force": ChannelRms(nominal=9.0, refitted=5.0, with_effects=3.0, noise_floor=3.0),
        "pressure": ChannelRms(nominal=1.0, refitted=1.0, with_effects=1.0, noise_floor=None),
    }
    assert measure_misfit_size(rms) == pytest.approx(4.0 / 3.0)
    assert measure_misfit_size({}) == 0.0


def test_size_of_what_the_test_trials_do_not_show_is_that_in_the_fitted_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every sample counts alike, and channels without noise do not count."""
    monkeypatch.setattr(probability, "collect_evidence", lambda _: {})
    before, after = ([{"force": np.full(4, size), "angle": np.ones(4)}, {}] for size in (5.0, 4.0))
    diagnosis = SimpleNamespace(
        **{"verdict": "identified-in-part", "held_out": "not-tested", "has_repeats": True, "channel_rms": {}},
        **{"added_terms": ("a term",), "noise": {"force": SimpleNamespace(std=1.0)}},
        **{"base_fit": SimpleNamespace(residuals=before), "final_fit": SimpleNamespace(residuals=after)},
    )
    probabilities = probability.estimate_probabilities(cast(Any, diagnosis))
    assert probabilities is not None
    features = list_nothing_features("identified-in-part", 3.0)
    assert probabilities.nothing_missing == compute_logistic(load_calibration()["nothing_missing"], features)


@pytest.mark.parametrize("has_repeats", [True, False])
def test_bic_is_no_evidence_where_the_noise_is_an_assumption(has_repeats: bool) -> None:
    """It is estimated again after each effect, so the models have different noise."""
    term = EffectTerm("seal_friction", "coulomb")
    base, final = (
        SimpleNamespace(bic=lambda _, bic=bic: bic, hypothesis=SimpleNamespace(terms=terms))
        for bic, terms in ((100.0, ()), (20.0, (term,)))
    )
    diagnosis = SimpleNamespace(
        **{"added_terms": (term,), "base_fit": base, "final_fit": final, "prediction": None, "n_independent": 50.0},
        **{"selection_history": [], "equivalent_models": [], "has_repeats": has_repeats},
    )
    evidence = collect_evidence(cast(Any, diagnosis))
    assert evidence == ({term: NameEvidence(80.0, 1.0)} if has_repeats else {})
