"""What test trials decide: they confirm names, demote a verdict, and reveal a misfit that other trials do not show."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from klute_sim.api.rendering import render_text
from klute_sim.datasets import dataset as datasets
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.held_out import (
    BASE_MODEL,
    FINAL_MODEL,
    NOMINAL_MODEL,
    judge_divergence,
    judge_misfit,
    judge_names,
)
from klute_sim.diagnosis.noise.misfit import Misfit
from klute_sim.diagnosis.result import ChannelRms, Diagnosis, Verdict
from klute_sim.diagnosis.transfer import ChannelPrediction, TransferPrediction
from klute_sim.report.diagnosis.table import build_prediction_table
from tests.diagnosis.synthetic_dataset import write_dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> datasets.Dataset:
    folder: Path = write_dataset(tmp_path_factory.mktemp("held_out") / "d", groups=("fit_1", "test_1"), seconds=1.0)
    return datasets.load_dataset(folder)


def make_diagnosis(dataset: datasets.Dataset, verdict: Verdict, **rms: Any) -> Diagnosis:
    return Diagnosis(
        dataset=dataset,
        split=datasets.split_dataset(dataset),
        verdict=verdict,
        reasons=["a reason"],
        channel_rms={"force": ChannelRms(**({"nominal": 50.0, "noise_floor": 3.0} | rms))} if rms else {},
    )


@pytest.mark.parametrize(
    ("verdict", "rms", "significance", "expected"),
    [
        ("nothing-missing", 6.0, 20.0, "unexplained"),
        ("identified", 6.0, 20.0, "identified-in-part"),
        ("nothing-missing", 2.0, 20.0, "nothing-missing"),
        ("nothing-missing", 6.0, 3.0, "nothing-missing"),
        ("unexplained", 6.0, 20.0, "unexplained"),
        ("identified-in-part", 6.0, 20.0, "identified-in-part"),
    ],
)
def test_misfit_of_test_trials_demotes_a_verdict_that_denies_it(
    verdict: Verdict, rms: float, significance: float, expected: str, dataset: datasets.Dataset
) -> None:
    diagnosis = make_diagnosis(dataset, verdict)
    judge_misfit(diagnosis, {"force": Misfit(rms, significance, 3.0), "pressure": Misfit(0.0, 0.0, 1e3)})
    assert diagnosis.verdict == expected
    is_demoted = expected != verdict
    assert (diagnosis.reasons[0] != "a reason") == is_demoted
    if is_demoted:
        assert "'force' in the test trials show a misfit of 2.00 times the noise" in diagnosis.reasons[0]


@pytest.mark.parametrize(
    ("refitted", "with_effects", "held_out", "verdict", "is_worse"),
    [
        (12.0, 3.1, "confirmed", "identified", False),
        (12.0, 11.0, "not-confirmed", "unexplained", False),
        (6.0, 12.0, "not-confirmed", "unexplained", True),
    ],
)
def test_names_hold_only_if_the_gap_of_test_trials_shrinks(
    refitted: float, with_effects: float, held_out: str, verdict: str, is_worse: bool, dataset: datasets.Dataset
) -> None:
    diagnosis = make_diagnosis(dataset, "identified", refitted=refitted, with_effects=with_effects)
    judge_names(diagnosis)
    assert (diagnosis.held_out, diagnosis.verdict, diagnosis.is_worse_on_test) == (held_out, verdict, is_worse)


@pytest.mark.parametrize(
    ("diverged", "has_effects", "verdict", "held_out", "is_worse"),
    [
        ((), True, "identified", "confirmed", False),
        ((NOMINAL_MODEL,), True, "identified", "confirmed", False),
        ((NOMINAL_MODEL, BASE_MODEL), True, "identified", "confirmed", False),  # the names make it possible
        ((FINAL_MODEL,), True, "unexplained", "not-confirmed", True),
        ((BASE_MODEL, FINAL_MODEL), True, "unexplained", "not-confirmed", False),
        ((BASE_MODEL,), False, "unexplained", "not-tested", False),
    ],
)
def test_diverging_test_trial_counts_as_failed_prediction(
    diverged: tuple[str, ...],
    has_effects: bool,
    verdict: str,
    held_out: str,
    is_worse: bool,
    dataset: datasets.Dataset,
) -> None:
    diagnosis = make_diagnosis(dataset, "identified" if has_effects else "nothing-missing")
    if has_effects:
        diagnosis.added_terms, diagnosis.held_out = (EffectTerm("braid_hysteresis", "proportional"),), "confirmed"
    diagnosis.diverged_trials = dict.fromkeys(diverged, ("test_1_0",))
    judge_divergence(diagnosis)
    assert (diagnosis.verdict, diagnosis.held_out, diagnosis.is_worse_on_test) == (verdict, held_out, is_worse)
    if diverged:
        models = " and with ".join(diverged)
        assert diagnosis.reasons[0].startswith(f"The simulation of 'test_1_0' with {models} diverges: the prediction")
    else:
        assert diagnosis.reasons == ["a reason"]


def test_prediction_that_diverges_is_no_number() -> None:
    channels = {"force": ChannelPrediction(nominal=4.0, refitted=2.0, with_effects=np.inf, measured_range=100.0)}
    prediction = TransferPrediction("other", channels, "with-effects")
    assert prediction.to_dict()["channels"] == {
        "force": {
            **{"unit": "N", "nominal": 4.0, "refitted": 2.0, "with_effects": None},
            **{"range": 100.0, "with_effects_pct_of_range": None},
        }
    }
    assert "diverges" in render_text([build_prediction_table(prediction)])
