"""Displays that show whole steps only: seen in the data's own grid, and looked at as such."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.hidden_effects.generate import make_dataset
from benchmarks.hidden_effects.score import score_verdict
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import Series
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.quantization import Quantizer, detect_quantizers
from klute_sim.diagnosis.verdict import verdict_to_dict
from klute_sim.diagnosis.workflow import DiagnosisOptions, diagnose
from klute_sim.report.diagnosis import text as words

RANDOM = np.random.default_rng(4)
TRUE = 200.0 + 150.0 * np.sin(np.arange(3000) / 300.0)


def repeats(values: list[np.ndarray]) -> list[Experiment]:
    device, time, nothing = load_device("klute-3-4-pair"), np.arange(len(values[0])) * 0.005, np.zeros(3)
    return [
        BenchExperiment(
            f"{k}", "g", "fit", device, 0.0, 0.005, nothing, {"force": Series(time, v)}, unit_length=nothing
        )
        for k, v in enumerate(values)
    ]


def rounded(value: np.ndarray, step: float, zero: float = 0.0) -> np.ndarray:
    return zero + step * np.round((value - zero) / step)


@settings(max_examples=20, deadline=None)
@given(step=st.floats(2.0, 60.0), zero=st.floats(-5.0, 5.0))
def test_step_and_noise_are_read_off_the_data(step: float, zero: float) -> None:
    noisy = [rounded(TRUE + RANDOM.normal(0.0, 1.5, len(TRUE)), step, zero).round(3) for _ in range(2)]
    every = repeats(noisy)
    found = detect_quantizers(every, every)[1]["force"]
    assert abs(found.resolution - step) < found.resolution_error < 0.01 * step
    offset = (found.offset - zero) / step
    assert abs(offset - round(offset)) < 0.01
    if 0.1 < 1.5 / step < 0.5:
        assert found.dither == pytest.approx(1.5 / step, rel=0.15)


@pytest.mark.parametrize("step", [0.0, 0.001, 0.5])
def test_figures_are_no_display(step: float) -> None:
    """Decimals, and steps that are lost in the noise, are not worth a word."""
    noisy = [TRUE + RANDOM.normal(0.0, 3.0, len(TRUE)) for _ in range(2)]
    every = repeats([rounded(v, step) if step else v for v in noisy])
    assert detect_quantizers(every, every)[1] == {}


@pytest.mark.parametrize("dither", [0.1, 0.2, 0.4])
def test_a_display_shows_the_mean_of_what_noise_lets_it_show(dither: float) -> None:
    step, zero = 12.0, 1.0
    value = np.linspace(-20.0, 20.0, 41)
    drawn = rounded(value + RANDOM.normal(0.0, dither * step, (20_000, 41)), step, zero).mean(axis=0)
    assert Quantizer(step, 0.0, zero, dither).quantize(value) == pytest.approx(drawn, abs=0.02 * step)


@pytest.mark.long
def test_a_quantised_force_is_named_and_leaves_no_more_than_noise(tmp_path: Path) -> None:
    fault = {"name": "quantisation", "form": "linear", "channel": "force", "parameters": {"step": 17.0}}
    truth = make_dataset(tmp_path / "d", 5, instruments=[fault], muscle_length=False)
    dataset = datasets.load_dataset(tmp_path / "d")
    found = diagnose(dataset, DiagnosisOptions(only=("muscle_damping", "end_taper")))
    verdict = verdict_to_dict(found)
    assert score_verdict(truth, verdict) == "right"
    (step,) = verdict["effects"][0]["parameters"].values()
    assert step["low"] < 17.0 < step["high"]
    assert step["high"] - step["low"] < 0.01
    assert words.describe_verdict(found) == "An instrument is at fault: quantisation of force."
    assert any("17 N" in reason for reason in found.reasons)
    gap = found.channel_rms["force"]
    assert gap.noise_floor is not None
    assert gap.with_effects < 1.1 * gap.noise_floor
    quiet = diagnose(dataset, DiagnosisOptions(only=("muscle_damping",), exclude=("quantisation",)))
    assert quiet.verdict == "nothing-missing"
