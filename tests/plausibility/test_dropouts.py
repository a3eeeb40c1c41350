"""Lost samples are told from the steps of an analogue-to-digital converter and from held samples."""

import numpy as np
import pytest

from klute_sim.plausibility.bench.dropouts import check_dropouts
from klute_sim.plausibility.bench.trial import SI_UNITS, Channel, DeviceLimits, RecordedTrial, Response
from klute_sim.plausibility.samples import Samples
from klute_sim.types import Array

LIMITS = DeviceLimits(0.18, 0.12, 0.0, 5e5, 1200.0)
FULL_SCALES = {"force": 1500.0, "pressure": 10e5, "muscle_length": 0.2}
LEVELS = {"force": 400.0, "pressure": 3e5, "muscle_length": 0.15}
TIME = np.arange(0.0, 6.0, 0.01)
STEP = np.where(TIME < 3.0, 0.6, 1.0)


def make_trial(name: str, value: Array, expected: Array) -> RecordedTrial:
    """Return a trial that measures ``value`` where a simulation gives ``expected``, in SI units."""
    inputs = {"length": np.full(len(TIME), 0.16), "pressure_command": np.full(len(TIME), 3e5)}

    def simulate(dt: float, length: Array, command: Array) -> Response:
        time = dt * np.arange(1.0, len(length) + 1.0)
        simulated = np.interp(time, TIME, expected)
        return Response(time, simulated, simulated, simulated)

    channels = {
        channel: Channel(TIME, Samples(channel, samples, SI_UNITS[channel], 1.0))
        for channel, samples in {**inputs, name: value}.items()
    }
    return RecordedTrial("a", channels, LIMITS, simulate)


@pytest.mark.parametrize("name", FULL_SCALES)
@pytest.mark.parametrize("n_bits", [8, 10, 12, 14])
@pytest.mark.parametrize("noise", [0.3, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("waveform", ["constant", "step"])
def test_codes_of_a_converter_are_no_dropouts(name: str, n_bits: int, noise: float, waveform: str) -> None:
    step = FULL_SCALES[name] / 2**n_bits
    expected = LEVELS[name] * (STEP if waveform == "step" else np.ones(len(TIME)))
    for seed in range(10):
        value = step * np.round(expected / step + np.random.default_rng(seed).normal(0.0, noise, len(TIME)))
        assert check_dropouts(make_trial(name, value, expected)) == []


def test_samples_that_a_slow_sensor_holds_are_no_dropouts() -> None:
    held = np.repeat(3e5 + np.random.default_rng(0).normal(0.0, 800.0, len(TIME) // 6), 6)
    assert check_dropouts(make_trial("pressure", held, np.full(len(TIME), 3e5))) == []


@pytest.mark.parametrize("name", FULL_SCALES)
@pytest.mark.parametrize("n_bits", [8, 12, 0])
@pytest.mark.parametrize("lost", [0.0, 1.0, 0.6])
@pytest.mark.parametrize("waveform", ["constant", "step"])
def test_jumps_to_a_far_value_and_back_are_dropouts(name: str, n_bits: int, lost: float, waveform: str) -> None:
    """The lost samples read 0, the full scale, or a value between; without bits there is no converter."""
    expected = LEVELS[name] * (STEP if waveform == "step" else np.ones(len(TIME)))
    step = FULL_SCALES[name] / 2 ** (n_bits or 12)
    value = expected + np.random.default_rng(0).normal(0.0, 0.5 * step, len(TIME))
    value = step * np.round(value / step) if n_bits else value
    value[200:240] = lost * FULL_SCALES[name]
    (finding,) = check_dropouts(make_trial(name, value, expected))
    assert finding.name == f"{name}-missing"
    assert "stays there for 40 samples and jumps back" in finding.statement


def test_dropouts_of_a_channel_without_noise_are_found() -> None:
    expected = 3e5 * STEP
    value = expected.copy()
    value[200:240] = 0.0
    (finding,) = check_dropouts(make_trial("pressure", value, expected))
    assert "pressure jumps from 180000 Pa to exactly 0 Pa" in finding.statement


@pytest.mark.parametrize("delay", [-0.1, 0.0, 0.1])
def test_plateau_of_a_clipped_sensor_is_no_dropout(delay: float) -> None:
    """The muscle answers somewhat earlier or later than the simulation."""
    expected = np.where((TIME > 2.0) & (TIME < 2.5), 4e5, 0.0)
    answer = np.interp(TIME - delay, TIME, expected)
    value = np.minimum(answer + np.random.default_rng(0).normal(0.0, 200.0, len(TIME)), 3e5)
    assert check_dropouts(make_trial("pressure", value, expected)) == []
