"""Quantized channels: detection of the resolution in the data, and the model of the quantizer."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.hidden_effects.generate import make_dataset
from benchmarks.hidden_effects.score import score_verdict
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.datasets import dataset as datasets
from klute_sim.datasets.trial import SensorLimits, TimeSeries, Trial
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.base import SimulationSetup
from klute_sim.diagnosis.experiments.bench import prepare_bench_trial
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.noise.quantization import Quantizer, detect_quantizers
from klute_sim.diagnosis.result import DiagnosisOptions
from klute_sim.diagnosis.verdict import verdict_to_dict
from klute_sim.diagnosis.workflow import diagnose
from klute_sim.report.diagnosis import text as text
from tests.diagnosis.synthetic_dataset import make_repeats

SIMULATOR = Simulator(1)
RNG = np.random.default_rng(4)
TRUE_FORCE = 200.0 + 150.0 * np.sin(np.arange(3000) / 300.0)


def quantize(value: np.ndarray, step: float, zero: float = 0.0) -> np.ndarray:
    return zero + step * np.round((value - zero) / step)


@settings(max_examples=20, deadline=None)
@given(step=st.floats(2.0, 60.0), zero=st.floats(-5.0, 5.0))
def test_resolution_and_dither_are_detected_in_the_data(step: float, zero: float) -> None:
    rng = np.random.default_rng(4)  # for each example, so that it does not depend on the order of the examples
    noisy = [quantize(TRUE_FORCE + rng.normal(0.0, 1.5, len(TRUE_FORCE)), step, zero).round(3) for _ in range(2)]
    experiments = make_repeats(noisy)
    result = detect_quantizers(experiments, experiments, SIMULATOR)[1]["force"]
    assert abs(result.resolution - step) < result.resolution_error < 0.01 * step
    offset = (result.offset - zero) / step
    assert abs(offset - round(offset)) < 0.01
    if 0.1 < 1.5 / step < 0.5:
        # Less noise crosses fewer steps: in 144 draws the error was 25 % at 0.1 of a step, 12 % from 0.15 on.
        assert result.dither == pytest.approx(1.5 / step, rel=0.15 if 1.5 / step > 0.15 else 0.3)


@pytest.mark.parametrize("limits", [SensorLimits(-np.inf, 300.0), SensorLimits(100.0, np.inf)])
def test_samples_at_a_limit_hide_no_quantizer(limits: SensorLimits) -> None:
    """A limit is stated within the range of the converter, so samples beyond it are not on its grid."""
    noisy = [quantize(TRUE_FORCE + RNG.normal(0.0, 1.5, len(TRUE_FORCE)), 7.0) for _ in range(2)]
    free = make_repeats(noisy)
    clipped = [replace(e, limits={"force": limits}) for e in make_repeats([np.clip(v, *limits) for v in noisy])]
    expected, found = (detect_quantizers(each, each, SIMULATOR)[1]["force"] for each in (free, clipped))
    assert found.resolution == pytest.approx(expected.resolution)
    assert found.dither == pytest.approx(expected.dither, rel=0.05)


@pytest.mark.parametrize("step", [0.0, 0.001, 0.5])
def test_decimals_are_not_a_quantizer(step: float) -> None:
    """Steps below the noise do not matter."""
    noisy = [TRUE_FORCE + RNG.normal(0.0, 3.0, len(TRUE_FORCE)) for _ in range(2)]
    experiments = make_repeats([quantize(v, step) if step else v for v in noisy])
    assert detect_quantizers(experiments, experiments, SIMULATOR)[1] == {}


@pytest.mark.parametrize("shift", [0, 1, 2, 5])
def test_quantizer_is_found_in_repeats_that_start_a_few_samples_apart(shift: int) -> None:
    """Steps of the pressure of 10 mbar with a noise of 3 mbar; the command of one repeat is late."""
    step, noise, interval, n_samples = 1e3, 300.0, 0.005, 800
    steps = np.random.default_rng(0).uniform(1e5, 4e5, 20).repeat(n_samples // 20)
    experiments = []
    for k, late in enumerate((0, shift)):
        time = interval * np.arange(n_samples)
        command = np.concatenate([np.full(100 + late, steps[0]), steps])[:n_samples]
        inputs = {"length": np.full(n_samples, 0.34), "pressure_command": command}
        trial = Trial(
            name=f"g{k}",
            group="g",
            use="fit",
            device=load_device("klute-3-4-pair"),
            files=(Path("a.csv"),),
            prescribed={name: TimeSeries(time, values) for name, values in inputs.items()},
            measured={"pressure": TimeSeries(time, command)},
        )
        nominal = prepare_bench_trial(trial, "fit")
        setup = SimulationSetup(trial.device.parameters)
        reading = SIMULATOR.simulate([[setup]], [nominal])[0][0]["pressure"]
        measured = quantize(reading + RNG.normal(0.0, noise, len(reading)), step)
        series = nominal.measured["pressure"]._replace(value=measured)
        experiments.append(replace(nominal, measured={"pressure": series}))
    quantizer = detect_quantizers(experiments, experiments, SIMULATOR)[1]["pressure"]
    assert quantizer.resolution == pytest.approx(step, rel=1e-3)
    assert quantizer.dither == pytest.approx(noise / step, abs=0.1)  # 20 levels hold few phases of the staircase


@pytest.mark.parametrize("dither", [0.1, 0.2, 0.4])
def test_quantizer_returns_the_mean_reading_under_noise(dither: float) -> None:
    step, zero = 12.0, 1.0
    value = np.linspace(-20.0, 20.0, 41)
    mean_reading = quantize(value + RNG.normal(0.0, dither * step, (20_000, 41)), step, zero).mean(axis=0)
    assert Quantizer(step, 0.0, zero, dither).quantize(value) == pytest.approx(mean_reading, abs=0.02 * step)


@pytest.mark.long
def test_quantized_force_is_identified_and_leaves_only_noise(tmp_path: Path) -> None:
    fault = {"name": "quantisation", "form": "linear", "channel": "force", "parameters": {"step": 17.0}}
    truth = make_dataset(tmp_path / "d", 5, instruments=[fault], muscle_length=False)
    dataset = datasets.load_dataset(tmp_path / "d")
    result = diagnose(dataset, DiagnosisOptions(only=("muscle_damping", "end_taper", "quantisation")))
    verdict = verdict_to_dict(result)
    assert score_verdict(truth, verdict) == "right"
    (step,) = verdict["effects"][0]["parameters"].values()
    assert step["low"] < 17.0 < step["high"]
    assert step["high"] - step["low"] < 0.01
    assert text.describe_verdict(result) == "An instrument has a fault: quantisation of force."
    assert any("17 N" in reason for reason in result.reasons)
    gap = result.channel_rms["force"]
    assert gap.noise_floor is not None
    assert gap.with_effects < 1.1 * gap.noise_floor
    without_quantization = diagnose(dataset, DiagnosisOptions(only=("muscle_damping",), exclude=("quantisation",)))
    assert without_quantization.verdict == "nothing-missing"
