"""Channels of instruments that are slower than the log: only readings count, and commands stay as they are."""

import numpy as np
import pytest

from klute_sim.datasets.trial import Trial
from klute_sim.diagnosis.experiments.held_samples import describe_held_samples, drop_held_samples
from tests.diagnosis.synthetic_trial import make_trial as make_trial_at

INTERVAL_S, N = 1e-3, 3000
TIME = INTERVAL_S * np.arange(float(N))
MOTION = 0.35 - 0.005 * np.sin(4.0 * TIME)


def hold(values: np.ndarray, n_held: int) -> np.ndarray:
    return values[::n_held].repeat(n_held)[: len(values)]


def make_trial(length: np.ndarray, **measured: np.ndarray) -> Trial:
    return make_trial_at(TIME, length, hold(2e5 + 1e5 * np.sin(3.0 * TIME), 10), **measured)


@pytest.mark.parametrize("n_held", [2, 5, 10, 20])
def test_only_readings_count(n_held: int) -> None:
    noise = np.random.default_rng(0).normal(0.0, 5.0, N)
    trial = make_trial(hold(MOTION, n_held), force=hold(900.0 + noise, n_held), pressure=2e5 + 100.0 * noise)
    dropped = drop_held_samples(trial)
    for name, series in (("length", dropped.prescribed["length"]), ("force", dropped.measured["force"])):
        assert series.time == pytest.approx(TIME[::n_held]), name
    assert dropped.prescribed["length"].value == pytest.approx(MOTION[::n_held])
    for name in ("pressure_command", "pressure"):
        unchanged = (trial.prescribed | trial.measured)[name]
        np.testing.assert_array_equal((dropped.prescribed | dropped.measured)[name].value, unchanged.value)
    (sentence,) = describe_held_samples([trial])
    assert sentence.endswith(f"'length' (for {n_held} ms), 'force' (for {n_held} ms).")


def test_rest_keeps_its_readings() -> None:
    """A motion that pauses is still read in the pause, so no curve bridges it."""
    moving = np.where((TIME > 1.0) & (TIME < 2.0), MOTION[1000], MOTION)
    series = drop_held_samples(make_trial(hold(moving, 10), force=TIME)).prescribed["length"]
    assert np.diff(series.time).max() == pytest.approx(10 * INTERVAL_S)
    assert np.interp(1.5, series.time, series.value) == MOTION[1000]


def test_reading_may_come_a_sample_late() -> None:
    starts = np.sort(np.unique(np.r_[0, np.arange(10, N, 10) + np.random.default_rng(1).integers(0, 2, 299)]))
    held = MOTION[starts].repeat(np.diff(np.r_[starts, N]))
    series = drop_held_samples(make_trial(held, force=TIME)).prescribed["length"]
    assert series.time == pytest.approx(TIME[starts])


@pytest.mark.parametrize(
    "length",
    [MOTION, np.round(MOTION, 4), np.full(N, 0.35), np.where(TIME < 1.5, 0.35, 0.34)],
    ids=["each sample", "resolution of the log", "constant", "a step"],
)
def test_other_channels_stay(length: np.ndarray) -> None:
    trial = make_trial(length, force=TIME)
    np.testing.assert_array_equal(drop_held_samples(trial).prescribed["length"].value, length)
    assert describe_held_samples([trial]) == []


def test_channel_with_missing_samples_stays() -> None:
    force = hold(900.0 + np.random.default_rng(0).normal(0.0, 5.0, N), 10)
    force[7] = np.nan
    assert len(drop_held_samples(make_trial(MOTION, force=force)).measured["force"].time) == N
