"""Low-pass filters: their gain, and their detection from the noise of repeats."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, lfilter, sosfilt, sosfiltfilt

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.device.device import load_device
from klute_sim.diagnosis.experiments.low_pass import LowPassFilter, describe_low_pass_filters, detect_low_pass_filters

RATE_HZ, DURATION_S = 500.0, 15.0
TIME = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
MOTION = 900.0 + 300.0 * np.sin(2.0 * np.pi * 0.7 * TIME)
REVERSALS = MOTION + 40.0 * np.sign(np.cos(2.0 * np.pi * 0.7 * TIME))


def make_repeats(*forces: np.ndarray, group: str = "g") -> list[Trial]:
    inputs = {"length": TimeSeries(TIME, MOTION * 1e-3), "pressure_command": TimeSeries(TIME, MOTION)}
    return [
        Trial(
            name=f"{group}_{k}",
            group=group,
            use="fit",
            device=load_device("klute-3-4-pair"),
            files=(Path("t.csv"),),
            prescribed=inputs,
            measured={"force": TimeSeries(TIME, force)},
        )
        for k, force in enumerate(forces)
    ]


def filter_twice(values: np.ndarray, cutoff: float, order: int) -> np.ndarray:
    return sosfiltfilt(butter(order, cutoff, fs=RATE_HZ, output="sos"), values)


def make_noise(seed: int, deviation: float = 4.0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, deviation, len(TIME))


@pytest.mark.parametrize("order", [1, 2, 4])
def test_gain_is_a_half_at_the_cutoff(order: int) -> None:
    gain = LowPassFilter(1.0, order, RATE_HZ).compute_gain(np.array([0.0, 1.0, 10.0, 300.0]))
    assert gain == pytest.approx([1.0, 0.5, 10.0 ** (-2 * order), 0.0], rel=0.02)


@pytest.mark.parametrize("order", [2, 4])
def test_agrees_with_a_filter_in_both_directions(order: int) -> None:
    inner = slice(200, -200)
    expected = filter_twice(REVERSALS, 10.0, order)
    filtered = LowPassFilter(10.0, order, RATE_HZ).apply(TIME, REVERSALS)
    assert filtered[inner] == pytest.approx(expected[inner], abs=0.2)  # of jumps of 80


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(1.0, 100.0), st.integers(1, 4))
def test_lines_pass_unchanged(offset: float, slope: float, cutoff: float, order: int) -> None:
    line = offset + slope * TIME
    assert LowPassFilter(cutoff, order, RATE_HZ).apply(TIME, line) == pytest.approx(line, rel=1e-9, abs=1e-8)


@given(st.floats(2.0, 100.0), st.integers(1, 4))
def test_filter_is_linear_and_has_no_delay(cutoff: float, order: int) -> None:
    apply = LowPassFilter(cutoff, order, RATE_HZ).apply
    noise = make_noise(0)
    assert apply(TIME, 2.0 * noise + MOTION) == pytest.approx(2.0 * apply(TIME, noise) + apply(TIME, MOTION), abs=1e-6)
    reversed_filtered = apply(TIME, noise[::-1])[::-1]
    assert apply(TIME, noise)[1000:-1000] == pytest.approx(reversed_filtered[1000:-1000], abs=1e-6)


@settings(max_examples=8, deadline=None)
@given(st.floats(6.0, 60.0), st.integers(2, 4), st.integers(0, 1000))
def test_noise_shows_the_filter(cutoff: float, order: int, seed: int) -> None:
    forces = [filter_twice(REVERSALS + make_noise(2 * seed + k), cutoff, order) for k in range(2)]
    found = detect_low_pass_filters(make_repeats(*forces))["force"]
    assert found.cutoff == pytest.approx(cutoff, rel=0.1)
    assert describe_low_pass_filters({"force": found})


def test_last_digits_behind_the_filter_change_nothing() -> None:
    forces = [np.round(filter_twice(REVERSALS + make_noise(k), 10.0, 4), 2) for k in range(2)]
    assert detect_low_pass_filters(make_repeats(*forces))["force"].cutoff == pytest.approx(10.0, rel=0.05)


def test_filter_of_an_amplifier_is_found_as_well() -> None:
    sections = butter(4, 10.0, fs=RATE_HZ, output="sos")
    forces = [sosfilt(sections, REVERSALS + make_noise(k)) for k in range(2)]
    assert 9.0 < detect_low_pass_filters(make_repeats(*forces))["force"].cutoff < 14.0  # the amplitude is 0.71 at 10 Hz


def test_repeats_of_other_groups_are_not_compared() -> None:
    forces = [filter_twice(REVERSALS + make_noise(k), 10.0, 4) for k in range(2)]
    trials = [*make_repeats(forces[0], group="a"), *make_repeats(forces[1], group="b")]
    assert detect_low_pass_filters(trials) == {}


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
def test_other_noise_shows_no_filter(change) -> None:
    assert detect_low_pass_filters(make_repeats(*(change(REVERSALS + make_noise(k)) for k in range(2)))) == {}


def test_ends_are_left_out() -> None:
    series = LowPassFilter(10.0, 2, RATE_HZ).trim_ends(TimeSeries(TIME, MOTION))
    assert (series.time[0], series.time[-1]) == pytest.approx((0.2, DURATION_S - 0.2), abs=2.0 / RATE_HZ)
