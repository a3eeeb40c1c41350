"""Screening where a number of the device is at its bound: it cannot imitate an effect by going further."""

import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.selection.screening import _fix_blocked_parameters

NUMBERS = (("damper.orifice_concentric_mm", 0.03), ("damper.orifice_eccentric_mm", 0.03))


def make_fit(x: list[float], residuals: list[float]) -> Fit:
    """Return a fit of two numbers, of which each changes one reading and its own prior."""
    hypothesis = Hypothesis(load_device("klute-3-4-pair"), NUMBERS, (("force", 3.0),), ())
    jacobian = np.concatenate([np.diag([5.0, -5.0]), np.eye(2)])
    return Fit(hypothesis, np.array(x), np.array([*residuals, *x]), jacobian, True, [])


@pytest.mark.parametrize(
    ("x", "residuals", "blocked"),
    [
        pytest.param([0.5, -0.5], [10.0, 10.0], [], id="no bound is reached"),
        pytest.param([-3.0, 0.0], [10.0, 0.0], [0], id="chi squared falls below the lower bound"),
        pytest.param([-3.0, 0.0], [-10.0, 0.0], [], id="chi squared rises below the lower bound"),
        pytest.param([0.0, 3.0], [0.0, 10.0], [1], id="chi squared falls above the upper bound"),
        pytest.param([0.0, 3.0], [0.0, -10.0], [], id="chi squared rises above the upper bound"),
        pytest.param([-3.0, 3.0], [10.0, 10.0], [0, 1], id="both"),
    ],
)
def test_parameter_is_blocked_where_chi_squared_falls_beyond_its_bound(
    x: list[float], residuals: list[float], blocked: list[int]
) -> None:
    fit = make_fit(x, residuals)
    before = fit.jacobian.copy()
    jacobian = _fix_blocked_parameters(fit)
    assert [k for k in range(2) if not jacobian[:, k].any()] == blocked
    free = [k for k in range(2) if k not in blocked]
    np.testing.assert_array_equal(jacobian[:, free], before[:, free])
    np.testing.assert_array_equal(fit.jacobian, before)  # that of the fit is left as it is
