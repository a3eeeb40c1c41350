"""Profile likelihood: how far a parameter may move before chi squared, refitted in all others, exceeds a threshold.

An interval from the Jacobian of a fit assumes that residuals are linear in the parameters. If two parameters compensate
each other along a curve, or if an effect saturates or has a threshold, it is too short or too long. The profile of chi
squared over one parameter needs no such assumption (Venzon & Moolgavkar 1988, J. R. Stat. Soc. C 37, 87-94; Raue et al.
2009, Bioinformatics 25, 1923-1929).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from klute_sim.diagnosis.fitting.secant import Point, correct_jacobian
from klute_sim.types import Array

LINEARITY_TOLERANCE = 0.05
"""Relative difference of the limits of profile and Jacobian below which the latter holds (assumed)."""
REFIT_TOLERANCE = 0.1
"""Largest predicted decrease of chi squared by another step of a refit, over the threshold (assumed)."""
MIN_DECREASE = 0.1
"""Decrease of chi squared below which no step of a refit is worth a simulation (assumed)."""
MAX_HEIGHT = 3.0
"""Height of the profile before a refit from which a point is too far for it (assumed)."""
MAX_GROWTH = 3.0
"""Largest ratio of the distances of successive points (assumed)."""
MAX_EVALUATIONS = 30
"""Evaluations of the residuals on one side of a parameter, those of derivatives included, after which the search ends
(assumed)."""
MIN_STEP_FRACTION = 0.1
"""Fraction of a step of a refit below which the refit ends where it is (assumed)."""


class ResidualFunction(NamedTuple):
    """Weighted residuals as a function of the parameters."""

    evaluate: Callable[[Sequence[Array]], Sequence[Array]]
    """Residuals (residuals,) at each of several points (parameters,); infinite where they do not exist."""
    differentiate: Callable[[Array], Array]
    """Jacobian (residuals, parameters) at a point."""
    lower: Array
    """Lower bounds, (parameters,)."""
    upper: Array
    """Upper bounds, (parameters,)."""


def find_profile_limits(
    function: ResidualFunction, best: Point, measure_error: Callable[[Array], float], indices: Sequence[int]
) -> list[tuple[float, float]]:
    """Return the distances to the lower and the upper limit of each parameter of ``indices``.

    ``best`` is the minimum of chi squared. ``measure_error`` returns the half width of the interval of a weighted sum
    of the noise in the residuals, for weights (residuals,). With the pseudoinverse of the Jacobian as weights, this is
    the half width of a parameter if residuals are linear in the parameters.

    A refit with the parameter at another value changes the residuals in one direction, and chi squared may rise by the
    square of the error of the noise in this direction. So where residuals are linear, the limits are at the half width,
    whatever noise this accounts for. One refit by a linear step on each side shows whether they are; only otherwise is
    the profile followed. A limit beyond a bound is at the bound, and so is one that :data:`MAX_EVALUATIONS` do not
    reach along a curved valley; without a bound, it is where they end.
    """
    pseudoinverse = np.linalg.pinv(best.jacobian)
    half_widths = [measure_error(pseudoinverse[index]) for index in indices]
    sides = [
        _ProfileSide(function, best, index, sign, half_width, measure_error)
        for index, half_width in zip(indices, half_widths, strict=True)
        for sign in (-1.0, 1.0)
    ]
    starts = [side.predict(best, side.start_distance) for side in sides]
    rows = function.evaluate(starts)
    limits = [
        side.find_limit(correct_jacobian(best, start, row))
        for side, start, row in zip(sides, starts, rows, strict=True)
    ]
    return list(zip(limits[::2], limits[1::2], strict=True))


class _LinearRefit(NamedTuple):
    """Minimum of the linear model of chi squared at a point over all parameters but one."""

    step: Array
    """Step of the other parameters."""
    decrease: float
    """Decrease of chi squared."""
    threshold: float
    """Rise of chi squared at the limit."""
    height: float
    """Square root of the rise of chi squared over the threshold."""


class _ProfileSide:
    """Profile of chi squared on one side of one parameter."""

    def __init__(
        self,
        function: ResidualFunction,
        best: Point,
        index: int,
        sign: float,
        half_width: float,
        measure_error: Callable[[Array], float],
    ) -> None:
        self._function, self._best, self._measure_error = function, best, measure_error
        self._index, self._sign, self._half_width = index, sign, half_width
        self._others = np.arange(len(best.x)) != index
        self._n_evaluations = 0
        limit = function.upper if sign > 0.0 else function.lower
        self._bound = float(abs(limit[index] - best.x[index]))
        """Distance to the bound of the parameter."""

    @property
    def start_distance(self) -> float:
        """Distance of the first point: the half width, or the bound."""
        return min(self._half_width, self._bound)

    def find_limit(self, start: Point) -> float:
        """Return the distance of the limit from ``start``, the point at :attr:`start_distance`."""
        half_width, distance = self._half_width, self.start_distance
        if distance == 0.0 or self._has_linear_limit(start):
            return half_width
        inner, inner_distance, inner_height, slope = self._best, 0.0, 0.0, 1.0 / half_width
        outer: tuple[float, float] | None = None
        max_step = np.inf
        point = self._advance(inner, distance)
        while True:
            step = distance - inner_distance
            if self._is_too_far(point):
                if step < LINEARITY_TOLERANCE * distance:
                    return distance
                max_step = 0.5 * step
            else:
                point, height = self._refit(point)
                if distance == self._bound and height <= 1.0 + LINEARITY_TOLERANCE:
                    return max(half_width, distance)
                slope = (height - inner_height) / step
                if abs(height - 1.0) <= LINEARITY_TOLERANCE and slope > 0.0:
                    return min(self._bound, distance + (1.0 - height) / slope)
                if height > 1.0:
                    outer = distance, height
                else:
                    inner, inner_distance, inner_height, max_step = point, distance, height, 2.0 * max_step
            if self._n_evaluations >= MAX_EVALUATIONS:
                unreached = self._bound if np.isfinite(self._bound) else inner_distance
                return outer[0] if outer else max(half_width, unreached)
            if outer is not None:
                gap, rise = outer[0] - inner_distance, outer[1] - inner_height
                if gap < LINEARITY_TOLERANCE * outer[0]:
                    return outer[0]
                target = float(np.clip((1.0 - inner_height) / rise, 0.1, 0.9)) * gap
            else:
                target = (1.0 - inner_height) / slope if slope > 0.0 else np.inf
                target = min(target, max(MAX_GROWTH * inner_distance, half_width) - inner_distance)
            distance = min(inner_distance + min(target, max_step), self._bound)
            point = self._advance(inner, distance)

    def _advance(self, inner: Point, distance: float) -> Point:
        """Return the point at ``distance`` with less chi squared: linearly refitted from ``inner``, or only shifted.

        A shifted point is better where residuals bend sharply. Both together show how residuals depend on the parameter
        and on the others.
        """
        (shifted,) = self._evaluate(inner, [self._shift(inner, distance)])
        (refitted,) = self._evaluate(shifted, [self.predict(inner, distance)])
        return refitted if refitted.chi2 <= shifted.chi2 else shifted._replace(jacobian=refitted.jacobian)

    def _has_linear_limit(self, point: Point) -> bool:
        """Return whether ``point`` at :attr:`start_distance` confirms the limit of the Jacobian."""
        if not np.isfinite(point.chi2):
            return False
        refit = self._refit_linearly(point)
        is_high = refit.height >= 1.0 - LINEARITY_TOLERANCE or self._half_width > self._bound
        return self._is_refitted(refit) and refit.height <= 1.0 + LINEARITY_TOLERANCE and is_high

    @staticmethod
    def _is_refitted(refit: _LinearRefit) -> bool:
        return refit.decrease <= max(MIN_DECREASE, REFIT_TOLERANCE * refit.threshold)

    def _shift(self, origin: Point, distance: float) -> Array:
        """Return the parameters of ``origin`` with the parameter at ``distance`` and the others unchanged."""
        x = origin.x.copy()
        x[self._index] = self._best.x[self._index] + self._sign * distance
        return x

    def _is_too_far(self, point: Point) -> bool:
        """Return whether chi squared at ``point`` is infinite, or too large for a refit."""
        if not np.isfinite(point.chi2):
            return True
        return point.chi2 - self._best.chi2 > MAX_HEIGHT**2 * self._refit_linearly(point).threshold

    def predict(self, origin: Point, distance: float) -> Array:
        """Return the parameters of a linear refit from ``origin`` with the parameter at ``distance``."""
        x = self._shift(origin, distance)
        residuals = origin.residuals + origin.jacobian[:, self._index] * (x[self._index] - origin.x[self._index])
        x[self._others] += self._solve(origin._replace(x=x, residuals=residuals))
        return x

    def _refit(self, point: Point) -> tuple[Point, float]:
        """Return ``point`` with the other parameters refitted, and the height of the profile."""
        fraction, is_fresh = 1.0, False
        while True:
            linear = self._refit_linearly(point)
            if self._is_refitted(linear) or self._n_evaluations >= MAX_EVALUATIONS:
                return point, linear.height
            x = point.x.copy()
            x[self._others] += fraction * linear.step
            (trial,) = self._evaluate(point, [x])
            gain = point.chi2 - trial.chi2
            if gain > 0.0:
                point = trial
            if gain > 0.25 * fraction * linear.decrease:
                fraction, is_fresh = min(1.0, 2.0 * fraction), False
            elif not is_fresh:
                point, is_fresh = point._replace(jacobian=self._function.differentiate(point.x)), True
                self._n_evaluations += len(point.x)
            elif fraction < MIN_STEP_FRACTION:
                return point, float(np.sqrt(max(0.0, point.chi2 - self._best.chi2) / linear.threshold))
            else:
                fraction *= 0.25

    def _refit_linearly(self, point: Point) -> _LinearRefit:
        step = self._solve(point)
        residuals = point.residuals + point.jacobian[:, self._others] @ step
        chi2, change = float(residuals @ residuals), residuals - self._best.residuals
        norm = float(np.linalg.norm(change))
        if norm == 0.0:
            return _LinearRefit(step, point.chi2 - chi2, np.inf, 0.0)
        # Samples without any error have none to compare with: any rise of chi squared is large.
        threshold = max(self._measure_error(change / norm) ** 2, np.finfo(np.float64).tiny)
        height = float(np.sqrt(max(0.0, chi2 - self._best.chi2) / threshold))
        return _LinearRefit(step, point.chi2 - chi2, threshold, height)

    def _solve(self, point: Point) -> Array:
        """Return the step of the other parameters to the minimum of the linear model within the bounds."""
        if not self._others.any():
            return np.zeros(0)
        orthogonal, triangular = np.linalg.qr(point.jacobian[:, self._others])
        x = point.x[self._others]
        bounds = self._function.lower[self._others] - x, self._function.upper[self._others] - x
        return np.asarray(lsq_linear(triangular, -orthogonal.T @ point.residuals, bounds, method="bvls").x)

    def _evaluate(self, origin: Point, points: Sequence[Array]) -> list[Point]:
        self._n_evaluations += len(points)
        return [
            correct_jacobian(origin, x, row) for x, row in zip(points, self._function.evaluate(points), strict=True)
        ]
