"""Motions whose instrument shows few steps become smooth; others stay as they are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.datasets.trial import Trial
from klute_sim.diagnosis.experiments.quantized_inputs import (
    describe_quantized_inputs,
    find_smoothest_curve,
    smooth_quantized_inputs,
)
from tests.diagnosis.synthetic_trial import make_trial as make_trial_at

TIME = np.arange(0.0, 15.0, 2e-3)
MOTION = 0.35 + 0.006 * np.sin(2.0 * np.pi * 0.6 * TIME) + 0.004 * np.sin(2.0 * np.pi * 1.1 * TIME + 1.0)
RAMPS = 0.35 + 0.01 * np.abs((TIME / 5.0) % 2.0 - 1.0)


def make_trial(length: np.ndarray, time: np.ndarray = TIME) -> Trial:
    command = np.round(2e5 + 1e5 * np.sin(time), -4)
    return make_trial_at(time, length, command, force=np.round(900.0 + 300.0 * np.sin(time)))


def smooth(length: np.ndarray, time: np.ndarray = TIME) -> np.ndarray:
    return smooth_quantized_inputs(make_trial(length, time)).prescribed["length"].value


def quantize(length: np.ndarray, step: float) -> np.ndarray:
    return step * np.round(length / step)


@pytest.mark.parametrize("motion", [MOTION, RAMPS], ids=["sines", "ramps"])
@pytest.mark.parametrize("step", [2e-5, 5e-5, 2e-4])
@pytest.mark.parametrize("noise_steps", [0.0, 0.2])
def test_error_is_a_fraction_of_that_of_rounding(motion: np.ndarray, step: float, noise_steps: float) -> None:
    noise = noise_steps * step * np.random.default_rng(0).normal(size=len(TIME))
    rounded = quantize(motion + noise, step)
    assert np.std(smooth(rounded) - motion) < 0.6 * np.std(rounded - motion)
    (sentence,) = describe_quantized_inputs([make_trial(rounded)])
    assert "'length'" in sentence


def test_friction_does_not_reverse_at_steps() -> None:
    """A muscle with dry friction would stick and slip at every step."""
    smooth_motion = smooth(quantize(MOTION, 1e-4))
    reversals = [np.count_nonzero(np.diff(np.sign(np.diff(motion)))) for motion in (MOTION, smooth_motion)]
    assert reversals[0] == reversals[1]


@settings(max_examples=20, deadline=None)
@given(st.floats(1e-6, 1e-3), st.floats(0.1, 2.0), st.integers(10, 2000))
def test_curve_stays_near_the_samples(half_width: float, rate: float, n: int) -> None:
    values = quantize(0.01 * np.sin(rate * TIME[:n]), 2.0 * half_width)
    curve = find_smoothest_curve(values, half_width, 1e5)
    assert curve is None or np.abs(curve - values).max() <= 1.06 * half_width


def test_parabola_stays() -> None:
    values = 1e-3 * TIME**2
    assert find_smoothest_curve(values, 1e-6, 1e5) == pytest.approx(values, abs=1e-8)


def test_rest_stays() -> None:
    length = quantize(np.where(TIME < 5.0, MOTION, MOTION[2500]), 1e-4)
    assert np.ptp(smooth(length)[3000:]) < 1e-6


@pytest.mark.parametrize(
    "length",
    [
        MOTION,
        MOTION + np.random.default_rng(0).normal(0.0, 1e-5, len(TIME)),
        quantize(MOTION, 1e-6),
        quantize(MOTION + np.random.default_rng(0).normal(0.0, 2e-4, len(TIME)), 1e-4),
        np.full(len(TIME), 0.35),
        np.where(TIME % 2.0 < 1.0, 0.35, 0.34),
        np.where(TIME < 1.0, np.nan, quantize(MOTION, 1e-4)),
        quantize(0.35 + 0.01 * np.abs((5.0 * TIME) % 2.0 - 1.0), 5e-5),
        quantize(np.where(TIME < 1.0, 0.36, 0.35 + 0.01 * np.abs(TIME % 2.0)), 1e-6),
        quantize(0.35 + 0.009 * np.abs((TIME / 2.0) % 2.0 - 1.0), 1e-6),
    ],
    ids=[
        "exact",
        "noise",
        "fine steps",
        "steps within noise",
        "constant",
        "two lengths",
        "missing samples",
        "quick reversals",
        "saw teeth of one speed",
        "ramps of one speed",
    ],
)
def test_other_motions_stay(length: np.ndarray) -> None:
    np.testing.assert_array_equal(smooth(length), length)
    assert describe_quantized_inputs([make_trial(length)]) == []


def test_commands_readings_and_uneven_samples_stay() -> None:
    rounded = quantize(MOTION, 1e-4)
    before = make_trial(rounded)
    after = smooth_quantized_inputs(before)
    assert after.measured is before.measured
    assert after.prescribed["pressure_command"] is before.prescribed["pressure_command"]
    uneven = TIME + 4e-4 * np.sin(np.arange(len(TIME)))
    np.testing.assert_array_equal(smooth(rounded, uneven), rounded)
