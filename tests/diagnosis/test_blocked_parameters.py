"""Screening where a number of the device is at its bound: it cannot imitate an effect by going further."""

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.selection.screening import _LinearizationPoint, find_blocked_directions

NUMBERS = (("damper.orifice_concentric_mm", 0.03), ("damper.orifice_eccentric_mm", 0.03))


def make_fit(x: list[float], residuals: list[float]) -> Fit:
    """Return a fit of two numbers, of which each changes one reading and its own prior."""
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), NUMBERS, (("force", 3.0),), ())
    jacobian = np.concatenate([np.diag([5.0, -5.0]), np.eye(2)])
    return Fit(hypothesis, np.array(x), np.array([*residuals, *x]), jacobian, True, [])


@pytest.mark.parametrize(
    ("x", "residuals", "blocked"),
    [
        pytest.param([0.5, -0.5], [10.0, 10.0], [0, 0], id="no bound is reached"),
        pytest.param([-3.0, 0.0], [10.0, 0.0], [-1, 0], id="chi squared falls below the lower bound"),
        pytest.param([-3.0, 0.0], [-10.0, 0.0], [0, 0], id="chi squared rises below the lower bound"),
        pytest.param([0.0, 3.0], [0.0, 10.0], [0, 1], id="chi squared falls above the upper bound"),
        pytest.param([0.0, 3.0], [0.0, -10.0], [0, 0], id="chi squared rises above the upper bound"),
        pytest.param([-3.0, 3.0], [10.0, 10.0], [-1, 1], id="both"),
    ],
)
def test_parameter_is_blocked_where_chi_squared_falls_beyond_its_bound(
    x: list[float], residuals: list[float], blocked: list[int]
) -> None:
    assert find_blocked_directions(make_fit(x, residuals)).tolist() == blocked


def make_point(blocked: float) -> _LinearizationPoint:
    """Return a point with one parameter that changes the first of three readings, of which two are off."""
    return _LinearizationPoint(
        np.zeros(1), np.array([4.0, 3.0, 0.0]), np.array([[1.0], [0.0], [0.0]]), np.array([blocked])
    )


def test_effect_that_only_a_blocked_parameter_imitates_explains_what_is_left() -> None:
    effect = np.array([2.0, 0.0, 0.0])
    free, blocked = make_point(0.0), make_point(-1.0)
    assert free.remaining_chi2 == pytest.approx(9.0)
    assert free.project(effect, -5.0, 5.0).remaining_chi2 == pytest.approx(9.0)  # nothing that the parameter does not
    assert blocked.remaining_chi2 == pytest.approx(25.0)
    found = blocked.project(effect, -5.0, 5.0)
    assert found.size == pytest.approx(-2.0)
    assert found.remaining_chi2 == pytest.approx(9.0)
    assert found.nuisance_shift.tolist() == [0.0]
    assert blocked.project(effect, -1.0, 5.0).remaining_chi2 == pytest.approx(9.0 + 4.0)  # its size is limited


def test_blocked_parameter_goes_back_where_an_effect_takes_its_place() -> None:
    """The effect explains the second reading and too much of the first, which the parameter corrects."""
    found = make_point(-1.0).project(np.array([-6.0, -3.0, 0.0]), -5.0, 5.0)
    assert found.size == pytest.approx(1.0)
    assert found.nuisance_shift == pytest.approx([2.0])
    assert found.remaining_chi2 == pytest.approx(0.0, abs=1e-12)
