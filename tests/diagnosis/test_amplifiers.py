"""Amplifiers of second order: their lag is one fault of the instrument, not a lag and another clock."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import bessel, butter, lfilter, lfilter_zi

from klute_sim.datasets.dataset import load_dataset
from klute_sim.diagnosis.selection.naming import compute_delay
from klute_sim.diagnosis.workflow import diagnose
from klute_sim.types import Array
from tests.diagnosis.synthetic_dataset import write_dataset

pytestmark = pytest.mark.slow

FINE_RATE_HZ = 20e3
"""Rate at which the filters of this test are computed [Hz], far above those of the signals."""


def filter_finely(time: Array, value: Array, coefficients: tuple[Array, Array]) -> Array:
    """Return ``value`` behind a filter that was designed for :data:`FINE_RATE_HZ`."""
    fine_time = np.arange(time[0], time[-1] + 0.5 / FINE_RATE_HZ, 1.0 / FINE_RATE_HZ)
    fine = CubicSpline(time, value)(fine_time)
    filtered, _ = lfilter(*coefficients, fine, zi=lfilter_zi(*coefficients) * fine[0])
    return np.interp(time, fine_time, filtered)


def make_equal_lags(time_constant: float) -> tuple[Array, Array]:
    """Return the coefficients of two equal lags in series (backward Euler)."""
    steps = 1.0 / (FINE_RATE_HZ * time_constant)
    lag = np.array([1.0 + steps, -1.0])
    return np.array([steps**2]), np.convolve(lag, lag)


@pytest.mark.parametrize(
    ("coefficients", "delay", "damping_ratio"),
    [
        pytest.param(make_equal_lags(8e-3), 16e-3, 1.0, id="two equal lags"),
        pytest.param(butter(2, 15.0, fs=FINE_RATE_HZ), np.sqrt(2.0) / (2.0 * np.pi * 15.0), 0.707, id="Butterworth"),
        pytest.param(bessel(2, 15.0, norm="delay", fs=FINE_RATE_HZ), 1.0 / (2.0 * np.pi * 15.0), 0.866, id="Bessel"),
    ],
)
def test_amplifier_of_second_order_is_named(
    coefficients: tuple[Array, Array], delay: float, damping_ratio: float, tmp_path: Path
) -> None:
    distort = {"force": lambda time, force: filter_finely(time, force, coefficients)}
    result = diagnose(load_dataset(write_dataset(tmp_path / "data", distort=distort)))
    (term,) = result.added_terms
    assert (term.qualified_name, term.form) == ("sensor_lag@force", "second_order"), result.reasons
    assert result.verdict == "identified"
    fit = result.final_fit
    assert fit is not None
    assert compute_delay(fit, term) == pytest.approx(delay, rel=0.05)
    values = {p.name: v for p, v in zip(fit.hypothesis.parameters, fit.values, strict=True)}
    assert values["damping_ratio"] == pytest.approx(damping_ratio, rel=0.15)
