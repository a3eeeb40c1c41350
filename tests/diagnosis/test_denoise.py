"""Noise taken off prescribed channels: less of it where nothing happens, nothing else anywhere."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.diagnosis.experiments.denoise import CONFIDENCE_SIGMAS, WINDOW_SIZES, denoise, estimate_white_noise

TIME = np.arange(1200) * 0.005


def ramps(speed: float) -> np.ndarray:
    """Rest, a ramp with sharp corners, and rest [mm]."""
    return 330.0 + speed * np.clip(TIME - 2.0, 0.0, 1.0)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    deviation=st.floats(1e-6, 1.0),
    speed=st.floats(-300.0, 300.0),
    frequency=st.floats(0.0, 20.0),
)
def test_no_sample_is_moved_by_more_than_its_own_noise(
    seed: int, deviation: float, speed: float, frequency: float
) -> None:
    value = ramps(speed) + np.sin(2 * np.pi * frequency * TIME)
    value = value + np.random.default_rng(seed).normal(0.0, deviation, len(value))
    assert np.abs(denoise(TIME, value) - value).max() <= CONFIDENCE_SIGMAS * estimate_white_noise(value) + 1e-9


def test_noise_is_told_from_motion() -> None:
    random = np.random.default_rng(0)
    for deviation in (0.003, 0.01, 0.1):
        value = ramps(80.0) + random.normal(0.0, deviation, len(TIME))
        assert estimate_white_noise(value) == pytest.approx(deviation, rel=0.1)


@pytest.mark.parametrize("speed", [0.0, 20.0, 300.0])
def test_holds_and_ramps_get_quiet_and_corners_stay(speed: float) -> None:
    true = ramps(speed)
    value = true + np.random.default_rng(1).normal(0.0, 0.01, len(TIME))
    found = denoise(TIME, value)
    steady = np.abs(TIME - 2.5) > 0.6  # nearer to the corners windows are narrower
    assert np.std((found - true)[steady]) < 0.6 * 0.01
    assert np.abs(found - true).max() < 3.0 * CONFIDENCE_SIGMAS * 0.01
    # It trembles less: reversals are what friction remembers.
    tremble, before = (np.diff(each - true)[steady[1:]] for each in (found, value))
    assert np.std(tremble) < 0.45 * np.std(before)


def test_what_has_no_noise_or_no_even_samples_stays_as_it_is() -> None:
    held = np.round(ramps(30.0), 1)  # a coarse display of what mostly rests
    assert np.array_equal(denoise(TIME, held), held)
    value = ramps(30.0) + np.random.default_rng(2).normal(0.0, 0.01, len(TIME))
    uneven = TIME + np.where(np.arange(len(TIME)) % 2, 0.002, 0.0)
    assert denoise(uneven, value) is value
    short = value[: 2 * WINDOW_SIZES[-1] - 1]
    assert denoise(TIME[: len(short)], short) is short
