"""Moving averages and Savitzky-Golay filters do to a simulated channel what data processing does to a measured one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import filtfilt, savgol_filter

from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.experiments.window_filter import WindowFilter
from tests.diagnosis.filtered_signals import RATE_HZ, REVERSALS, TIME, average

INNER = slice(200, -200)


@pytest.mark.parametrize("n_samples", [5, 25, 101])
@pytest.mark.parametrize("is_trailing", [False, True])
def test_agrees_with_a_moving_average(n_samples: int, is_trailing: bool) -> None:
    found = WindowFilter(n_samples, RATE_HZ, is_trailing=is_trailing).apply(TIME, REVERSALS)
    expected = average(REVERSALS, n_samples, is_trailing=is_trailing)
    assert found[INNER] == pytest.approx(expected[INNER], abs=1e-9)


def test_agrees_with_a_moving_average_forward_and_backward() -> None:
    found = WindowFilter(25, RATE_HZ, n_passes=2).apply(TIME, REVERSALS)
    expected = filtfilt(np.full(25, 1.0 / 25.0), 1.0, REVERSALS)
    assert found[INNER] == pytest.approx(expected[INNER], abs=1e-6)
    assert WindowFilter(25, RATE_HZ, n_passes=2, is_trailing=True).delay == pytest.approx(24.0 / RATE_HZ)


@pytest.mark.parametrize(("n_samples", "degree"), [(11, 2), (51, 2), (51, 4)])
def test_agrees_with_a_savitzky_golay_filter(n_samples: int, degree: int) -> None:
    found = WindowFilter(n_samples, RATE_HZ, degree).apply(TIME, REVERSALS)
    for each in (degree, degree + 1):
        assert found[INNER] == pytest.approx(savgol_filter(REVERSALS, n_samples, each)[INNER], abs=1e-6)


def test_finer_simulation_agrees_at_the_samples_of_the_log() -> None:
    """A simulation has more time steps than the log has samples; only those at the samples are averaged."""
    fine_time = np.arange(0.0, 6.0, 1e-3)
    signal = 900.0 + 300.0 * np.sin(4.0 * fine_time)
    fine = WindowFilter(25, 100.0).apply(fine_time, signal)[::10]
    assert fine[50:-50] == pytest.approx(average(signal[::10], 25)[50:-50], abs=1e-3)


@settings(max_examples=20)
@given(st.floats(-1e3, 1e3), st.integers(2, 101), st.sampled_from([0, 2]), st.booleans())
def test_lines_are_late_by_the_delay(slope: float, n_samples: int, degree: int, is_trailing: bool) -> None:
    n_samples = n_samples if degree == 0 else 2 * n_samples + 1
    window = WindowFilter(n_samples, RATE_HZ, degree, is_trailing=is_trailing)
    np.testing.assert_allclose(window.apply(TIME, slope * TIME), slope * (TIME - window.delay), rtol=1e-9, atol=1e-8)
    assert window.lateness == window.delay
    assert window.has_delay == (window.is_trailing and window.n_samples > 1)
    assert window.align().delay == 0.0
    assert window.compute_gain(TIME) == pytest.approx(window.align().compute_gain(TIME))


@pytest.mark.parametrize(
    ("window", "cutoff_hz", "delay_s"),
    [
        (WindowFilter(25, 500.0), 8.86, 0.0),  # 0.443 / 50 ms
        (WindowFilter(25, 500.0, is_trailing=True), 8.86, 0.024),
        (WindowFilter(51, 500.0, 2), 10.6, 0.0),
    ],
)
def test_cutoff_and_delay(window: WindowFilter, cutoff_hz: float, delay_s: float) -> None:
    assert window.cutoff == pytest.approx(cutoff_hz, rel=0.06)
    assert window.compute_gain(np.array([0.0, window.cutoff])) == pytest.approx([1.0, np.sqrt(0.5)], abs=0.02)
    assert window.delay == pytest.approx(delay_s)
    assert window.scale_cutoff(1.1) is window


def test_removed_frequencies_and_those_of_the_sampling_rate() -> None:
    gain = WindowFilter(25, 500.0).compute_gain(np.array([0.0, 20.0, 40.0, 500.0, 520.0]))
    assert gain == pytest.approx([1.0, 0.0, 0.0, 1.0, 0.0], abs=1e-9)


def test_ends_are_left_out() -> None:
    series = WindowFilter(25, 500.0).trim_ends(TimeSeries(TIME, REVERSALS))
    assert (series.time[0], series.time[-1]) == pytest.approx((0.05, TIME[-1] - 0.05), abs=2e-3)
