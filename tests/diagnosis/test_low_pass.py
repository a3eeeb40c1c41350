"""The gain of a low-pass filter, and what it leaves unchanged."""

from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.experiments.low_pass import FilterKind, LowPassFilter
from tests.diagnosis.filtered_signals import (
    DURATION_S,
    MOTION,
    RATE_HZ,
    REVERSALS,
    TIME,
    amplify,
    filter_twice,
    make_noise,
)


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


@settings(max_examples=20)
@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(1.0, 100.0), st.integers(1, 4))
def test_lines_pass_unchanged(offset: float, slope: float, cutoff: float, order: int) -> None:
    line = offset + slope * TIME
    np.testing.assert_allclose(LowPassFilter(cutoff, order, RATE_HZ).apply(TIME, line), line, rtol=1e-9, atol=1e-8)


AmplifierKind = Literal["butterworth", "bessel"]
amplifier_kinds = st.sampled_from(["butterworth", "bessel"])


@pytest.mark.parametrize("kind", ["butterworth", "bessel"])
@pytest.mark.parametrize("order", [2, 4, 8])
def test_filter_of_an_amplifier(kind: AmplifierKind, order: int) -> None:
    amplifier = LowPassFilter(10.0, order, RATE_HZ, kind)
    gain = amplifier.compute_gain(np.array([0.0, 10.0, 100.0, 300.0]))
    assert gain[[0, 1, 3]] == pytest.approx([1.0, np.sqrt(0.5), 0.0])
    assert gain[2] < 100.0 * 10.0**-order
    for signal, tolerance in ((MOTION, 1e-3), (REVERSALS, 0.5)):  # of jumps of 80
        expected = amplify(signal, 10.0, order, kind)
        assert amplifier.apply(TIME, signal)[1000:-200] == pytest.approx(expected[1000:-200], abs=tolerance)


@settings(max_examples=20)
@given(st.floats(-1e3, 1e3), st.floats(1.0, 100.0), amplifier_kinds, st.integers(2, 8))
def test_slow_signals_are_late_by_the_delay(slope: float, cutoff: float, kind: AmplifierKind, order: int) -> None:
    amplifier = LowPassFilter(cutoff, order, RATE_HZ, kind)
    late = amplifier.apply(TIME, slope * TIME)
    np.testing.assert_allclose(late, slope * (TIME - amplifier.delay), rtol=1e-9, atol=1e-8)
    aligned = LowPassFilter(cutoff, order, RATE_HZ, kind, is_aligned=True)
    np.testing.assert_allclose(aligned.apply(TIME, slope * TIME), slope * TIME, rtol=1e-9, atol=1e-8)
    assert aligned.compute_gain(TIME) == pytest.approx(amplifier.compute_gain(TIME))


@pytest.mark.parametrize(
    ("kind", "order", "delay_s"), [("zero-lag", 4, 0.0), ("butterworth", 2, 0.02251), ("butterworth", 4, 0.04159)]
)
def test_delay_of_a_filter_of_10_hz(kind: FilterKind, order: int, delay_s: float) -> None:
    # The low-frequency delay of a Butterworth filter is 1.414 and 2.613 over 2 pi f_c for the orders 2 and 4.
    assert LowPassFilter(10.0, order, np.inf, kind).delay == pytest.approx(delay_s, abs=1e-5)
    assert LowPassFilter(10.0, order, 1e4, kind).delay == pytest.approx(delay_s, abs=1e-5)


@pytest.mark.parametrize(("kind", "order"), [("zero-lag", 2), ("butterworth", 4), ("bessel", 6)])
def test_digital_filter_of_a_high_rate_is_that_of_an_analog_one(kind: FilterKind, order: int) -> None:
    frequency = np.linspace(0.0, 50.0, 101)
    analog, digital = (LowPassFilter(10.0, order, rate, kind) for rate in (np.inf, 1e5))
    np.testing.assert_allclose(digital.compute_response(frequency), analog.compute_response(frequency), atol=1e-5)


@settings(max_examples=20)
@given(st.floats(2.0, 100.0), st.integers(1, 4))
def test_filter_is_linear_and_has_no_delay(cutoff: float, order: int) -> None:
    apply = LowPassFilter(cutoff, order, RATE_HZ).apply
    noise = make_noise(0)
    filtered = apply(TIME, noise)
    np.testing.assert_allclose(apply(TIME, 2.0 * noise + MOTION), 2.0 * filtered + apply(TIME, MOTION), atol=1e-6)
    np.testing.assert_allclose(apply(TIME, noise[::-1])[::-1][1000:-1000], filtered[1000:-1000], atol=1e-6)


def test_ends_are_left_out() -> None:
    series = LowPassFilter(10.0, 2, RATE_HZ).trim_ends(TimeSeries(TIME, MOTION))
    assert (series.time[0], series.time[-1]) == pytest.approx((0.2, DURATION_S - 0.2), abs=2.0 / RATE_HZ)


def test_alignment_removes_the_delay_only() -> None:
    amplifier, zero_lag = LowPassFilter(10.0, 4, RATE_HZ, "butterworth"), LowPassFilter(10.0, 4, RATE_HZ)
    assert amplifier.align().lateness == 0.0 < amplifier.lateness
    assert amplifier.align().delay == amplifier.delay
    assert zero_lag.align() == zero_lag
