"""The hum of the mains is subtracted; motions and noise stay."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.datasets.trial import Trial
from klute_sim.diagnosis.experiments.mains_hum import describe_mains_hum, remove_mains_hum
from tests.diagnosis.synthetic_trial import make_trial as make_trial_at

RATE_HZ, DURATION_S = 500.0, 12.0
TIME = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
MOTION = 900.0 + 300.0 * np.sin(2.0 * np.pi * 0.7 * TIME)


def make_trial(time: np.ndarray, **measured: np.ndarray) -> Trial:
    return make_trial_at(time, np.full(len(time), 0.35), np.full(len(time), 2e5), **measured)


def make_hum(frequency: float, amplitude: float, phase: float = 1.0) -> np.ndarray:
    return amplitude * np.sin(2.0 * np.pi * frequency * TIME + phase)


@settings(max_examples=15, deadline=None)
@given(st.floats(49.8, 50.2) | st.floats(59.8, 60.2), st.floats(1.0, 20.0), st.floats(0.0, 6.28))
def test_hum_is_subtracted(frequency: float, amplitude: float, phase: float) -> None:
    noise = np.random.default_rng(0).normal(0.0, 4.0, len(TIME))
    trial = make_trial(TIME, force=MOTION + noise + make_hum(frequency, amplitude, phase))
    cleaned = remove_mains_hum(trial).measured["force"].value
    assert np.std(cleaned - MOTION - noise) < 0.5  # of noise of 4, which has power of its own at this frequency


def test_harmonics_are_named() -> None:
    trial = make_trial(TIME, force=MOTION + make_hum(50.0, 5.0) + make_hum(150.0, 2.0))
    (sentence,) = describe_mains_hum([trial])
    assert "'force' (5 N at 50 Hz and 2 N at 150 Hz)" in sentence
    assert remove_mains_hum(trial).measured["force"].value == pytest.approx(MOTION, abs=0.1)


def test_frequency_that_wanders_in_a_long_record() -> None:
    time = np.arange(0.0, 60.0, 1.0 / RATE_HZ)
    phase = 2.0 * np.pi * np.cumsum(50.0 + 0.02 * np.sin(2.0 * np.pi * time / 60.0)) / RATE_HZ
    cleaned = remove_mains_hum(make_trial(time, force=5.0 * np.sin(phase))).measured["force"].value
    assert np.std(cleaned) < 0.5


def test_hum_beside_missing_samples() -> None:
    force = MOTION + make_hum(50.0, 5.0)
    force[1000:1100] = np.nan
    cleaned = remove_mains_hum(make_trial(TIME, force=force)).measured["force"].value
    np.testing.assert_array_equal(np.isnan(cleaned), np.isnan(force))
    assert np.nanstd(cleaned - MOTION) < 0.5


STEP = np.where(TIME % 2.0 < 1.0, 900.0, 500.0)


@pytest.mark.parametrize(
    "force",
    [
        MOTION,
        MOTION + np.random.default_rng(1).normal(0.0, 4.0, len(TIME)),
        STEP,
        np.sign(np.sin(2.0 * np.pi * 2.5 * TIME)),  # has lines at 47.5, 52.5, ... Hz
        np.abs(np.sin(2.0 * np.pi * 5.0 * TIME)),  # has lines at 50, 60, ... Hz
        make_hum(41.0, 5.0),
        np.full(len(TIME), 3.0),
        3e5 + 1e-8 * np.random.default_rng(1).normal(size=len(TIME)) + make_hum(50.0, 1e-6),
    ],
    ids=["motion", "white noise", "steps", "square wave", "rectified sine", "vibration", "constant", "rounding"],
)
def test_other_signals_stay(force: np.ndarray) -> None:
    trial = make_trial(TIME, force=force)
    np.testing.assert_array_equal(remove_mains_hum(trial).measured["force"].value, force)
    assert describe_mains_hum([trial]) == []


@pytest.mark.parametrize("step", [5, 700], ids=["slow", "short"])
def test_records_without_the_frequency_stay(step: int) -> None:
    part = slice(None, None, step) if step < 10 else slice(0, step)
    force = (MOTION + make_hum(50.0, 5.0))[part]
    trial = make_trial(TIME[part], force=force)
    np.testing.assert_array_equal(remove_mains_hum(trial).measured["force"].value, force)
