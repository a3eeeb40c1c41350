"""Corrected Jacobians: exact for linear residuals, computed again along curved ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from klute_sim.diagnosis.fitting.secant import (
    MAX_NONLINEARITY,
    Point,
    SecantJacobian,
    correct_jacobian,
    measure_nonlinearity,
)
from klute_sim.types import Array

MATRIX = np.array([[1.0, 2.0], [0.0, 1.0], [3.0, -1.0]])


class Residuals:
    """Residuals of a model, with the number of computed Jacobians."""

    def __init__(self, curvature: float) -> None:
        self.curvature, self.n_jacobians = curvature, 0

    def evaluate(self, x: Array) -> Array:
        vector: Array = MATRIX @ (x - 1.0) + self.curvature * np.array([x[0] ** 2, x[0] * x[1], 0.0])
        return vector

    def differentiate(self, x: Array) -> Array:
        self.n_jacobians += 1
        curved: Array = MATRIX + self.curvature * np.array([[2.0 * x[0], 0.0], [x[1], x[0]], [0.0, 0.0]])
        return curved


@given(st.lists(st.floats(-10.0, 10.0), min_size=8, max_size=8))
def test_corrected_jacobian_predicts_the_step_that_corrected_it(values: list[float]) -> None:
    x, jacobian = np.array(values[:2]), np.array(values[2:]).reshape(3, 2)
    origin = Point(np.zeros(2), MATRIX @ -np.ones(2), jacobian)
    residuals = MATRIX @ (x - 1.0)
    corrected = correct_jacobian(origin, x, residuals)
    assert np.allclose(corrected.jacobian @ x, residuals - origin.residuals, atol=1e-9)
    across = np.array([-x[1], x[0]])  # a step says nothing of the directions across it
    assert np.allclose(corrected.jacobian @ across, jacobian @ across, atol=1e-9)


def test_step_of_no_length_or_to_infinite_residuals_corrects_nothing() -> None:
    origin = Point(np.zeros(2), np.zeros(3), MATRIX)
    assert correct_jacobian(origin, np.zeros(2), np.ones(3)).jacobian is MATRIX
    assert correct_jacobian(origin, np.ones(2), np.full(3, np.inf)).jacobian is MATRIX


def test_nonlinearity_is_the_share_of_the_change_that_is_not_predicted() -> None:
    origin, x = Point(np.zeros(2), np.zeros(3), MATRIX), np.array([1.0, 1.0])
    assert measure_nonlinearity(origin, x, MATRIX @ x) == pytest.approx(0.0)
    assert measure_nonlinearity(origin, x, 2.0 * (MATRIX @ x)) == pytest.approx(0.5)
    assert measure_nonlinearity(origin, x, np.zeros(3)) == np.inf


def test_linear_residuals_need_one_jacobian() -> None:
    model = Residuals(0.0)
    jacobian = SecantJacobian(model.evaluate, model.differentiate)
    result = least_squares(model.evaluate, np.array([5.0, -3.0]), jacobian)
    assert result.x == pytest.approx(1.0)
    assert model.n_jacobians == 1


def test_an_approximate_start_is_corrected() -> None:
    model = Residuals(0.0)
    jacobian = SecantJacobian(model.evaluate, model.differentiate, 1.1 * MATRIX)
    result = least_squares(model.evaluate, np.array([5.0, -3.0]), jacobian)
    assert result.x == pytest.approx(1.0, abs=1e-6)
    assert model.n_jacobians == 0


@pytest.mark.parametrize("curvature", [0.05, 0.5])
def test_search_on_curved_residuals_ends_near_that_with_computed_jacobians(curvature: float) -> None:
    model, start = Residuals(curvature), np.array([4.0, -3.0])
    expected = least_squares(model.evaluate, start, model.differentiate)
    n_computed, model.n_jacobians = model.n_jacobians, 0
    result = least_squares(model.evaluate, start, SecantJacobian(model.evaluate, model.differentiate))
    assert result.cost == pytest.approx(expected.cost, rel=0.02, abs=1e-3)
    assert model.n_jacobians < n_computed


def test_strongly_curved_step_computes_the_jacobian() -> None:
    model = Residuals(0.5)
    jacobian = SecantJacobian(model.evaluate, model.differentiate)
    jacobian(np.zeros(2))
    far = np.array([8.0, 4.0])
    origin = Point(np.zeros(2), model.evaluate(np.zeros(2)), model.differentiate(np.zeros(2)))
    assert measure_nonlinearity(origin, far, model.evaluate(far)) > MAX_NONLINEARITY
    assert np.array_equal(jacobian(far), model.differentiate(far))
