"""Jacobians that the steps of a search correct, where the residuals are nearly linear (Broyden 1965).

A Jacobian from differences costs one simulation per parameter, a step of a fit only one. Along a step, the residuals
show at no cost how far the Jacobian is off. A secant method of least squares uses this (Madsen, Nielsen and Tingleff,
2004, *Methods for Non-Linear Least Squares Problems*, section 3.5).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from klute_sim.types import Array

MAX_NONLINEARITY = 0.5
"""Error of the predicted change of the residuals in a step, over this change, up to which a Jacobian is corrected in
place of computed (assumed)."""


class Point(NamedTuple):
    """Parameters with their residuals."""

    x: Array
    """Parameters, (parameters,)."""
    residuals: Array
    """Weighted residuals, (residuals,)."""
    jacobian: Array
    """Their derivative, (residuals, parameters), or an approximation."""

    @property
    def chi2(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)


def correct_jacobian(origin: Point, x: Array, residuals: Array) -> Point:
    """Return the point ``x``, its Jacobian corrected by the change of the residuals from ``origin`` (Broyden 1965)."""
    step = x - origin.x
    norm = float(step @ step)
    if norm == 0.0 or not np.isfinite(residuals).all():
        return Point(x, residuals, origin.jacobian)
    error = residuals - origin.residuals - origin.jacobian @ step
    return Point(x, residuals, origin.jacobian + np.outer(error, step) / norm)


def measure_nonlinearity(origin: Point, x: Array, residuals: Array) -> float:
    """Return the error of the change of the residuals from ``origin`` to ``x`` that its Jacobian predicts, over it.

    It is 0 for linear residuals, and infinite where the residuals do not change.
    """
    change = residuals - origin.residuals
    size = float(np.linalg.norm(change))
    return float(np.linalg.norm(change - origin.jacobian @ (x - origin.x))) / size if size > 0.0 else np.inf


class SecantJacobian:
    """Jacobian of a search as a function of the parameters; successive calls follow its accepted steps."""

    def __init__(
        self,
        evaluate: Callable[[Array], Array],
        differentiate: Callable[[Array], Array],
        initial: Array | None = None,
    ) -> None:
        """Start with the Jacobian ``initial``, which may be an approximation; None: with a computed one.

        ``evaluate`` returns the residuals and ``differentiate`` computes their Jacobian. It is computed after each step
        with more than :data:`MAX_NONLINEARITY` (:func:`measure_nonlinearity`).
        """
        self._evaluate, self._differentiate, self._initial = evaluate, differentiate, initial
        self._last: Point | None = None

    def __call__(self, x: Array) -> Array:
        """Return the Jacobian at ``x``."""
        residuals = self._evaluate(x)
        if self._last is None and self._initial is not None:
            self._last = Point(x, residuals, self._initial)
        elif self._last is not None and measure_nonlinearity(self._last, x, residuals) <= MAX_NONLINEARITY:
            self._last = correct_jacobian(self._last, x, residuals)
        else:
            self._last = Point(x, residuals, self._differentiate(x))
        return self._last.jacobian
