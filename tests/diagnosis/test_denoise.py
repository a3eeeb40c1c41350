"""Denoising of prescribed channels: less noise in holds and ramps, unchanged corners."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.diagnosis.experiments.denoise import CONFIDENCE_SIGMAS, WINDOW_SIZES, denoise, estimate_white_noise

TIME = np.arange(1200) * 0.005


def make_ramp(speed: float) -> np.ndarray:
    """Return a hold, a ramp with sharp corners, and a hold [mm]."""
    return 330.0 + speed * np.clip(TIME - 2.0, 0.0, 1.0)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    deviation=st.floats(1e-6, 1.0),
    speed=st.floats(-300.0, 300.0),
    frequency=st.floats(0.0, 20.0),
)
def test_no_sample_changes_by_more_than_its_noise(seed: int, deviation: float, speed: float, frequency: float) -> None:
    value = make_ramp(speed) + np.sin(2 * np.pi * frequency * TIME)
    value = value + np.random.default_rng(seed).normal(0.0, deviation, len(value))
    assert np.abs(denoise(TIME, value) - value).max() <= CONFIDENCE_SIGMAS * estimate_white_noise(value) + 1e-9


def test_noise_estimate_ignores_motion() -> None:
    rng = np.random.default_rng(0)
    for deviation in (0.003, 0.01, 0.1):
        value = make_ramp(80.0) + rng.normal(0.0, deviation, len(TIME))
        assert estimate_white_noise(value) == pytest.approx(deviation, rel=0.1)


@pytest.mark.parametrize("speed", [0.0, 20.0, 300.0])
def test_holds_and_ramps_are_denoised_and_corners_preserved(speed: float) -> None:
    truth = make_ramp(speed)
    value = truth + np.random.default_rng(1).normal(0.0, 0.01, len(TIME))
    denoised = denoise(TIME, value)
    is_steady = np.abs(TIME - 2.5) > 0.6  # windows are narrower near the corners
    assert np.std((denoised - truth)[is_steady]) < 0.6 * 0.01
    assert np.abs(denoised - truth).max() < 3.0 * CONFIDENCE_SIGMAS * 0.01
    # Fewer reversals, because they change the state of friction.
    rate_after, rate_before = (np.diff(signal - truth)[is_steady[1:]] for signal in (denoised, value))
    assert np.std(rate_after) < 0.45 * np.std(rate_before)


def test_noise_free_and_unevenly_sampled_signals_are_unchanged() -> None:
    quantized = np.round(make_ramp(30.0), 1)  # a coarsely quantized signal that is mostly constant
    assert np.array_equal(denoise(TIME, quantized), quantized)
    value = make_ramp(30.0) + np.random.default_rng(2).normal(0.0, 0.01, len(TIME))
    uneven = TIME + np.where(np.arange(len(TIME)) % 2, 0.002, 0.0)
    assert denoise(uneven, value) is value
    short = value[: 2 * WINDOW_SIZES[-1] - 1]
    assert denoise(TIME[: len(short)], short) is short
