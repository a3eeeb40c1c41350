"""Low-pass filters that the noise of repeats shows."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, lfilter, sosfilt, sosfiltfilt

from klute_sim.diagnosis.experiments.low_pass import LowPassFilter
from klute_sim.diagnosis.noise.filtered_noise import describe_low_pass_filters, find_admitted_filters

RATE_HZ, DURATION_S = 500.0, 15.0
TIME = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
MOTION = 900.0 + 300.0 * np.sin(2.0 * np.pi * 0.7 * TIME)
REVERSALS = MOTION + 40.0 * np.sign(np.cos(2.0 * np.pi * 0.7 * TIME))


def filter_twice(values: np.ndarray, cutoff: float, order: int) -> np.ndarray:
    return sosfiltfilt(butter(order, cutoff, fs=RATE_HZ, output="sos"), values)


def make_noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, 4.0, len(TIME))


def detect(one: np.ndarray, other: np.ndarray) -> list[LowPassFilter]:
    return find_admitted_filters([(TIME, one - other)], RATE_HZ)


@settings(max_examples=8, deadline=None)
@given(st.floats(6.0, 60.0), st.integers(2, 4), st.integers(0, 1000))
def test_noise_shows_the_filter(cutoff: float, order: int, seed: int) -> None:
    forces = [filter_twice(REVERSALS + make_noise(2 * seed + k), cutoff, order) for k in range(2)]
    found = detect(*forces)
    assert 0.95 * found[0].cutoff < cutoff < 1.05 * found[-1].cutoff < 1.2 * cutoff
    assert describe_low_pass_filters({"force": found[0]})


def test_last_digits_behind_the_filter_change_nothing() -> None:
    forces = [np.round(filter_twice(REVERSALS + make_noise(k), 10.0, 4), 2) for k in range(2)]
    found = detect(*forces)
    assert found[0].cutoff < 10.2
    assert found[-1].cutoff > 9.8


def test_filter_of_an_amplifier_is_found_as_well() -> None:
    sections = butter(4, 10.0, fs=RATE_HZ, output="sos")
    forces = [sosfilt(sections, REVERSALS + make_noise(k)) for k in range(2)]
    found = detect(*forces)
    assert 9.0 < found[0].cutoff < found[-1].cutoff < 14.0  # the amplitude is 0.71 at 10 Hz


@pytest.mark.parametrize(
    "change",
    [
        lambda force: force,
        lambda force: filter_twice(force, 0.8 * RATE_HZ / 2.0, 4),
        lambda force: lfilter([0.06], [1.0, -0.94], force),
        lambda force: REVERSALS + np.cumsum(force - REVERSALS) / 20.0,
        lambda force: filter_twice(force, 10.0, 4) + make_noise(int(abs(force[1]))),
        lambda force: np.full(len(TIME), 3.0),
    ],
    ids=["white", "near half the sampling rate", "lag of first order", "random walk", "noise behind", "constant"],
)
def test_other_noise_shows_no_filter(change: Callable[[np.ndarray], np.ndarray]) -> None:
    assert detect(*(change(REVERSALS + make_noise(k)) for k in range(2))) == []


def test_short_records_show_no_filter() -> None:
    forces = [filter_twice(make_noise(k), 60.0, 4)[:100] for k in range(2)]
    assert find_admitted_filters([(TIME[:100], forces[0] - forces[1])], RATE_HZ) == []
    assert find_admitted_filters([], RATE_HZ) == []
