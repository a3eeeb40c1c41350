"""Linear commands that are late, and those of a zero-order hold, which look alike half a sampling interval late."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from klute_sim.datasets.dataset import load_dataset
from klute_sim.diagnosis import command_interpolation, workflow
from klute_sim.diagnosis.command_interpolation import reconsider_linear_interpolation
from tests.diagnosis.synthetic_dataset import write_dataset

INTERVAL_S = 0.005
"""Sampling interval of the datasets."""
N_SAMPLES = 100.0
THRESHOLD = 6.0


def make_fit(bic: float) -> Any:
    """Return the stand-in of a fit; its hypothesis with any further term is its Bayesian information criterion, too."""
    hypothesis = SimpleNamespace(with_term=lambda term: bic)
    return SimpleNamespace(bic=lambda n: bic, hypothesis=hypothesis)


def make_outcome(
    verdict: str, bic: float, *, n_shifts: int = 0, shift_gain: float = 400.0, prediction: Any = None
) -> Any:
    """Return the stand-in of an outcome whose device without effects has a criterion of 500."""
    return SimpleNamespace(
        data=SimpleNamespace(n_effective=N_SAMPLES, noise={"pressure": None, "force": None}),
        search=SimpleNamespace(bic_threshold=THRESHOLD),
        base_fit=make_fit(500.0),
        selected=SimpleNamespace(verdict=verdict, prediction=prediction),
        n_time_shifts=n_shifts,
        compute_bic=lambda data: bic,
        compute_shift_gain=lambda: shift_gain,
    )


@pytest.mark.parametrize(
    ("hold", "linear", "shifted_bic", "is_searched", "is_linear"),
    [
        pytest.param(make_outcome("nothing-missing", 500.0), None, 100.0, False, False, id="nothing is missing"),
        pytest.param(make_outcome("unexplained", 400.0), None, 495.0, False, False, id="a shift explains no more"),
        pytest.param(
            make_outcome("unexplained", 400.0), make_outcome("identified", 100.0, n_shifts=1), 100.0, True, True,
            id="a shift explains all",
        ),
        pytest.param(
            make_outcome("identified", 400.0), make_outcome("indistinguishable", 100.0, n_shifts=1), 100.0, True, True,
            id="better than the names",
        ),
        pytest.param(
            make_outcome("identified", 105.0), make_outcome("identified", 100.0, n_shifts=1, shift_gain=9.0), 100.0,
            True, False, id="hardly better than the names",
        ),
        pytest.param(
            make_outcome("identified", 130.0), make_outcome("identified", 100.0, n_shifts=1), 100.0, True, False,
            id="better by a small part of what the shift explains",
        ),
        pytest.param(
            make_outcome("unexplained", 400.0), make_outcome("identified", 100.0), 100.0, True, False, id="no shift"
        ),
        pytest.param(
            make_outcome("unexplained", 400.0), make_outcome("unexplained", 100.0, n_shifts=1), 100.0, True, False,
            id="unexplained, too",
        ),
        pytest.param(
            make_outcome("identified-in-part", 400.0),
            make_outcome("indistinguishable", 100.0, n_shifts=1, prediction=object()), 100.0, True, False,
            id="imperfect law",
        ),
    ],
)  # fmt: skip
def test_linear_commands_are_chosen_where_only_a_shift_of_them_explains_the_data(
    hold: Any, linear: Any, shifted_bic: float, is_searched: bool, is_linear: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command_interpolation, "_copy_weights", lambda data, weighted: data)
    monkeypatch.setattr(command_interpolation, "fit_hypothesis", lambda data, bic: make_fit(bic))
    preparation: Any = SimpleNamespace(data=hold.data, base_fit=make_fit(shifted_bic))
    searched = []

    def search_model(prepared: Any) -> Any:
        searched.append(prepared)
        return linear

    assert reconsider_linear_interpolation(hold, preparation, search_model) is (linear if is_linear else hold)
    assert searched == [preparation] * is_searched


def test_gain_of_shifts_is_what_is_lost_without_all_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    def make_fit(*names: str, bic: float) -> Any:
        hypothesis = SimpleNamespace(terms=tuple(SimpleNamespace(effect=name) for name in names))
        return SimpleNamespace(hypothesis=hypothesis, bic=lambda n_effective: bic)

    final = make_fit("clock_skew", "leak", "pressure_delay", bic=100.0)
    reduced = {
        "clock_skew": make_fit("leak", "pressure_delay", bic=130.0),
        "pressure_delay": make_fit("leak", bic=175.0),
    }
    monkeypatch.setattr(command_interpolation, "refit_without_term", lambda data, fit, term: reduced[term.effect])
    data, selected = SimpleNamespace(n_effective=100.0), SimpleNamespace(final_fit=final)
    outcome = command_interpolation.Outcome([], *[cast(Any, value) for value in (data, None, None, selected)], [])
    assert outcome.compute_shift_gain() == 75.0


@pytest.mark.slow
def test_delay_below_a_sampling_interval_is_found_where_commands_are_linear(tmp_path: Path) -> None:
    hidden = {("pressure_delay", "dead_time"): {"delay_s": 0.6 * INTERVAL_S}}
    diagnosis = workflow.diagnose(load_dataset(write_dataset(tmp_path / "d", hidden)))
    assert [term.effect for term in diagnosis.added_terms] == ["pressure_delay"]
    assert not any("held until" in reason for reason in diagnosis.reasons)
