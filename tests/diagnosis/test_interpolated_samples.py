"""Channels of instruments that are slower than the log, interpolated between their readings: only readings count."""

import numpy as np
import pytest

from klute_sim.datasets.trial import Trial
from klute_sim.diagnosis.experiments.interpolated_samples import (
    describe_interpolated_samples,
    drop_interpolated_samples,
)
from tests.diagnosis.synthetic_trial import make_trial as make_trial_at

INTERVAL_S, N = 5e-3, 2000
TIME = INTERVAL_S * np.arange(float(N))
MOTION, COMMAND = 0.35 - 0.005 * np.sin(4.0 * TIME), 2e5 + 1e5 * np.sin(3.0 * TIME)
NOISY_FORCE = 900.0 - 2e4 * (MOTION - 0.35) + np.random.default_rng(0).normal(0.0, 3.0, N)


def interpolate(values: np.ndarray, step: int, first: int = 0) -> np.ndarray:
    return np.interp(TIME, TIME[first::step], values[first::step])


def make_trial(force: np.ndarray, length: np.ndarray = MOTION) -> Trial:
    return make_trial_at(TIME, length, COMMAND, force=force)


@pytest.mark.parametrize(("step", "first"), [(2, 0), (2, 1), (5, 3), (10, 0), (50, 0)])
@pytest.mark.parametrize("resolution_n", [0.0, 0.001, 0.01])
def test_only_readings_count(step: int, first: int, resolution_n: float) -> None:
    """Logs round interpolated samples, too."""
    force = interpolate(NOISY_FORCE, step, first)
    trial = make_trial(np.round(force / resolution_n) * resolution_n if resolution_n else force)
    series = drop_interpolated_samples(trial).measured["force"]
    assert series.time == pytest.approx(TIME[first::step])
    assert series.value == pytest.approx(NOISY_FORCE[first::step], abs=resolution_n)
    (sentence,) = describe_interpolated_samples([trial])
    assert sentence.endswith(f"'force' (every {5 * step} ms).")


HUM = 5.0 * np.sin(2.0 * np.pi * 50.0 * TIME + 1.4)


@pytest.mark.parametrize(
    "force",
    [
        pytest.param(NOISY_FORCE, id="reading in each sample"),
        pytest.param(NOISY_FORCE + HUM, id="hum with four samples per period"),
        pytest.param(np.round(NOISY_FORCE / 10.0) * 10.0, id="coarse resolution"),
        pytest.param(NOISY_FORCE[::10].repeat(10), id="held"),
        pytest.param(900.0 - 2e4 * (MOTION - 0.35), id="smooth"),
        pytest.param(np.full(N, 900.0), id="constant"),
        pytest.param(900.0 + 10.0 * TIME, id="a straight line"),
        pytest.param(np.where(TIME < 5.0, 900.0, 800.0), id="a step"),
        pytest.param(np.where(np.arange(N) == 7, np.nan, interpolate(NOISY_FORCE, 10)), id="missing sample"),
        pytest.param(interpolate(NOISY_FORCE, 200), id="too few readings"),
    ],
)
def test_other_channels_stay(force: np.ndarray) -> None:
    trial = make_trial(force)
    np.testing.assert_array_equal(drop_interpolated_samples(trial).measured["force"].value, force)
    assert describe_interpolated_samples([trial]) == []


def test_prescribed_lines_stay() -> None:
    """A tester may follow a program of straight lines."""
    program = interpolate(MOTION, 10)
    dropped = drop_interpolated_samples(make_trial(NOISY_FORCE, program))
    np.testing.assert_array_equal(dropped.prescribed["length"].value, program)
