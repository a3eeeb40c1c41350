"""Moving averages and Savitzky-Golay filters that the noise of repeats shows, and no others."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.signal import filtfilt, lfilter, medfilt, savgol_filter

from klute_sim.diagnosis.experiments.channel_filter import Filters
from klute_sim.diagnosis.experiments.low_pass import LowPassFilter
from klute_sim.diagnosis.experiments.window_filter import WindowFilter
from klute_sim.diagnosis.noise.filtered_noise import detect_filters
from tests.diagnosis.filtered_signals import MOTION, RATE_HZ, TIME, amplify, average, filter_twice, make_noise


def detect(apply: Callable[[np.ndarray], np.ndarray], seed: int = 0, n_pairs: int = 2, kept: int = 1) -> list[Filters]:
    """Return the filters that pairs of repeats show, of whose samples every ``kept``-th one is left."""
    forces = [apply(MOTION + make_noise(100 * seed + k)) for k in range(2 * n_pairs)]
    pairs = zip(forces[::2], forces[1::2], strict=True)
    differences = [(TIME[::kept], (one - other)[::kept]) for one, other in pairs]
    return detect_filters({"force": differences}, {"force": RATE_HZ})


@settings(max_examples=4, deadline=None)
@given(st.integers(4, 90), st.integers(0, 100))
def test_noise_shows_the_moving_average(n_samples: int, seed: int) -> None:
    centred, trailing, none = detect(lambda values: average(values, n_samples), seed)
    assert centred == {"force": WindowFilter(n_samples, RATE_HZ)}
    assert trailing == {"force": WindowFilter(n_samples, RATE_HZ, is_trailing=True)}
    assert none == {}


@pytest.mark.parametrize(
    ("n_samples", "degree"),
    [(11, 2), pytest.param(51, 2, marks=pytest.mark.slow), (51, 4), pytest.param(101, 2, marks=pytest.mark.slow)],
)
def test_noise_shows_the_savitzky_golay_filter(n_samples: int, degree: int) -> None:
    found = detect(lambda values: savgol_filter(values, n_samples, degree + 1))
    assert found[0] == {"force": WindowFilter(n_samples, RATE_HZ, degree)}


@pytest.mark.parametrize("n_samples", [8, 25])
def test_noise_shows_a_moving_average_forward_and_backward(n_samples: int) -> None:
    found = detect(lambda values: filtfilt(np.full(n_samples, 1.0 / n_samples), 1.0, values))
    assert found[0] == {"force": WindowFilter(n_samples, RATE_HZ, n_passes=2)}


@pytest.mark.parametrize("kept", [2, 5])
def test_window_is_found_where_samples_were_left_out(kept: int) -> None:
    found = detect(lambda values: average(values, 25), kept=kept)
    assert found[0] == {"force": WindowFilter(25, RATE_HZ)}


def test_window_behind_a_sensor_with_a_lag_and_before_a_rounded_log() -> None:
    found = detect(lambda values: np.round(average(lfilter([0.5], [1.0, -0.5], values), 25), 3))
    assert found[0] == {"force": WindowFilter(25, RATE_HZ)}


def quantize(values: np.ndarray) -> np.ndarray:
    return np.round(values / 20.0) * 20.0


@pytest.mark.parametrize(
    "apply",
    [
        pytest.param(lambda values: values, id="white"),
        pytest.param(lambda values: lfilter([0.05], [1.0, -0.95], values), id="lag", marks=pytest.mark.slow),
        pytest.param(lambda values: np.cumsum(values - MOTION), id="drift", marks=pytest.mark.slow),
        pytest.param(quantize, id="coarse", marks=pytest.mark.slow),
        pytest.param(lambda values: medfilt(values, 11), id="median", marks=pytest.mark.slow),
        pytest.param(lambda values: filter_twice(values, 10.0, 2), id="zero-lag", marks=pytest.mark.slow),
        pytest.param(lambda values: amplify(values, 30.0, 4), id="amplifier", marks=pytest.mark.slow),
        pytest.param(lambda values: np.round(filter_twice(values, 10.0, 2), 2), id="zero-lag, rounded"),
        pytest.param(lambda values: CubicSpline(TIME[::10], values[::10])(TIME), id="spline", marks=pytest.mark.slow),
    ],
)
def test_no_other_noise_shows_a_window(apply: Callable[[np.ndarray], np.ndarray]) -> None:
    found = detect(apply)
    assert not any(isinstance(each, WindowFilter) for filters in found for each in filters.values())


def test_other_channels_keep_their_filters() -> None:
    forces = [average(make_noise(k), 25) for k in range(2)]
    pressures = [filter_twice(make_noise(k), 10.0, 2) for k in range(2, 4)]
    pairs = {"force": forces, "pressure": pressures, "muscle_length": [make_noise(k) for k in range(4, 6)]}
    differences = {name: [(TIME, one - other)] for name, (one, other) in pairs.items()}
    first, *others = detect_filters(differences, dict.fromkeys(pairs, RATE_HZ))
    assert first.keys() == {"force", "pressure"}
    assert first["force"] == WindowFilter(25, RATE_HZ)
    assert isinstance(first["pressure"], LowPassFilter)
    assert any(filters.keys() == {"pressure"} for filters in others)
