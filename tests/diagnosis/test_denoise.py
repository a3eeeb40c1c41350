"""Denoising of prescribed channels: less noise in holds and ramps, unchanged corners."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.experiments.denoise import (
    MAX_CHANGE_SIGMAS,
    MAX_UNEVEN_CHANGE_SIGMAS,
    WINDOW_SIZES,
    denoise,
    estimate_white_noise,
)
from klute_sim.diagnosis.experiments.interpolation import denoise_command

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
    change, noise = np.abs(denoise(TIME, value) - value), estimate_white_noise(TIME, value)
    assert change.max() <= MAX_UNEVEN_CHANGE_SIGMAS * noise + 1e-9  # in holds by the noise of the sample
    assert np.mean(change <= MAX_CHANGE_SIGMAS * noise + 1e-9) > 0.9


def test_noise_estimate_ignores_motion() -> None:
    rng = np.random.default_rng(0)
    for deviation in (0.003, 0.01, 0.1):
        value = make_ramp(80.0) + rng.normal(0.0, deviation, len(TIME))
        assert estimate_white_noise(TIME, value) == pytest.approx(deviation, rel=0.1)


@pytest.mark.parametrize("speed", [0.0, 20.0, 300.0])
def test_holds_and_ramps_are_denoised_and_corners_preserved(speed: float) -> None:
    truth = make_ramp(speed)
    value = truth + np.random.default_rng(1).normal(0.0, 0.01, len(TIME))
    denoised = denoise(TIME, value)
    is_steady = np.abs(TIME - 2.5) > 0.6  # windows are narrower near the corners
    assert np.std((denoised - truth)[is_steady]) < 0.6 * 0.01
    assert np.abs(denoised - truth).max() < 3.0 * MAX_CHANGE_SIGMAS * 0.01
    # Fewer reversals, because they change the state of friction.
    rate_after, rate_before = (np.diff(signal - truth)[is_steady[1:]] for signal in (denoised, value))
    assert np.std(rate_after) < 0.45 * np.std(rate_before)


@pytest.mark.parametrize("is_even", [True, False])
def test_hold_becomes_a_constant(is_even: bool) -> None:
    rng = np.random.default_rng(3)
    time = TIME if is_even else np.sort(rng.choice(np.arange(1600) * 0.004, 1200, replace=False))
    truth = np.interp(time, [0.0, 1.0, 1.2, 2.5, 2.6, 7.0], [330.0, 330.0, 340.0, 340.0, 335.0, 335.0])
    denoised = denoise(time, truth + rng.normal(0.0, 0.01, len(time)))
    for begin, end in ((0.0, 1.0), (1.2, 2.5), (2.6, 6.0)):
        inside = (time > begin + 0.05) & (time < end - 0.05)
        assert np.mean(np.diff(denoised[inside]) == 0.0) > 0.9
        assert np.abs(denoised - truth)[inside].mean() < 0.003


@pytest.mark.parametrize("deviation", [0.004, 0.006, 0.012])
def test_hold_of_a_coarse_display_becomes_a_constant(deviation: float) -> None:
    """Its noise has few values. A friction would lose its force by the motion that is left."""
    rng = np.random.default_rng(8)
    truth = make_ramp(20.0)
    value = np.round(truth + rng.normal(0.0, deviation, len(TIME)), 2)
    denoised = denoise(TIME, value)
    for is_held in (TIME < 1.9, (TIME > 3.1) & (TIME < 5.9)):
        assert np.ptp(denoised[is_held]) < 0.001
        assert np.abs(denoised - truth)[is_held].mean() < 0.002


def test_slow_ramp_is_no_hold() -> None:
    value = 330.0 + 0.2 * TIME + np.random.default_rng(4).normal(0.0, 0.01, len(TIME))
    assert np.mean(np.diff(denoise(TIME, value)) == 0.0) < 0.05


def test_noise_is_estimated_from_uneven_samples() -> None:
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(0.001, 0.009, 2000))
    value = 330.0 + 6.0 * np.sin(3.0 * time) + rng.normal(0.0, 0.02, len(time))
    assert estimate_white_noise(time, value) == pytest.approx(0.02, rel=0.1)
    assert np.array_equal(denoise(time, value), value)  # irregular, and moving all the time


def test_signal_with_a_few_other_intervals_is_smoothed() -> None:
    rng = np.random.default_rng(6)
    time = np.sort(np.concatenate([TIME, TIME[100::150] + 0.002]))
    truth = 330.0 + 3.0 * np.sin(2.0 * time)
    value = truth + rng.normal(0.0, 0.02, len(time))
    assert np.std(denoise(time, value) - truth) < 0.7 * 0.02


def test_repeats_share_no_error() -> None:
    """Noise averages out over repeats; an error of the window would stay."""
    rng = np.random.default_rng(7)
    truth = 330.0 + 4.0 * np.sin(2.0 * np.pi * 4.0 * TIME)
    errors = np.array([denoise(TIME, truth + rng.normal(0.0, 0.01, len(TIME))) - truth for _ in range(60)])
    shared = np.mean(errors.mean(axis=0) ** 2) - np.mean(errors.var(axis=0, ddof=1)) / len(errors)
    assert shared < (0.1 * 0.01) ** 2
    assert 0.2 * 0.01 < np.sqrt(np.mean(errors.var(axis=0, ddof=1))) < 0.8 * 0.01


def test_noise_free_and_short_signals_are_unchanged() -> None:
    quantized = np.round(make_ramp(30.0), 1)  # a coarsely quantized signal that is mostly constant
    assert np.array_equal(denoise(TIME, quantized), quantized)
    value = make_ramp(30.0) + np.random.default_rng(2).normal(0.0, 0.01, len(TIME))
    short = value[: 2 * WINDOW_SIZES[0] - 1]
    assert denoise(TIME[: len(short)], short) is short
    assert estimate_white_noise(TIME[:3], value[:3]) == 0.0


UPDATES = 2e5 + 1e5 * np.sin(np.linspace(0.0, 20.0, 120))


@pytest.mark.parametrize("n_samples", [2, 3, 4, 10])
def test_steps_of_a_digital_command_are_no_noise(n_samples: int) -> None:
    command = TimeSeries(0.005 * np.arange(120.0 * n_samples), UPDATES.repeat(n_samples))
    np.testing.assert_array_equal(denoise_command(command), command.value)
    uneven = UPDATES.repeat(np.resize([1, 2], 120))  # 1.5 samples per update
    uneven_command = TimeSeries(0.005 * np.arange(float(len(uneven))), uneven)
    np.testing.assert_array_equal(denoise_command(uneven_command), uneven)


def test_noise_in_the_resolution_of_a_log_is_removed() -> None:
    ramp = np.linspace(1e5, 3e5, 1200)
    noisy = np.round(ramp + np.random.default_rng(1).normal(0.0, 700.0, 1200), -3)
    assert np.mean(np.diff(noisy) == 0.0) > 0.25
    command = TimeSeries(0.005 * np.arange(1200.0), noisy)
    assert np.std(denoise_command(command) - ramp) < 0.75 * np.std(noisy - ramp)
