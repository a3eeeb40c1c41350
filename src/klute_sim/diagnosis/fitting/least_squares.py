"""Bounded nonlinear least squares for the parameters of a hypothesis."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares

from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import Residuals
from klute_sim.types import Array

FINITE_DIFFERENCE_STEP = 1e-3
"""Step of the finite differences in normalized parameters."""
BOUND_TOLERANCE = 1e-2
"""Distance from a bound, as a fraction of the range or of a typical size, below which a parameter is at the bound."""
DEFAULT_MAX_NFEV = 25
"""Largest number of evaluations of the residuals."""
COST_TOLERANCE, FINE_COST_TOLERANCE = 1e-5, 1e-7
"""Relative change of the cost at convergence: for comparing hypotheses, and for a final fit."""
GRADIENT_TOLERANCE = 1e-15
"""Gradient of chi squared that counts as 0. An effect without influence at the starting point has such a gradient, and
the solver would divide by it."""
MAX_CHI2_RISE = 0.5
"""Largest rise of chi squared over a fit with coarse simulations, before it is repeated with normal ones."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis with fitted parameters."""

    hypothesis: Hypothesis
    """Fitted hypothesis."""
    x: Array
    """Normalized parameters, (parameters,)."""
    weighted_residuals: Array
    """Weighted residuals followed by the residuals of the priors."""
    jacobian: Array
    """Derivative of the weighted residuals by the normalized parameters, (residuals, parameters)."""
    converged: bool
    """Whether the solver converged."""
    residuals: Residuals = field(repr=False)
    """Measured minus simulated [SI]."""

    @property
    def chi2(self) -> float:
        """Chi squared including the priors."""
        return float(self.weighted_residuals @ self.weighted_residuals)

    @property
    def has_diverged(self) -> bool:
        """Whether a simulation of the fit diverges; its chi squared is infinite then."""
        return not np.isfinite(self.chi2)

    @property
    def values(self) -> list[float]:
        """Fitted parameter values, each in its own unit."""
        return self.hypothesis.values(self.x)

    def find_bounds_reached(self) -> dict[int, float]:
        """Return index -> normalized bound of each parameter that is at its bound."""
        lower, upper = self.hypothesis.bounds()
        tolerance = BOUND_TOLERANCE * np.minimum(1.0, upper - lower)
        return {
            index: float(bound)
            for index, x in enumerate(self.x)
            for bound in (lower[index], upper[index])
            if math.isfinite(bound) and abs(x - bound) < tolerance[index]
        }

    def bic(self, n_effective: float) -> float:
        """Return the Bayesian information criterion for ``n_effective`` independent samples, up to a constant."""
        return self.chi2 + (len(self.x) - self.hypothesis.n_prior_parameters) * float(np.log(n_effective))


def fit_hypothesis(
    data: WeightedData,
    hypothesis: Hypothesis,
    x0: Array | None = None,
    jac: Array | None = None,
    *,
    max_nfev: int = DEFAULT_MAX_NFEV,
    fine: bool = False,
) -> Fit:
    """Fit ``hypothesis`` to ``data`` by bounded least squares.

    ``x0`` holds the starting point in normalized parameters; by default the nominal device with neutral effects.
    ``jac`` is the Jacobian at ``x0``, or an approximation for the first step. Intermediate simulations are coarse, with
    their error at ``x0`` subtracted; the residuals of the result are not. A ``fine`` fit takes its last steps and its
    Jacobian from normal simulations.

    The solver rejects a step to a point where a simulation diverges, and tries a shorter one. Where simulations diverge
    at ``x0`` itself, the result stays there, its residuals are infinite, and it has not converged.
    """
    names = [(e.name, e.holds_command) for e in data.experiments]
    start = hypothesis.initial_point() if x0 is None else x0
    key = repr((hypothesis, hypothesis.device.digest, sorted(data.noise.items()), names, max_nfev, fine))
    key += hashlib.sha256(start.tobytes() + (b"" if jac is None else jac.tobytes())).hexdigest()
    cached = data.cache.get(key) if data.cache else None
    if cached is not None:
        x, converged = cached["x"], bool(cached["converged"])
        residuals = data.compute_residuals(hypothesis, [x], may_diverge=True)[0]
        return Fit(hypothesis, x, cached["weighted_residuals"], cached["jacobian"], converged, residuals)
    fit = _solve(data, hypothesis, start, jac, max_nfev, coarse=True)
    if fine and len(start):
        fit = _solve(data, hypothesis, fit.x, None, max_nfev, coarse=False)
    if data.cache:
        data.cache.put(
            key,
            x=fit.x,
            weighted_residuals=fit.weighted_residuals,
            jacobian=fit.jacobian,
            converged=np.array(fit.converged),
        )
    return fit


def _solve(
    data: WeightedData, hypothesis: Hypothesis, x0: Array, jac: Array | None, max_nfev: int, *, coarse: bool
) -> Fit:
    lower, upper = hypothesis.bounds()
    # The first step is no longer than the distance from the bounds, so the solver starts inside them.
    margin = np.minimum(0.01, 0.25 * (upper - lower))
    start = np.clip(x0, lower + margin, upper - margin)
    problem = _LeastSquaresProblem(data, hypothesis, start, coarse=coarse)
    first, first_residuals = problem.evaluate_fine(start)
    if not len(start):
        return Fit(hypothesis, start, first, np.empty((len(first), 0)), True, first_residuals)
    if not np.isfinite(first).all():
        return Fit(hypothesis, start, first, np.zeros((len(first), len(start))), False, first_residuals)
    if not np.isfinite(problem.coarse_error).all():
        return _solve(data, hypothesis, x0, jac, max_nfev, coarse=False)
    known_jacobians = [] if jac is None else [jac]

    def jacobian(x: Array) -> Array:
        return known_jacobians.pop() if known_jacobians else problem.jacobian(x)

    result = least_squares(
        problem.evaluate,
        start,
        jacobian,
        bounds=(lower, upper),
        ftol=COST_TOLERANCE if coarse else FINE_COST_TOLERANCE,
        xtol=1e-6,
        gtol=GRADIENT_TOLERANCE,
        max_nfev=max_nfev,
    )
    last, last_residuals = problem.evaluate_fine(result.x)
    if coarse and last @ last > first @ first + MAX_CHI2_RISE:  # the error of coarse simulations changed too much
        return _solve(data, hypothesis, x0, jac, max_nfev, coarse=False)
    final_jacobian = np.asarray(result.jac)
    n_priors = hypothesis.n_prior_parameters
    final_jacobian[len(last) - n_priors :] = np.eye(n_priors, len(hypothesis.parameters))
    return Fit(hypothesis, result.x, last, final_jacobian, result.status > 0, last_residuals)


def linearize(data: WeightedData, hypothesis: Hypothesis, x: Array) -> tuple[Array, Array]:
    """Return the weighted residuals at normalized parameters ``x`` and their Jacobian from coarse simulations."""
    problem = _LeastSquaresProblem(data, hypothesis, x, coarse=True)
    return problem.evaluate_fine(x)[0], problem.jacobian(x)


def compute_difference_steps(hypothesis: Hypothesis, x: Array) -> Array:
    """Return the steps of one-sided differences at normalized parameters ``x``, (parameters,).

    They are negative at an upper bound: beyond it nothing changes.
    """
    return np.where(x + FINITE_DIFFERENCE_STEP > hypothesis.bounds()[1], -1.0, 1.0) * FINITE_DIFFERENCE_STEP


def compute_jacobian(data: WeightedData, hypothesis: Hypothesis, x: Array, *, coarse: bool) -> Array:
    """Return the derivative of the weighted residuals and those of the priors at normalized parameters ``x``.

    It consists of one-sided differences within the bounds, in one batch. A parameter whose small change makes a
    simulation diverge gets a derivative of 0: it stays where it is.
    """
    n_priors = hypothesis.n_prior_parameters
    steps = compute_difference_steps(hypothesis, x)
    before, *after = (hypothesis.build_setups(point, data.experiments) for point in (x, *(x + np.diag(steps))))
    columns = [
        np.concatenate([data.weight_residuals(changes) / step, prior])
        for changes, step, prior in zip(
            data.compute_changes(before, after, coarse=coarse),
            steps,
            np.eye(len(x), n_priors),
            strict=True,
        )
    ]
    for column in columns:
        if not np.isfinite(column).all():
            column[:] = 0.0
    return np.stack(columns, axis=1)


class _LeastSquaresProblem:
    """Weighted residuals and their Jacobian as functions of the normalized parameters.

    Coarse simulations have an error that hardly changes during a fit. It is determined at the starting point and
    subtracted everywhere.
    """

    def __init__(self, data: WeightedData, hypothesis: Hypothesis, x0: Array, *, coarse: bool) -> None:
        self._data, self._hypothesis, self._coarse = data, hypothesis, coarse
        self._fine_cache: dict[bytes, tuple[Array, Residuals]] = {}
        self.coarse_error: Array | float = 0.0
        """Error of the weighted residuals at the starting point."""
        fine = self.evaluate_fine(x0)[0]
        if coarse and np.isfinite(fine).all():
            self.coarse_error = self._evaluate_points([x0])[0] - fine

    def evaluate_fine(self, x: Array) -> tuple[Array, Residuals]:
        """Return the weighted residuals from normal simulations, and the residuals [SI]."""
        key = x.tobytes()
        if key not in self._fine_cache:
            residuals = self._data.compute_residuals(self._hypothesis, [x], may_diverge=True)[0]
            self._fine_cache[key] = self._assemble(x, residuals), residuals
        return self._fine_cache[key]

    def evaluate(self, x: Array) -> Array:
        """Return the weighted residuals followed by those of the priors."""
        return self._evaluate_points([x])[0] - self.coarse_error if self._coarse else self.evaluate_fine(x)[0]

    def jacobian(self, x: Array) -> Array:
        """Return the Jacobian of :meth:`evaluate`."""
        return compute_jacobian(self._data, self._hypothesis, x, coarse=self._coarse)

    def _evaluate_points(self, points: Sequence[Array]) -> list[Array]:
        rows = self._data.compute_residuals(self._hypothesis, points, coarse=self._coarse, may_diverge=True)
        return [self._assemble(x, residuals) for x, residuals in zip(points, rows, strict=True)]

    def _assemble(self, x: Array, residuals: Residuals) -> Array:
        priors = self._data.compute_prior_residuals(self._hypothesis, x)
        return np.concatenate([self._data.weight_residuals(residuals), priors])
