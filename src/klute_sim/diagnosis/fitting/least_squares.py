"""Bounded nonlinear least squares for the parameters of a hypothesis."""

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from klute_sim.diagnosis.fitting.hypothesis import Hypothesis, Identity
from klute_sim.diagnosis.fitting.secant import SecantJacobian
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
FINE_CHI2_STEP = 0.01
"""Fall of chi squared in one step at which a final fit has converged, too: the minimum is lower by as little where a
parameter is off by a tenth of its standard error."""
GRADIENT_TOLERANCE = 1e-15
"""Gradient of chi squared that counts as 0. An effect without influence at the starting point has such a gradient, and
the solver would divide by it."""
MAX_CHI2_RISE = 0.5
"""Largest rise of chi squared in a fit with coarse simulations; beyond it, the fit is repeated. A preliminary fit
is repeated with the error of coarse simulations at its own start, any other with normal simulations."""


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
    is_preliminary: bool = False
    """Whether the fit only serves to compare hypotheses: its steps and its Jacobian are approximations."""

    @property
    def chi2(self) -> float:
        """Chi squared including the priors."""
        return float(self.weighted_residuals @ self.weighted_residuals)

    @property
    def has_diverged(self) -> bool:
        """Whether a simulation of the fit diverges; its chi squared is infinite then."""
        return not np.isfinite(self.chi2)

    @property
    def identities(self) -> frozenset[Identity]:
        """What the terms of the hypothesis stand for."""
        return frozenset(term.identity for term in self.hypothesis.terms)

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
    reference: Fit | None = None,
) -> Fit:
    """Fit ``hypothesis`` to ``data`` by bounded least squares.

    ``x0`` holds the starting point in normalized parameters; by default the nominal device with neutral effects.
    ``jac`` is the Jacobian at ``x0``, or an approximation for the first step. Intermediate simulations are coarse, with
    their error at ``x0`` subtracted; the residuals of the result are not. A ``fine`` fit takes its last steps and its
    Jacobian from normal simulations.

    With a ``reference``, the fit is preliminary: its steps follow the residuals of ``reference`` plus their change in
    coarse simulations, and those along which they are nearly linear correct its Jacobian
    (:mod:`klute_sim.diagnosis.fitting.secant`). It begins without a normal simulation and ends with one.

    The solver rejects a step to a point where a simulation diverges, and tries a shorter one. Where simulations diverge
    at ``x0`` itself, the result stays there, its residuals are infinite, and it has not converged.
    """
    names = [(e.name, e.has_zero_order_hold, e.initial_friction) for e in data.experiments]
    start = hypothesis.initial_point() if x0 is None else x0
    key = repr((hypothesis, hypothesis.device.digest, sorted(data.noise.items()), names, max_nfev, fine))
    key += hashlib.sha256(start.tobytes() + (b"" if jac is None else jac.tobytes())).hexdigest()
    if reference is not None:
        key += hashlib.sha256(repr(reference.hypothesis).encode() + reference.x.tobytes()).hexdigest()
    cached = data.cache.get(key) if data.cache else None
    if cached is not None:
        x, weighted, converged = cached["x"], cached["weighted_residuals"], bool(cached["converged"])
        residuals = data.compute_residuals(hypothesis, [x], may_diverge=True)[0]
        is_preliminary = bool(cached["is_preliminary"])
        return Fit(hypothesis, x, weighted, cached["jacobian"], converged, residuals, is_preliminary)
    fit = None if reference is None else _compare(data, hypothesis, start, jac, max_nfev, reference)
    fit = fit or _solve(data, hypothesis, start, jac, max_nfev, coarse=True)
    if fine and len(start) and not fit.has_diverged:
        fit = _refine(data, fit, max_nfev)
    if data.cache:
        data.cache.put(
            key,
            x=fit.x,
            weighted_residuals=fit.weighted_residuals,
            jacobian=fit.jacobian,
            converged=np.array(fit.converged),
            is_preliminary=np.array(fit.is_preliminary),
        )
    return fit


def _solve(
    data: WeightedData, hypothesis: Hypothesis, x0: Array, jac: Array | None, max_nfev: int, *, coarse: bool
) -> Fit:
    start = _move_inside(hypothesis, x0)
    problem = _LeastSquaresProblem(data, hypothesis, coarse=coarse)
    first, first_residuals = problem.evaluate_fine(start)
    if not len(start):
        return Fit(hypothesis, start, first, np.empty((len(first), 0)), True, first_residuals)
    if not np.isfinite(first).all():
        return Fit(hypothesis, start, first, np.zeros((len(first), len(start))), False, first_residuals)
    if coarse:
        problem.measure_coarse_error(hypothesis, start, first)
    if not np.isfinite(problem.coarse_error).all():
        return _solve(data, hypothesis, x0, jac, max_nfev, coarse=False)
    known_jacobians = [] if jac is None else [jac]

    def jacobian(x: Array) -> Array:
        return known_jacobians.pop() if known_jacobians else problem.jacobian(x)

    tolerance = COST_TOLERANCE if coarse else FINE_COST_TOLERANCE
    result = _search(problem, start, jacobian, max_nfev, tolerance)
    last, last_residuals = problem.evaluate_fine(result.x)
    if coarse and last @ last > first @ first + MAX_CHI2_RISE:  # the error of coarse simulations changed too much
        return _solve(data, hypothesis, x0, jac, max_nfev, coarse=False)
    final_jacobian = np.asarray(result.jac)
    n_priors = hypothesis.n_prior_parameters
    final_jacobian[len(last) - n_priors :] = np.eye(n_priors, len(hypothesis.parameters))
    return Fit(hypothesis, result.x, last, final_jacobian, result.status > 0, last_residuals)


def _refine(data: WeightedData, fit: Fit, max_nfev: int) -> Fit:
    """Return ``fit`` after further steps with normal simulations."""
    problem = _LeastSquaresProblem(data, fit.hypothesis, coarse=False)
    # The Jacobian of coarse simulations is too inaccurate for the flat valley of numbers that compensate each other.
    jacobian = SecantJacobian(problem.evaluate, problem.jacobian)
    tolerance = max(FINE_COST_TOLERANCE, FINE_CHI2_STEP / max(fit.chi2, 1.0))
    result = _search(problem, fit.x, jacobian, max_nfev, tolerance)
    weighted, residuals = problem.evaluate_fine(result.x)
    return Fit(fit.hypothesis, result.x, weighted, problem.jacobian(result.x), result.status > 0, residuals)


def complete_fit(data: WeightedData, fit: Fit) -> Fit:
    """Return ``fit`` with a computed Jacobian, where it is preliminary."""
    if not fit.is_preliminary:
        return fit
    is_known = fit.has_diverged or not len(fit.x)
    jacobian = fit.jacobian if is_known else compute_jacobian(data, fit.hypothesis, fit.x, coarse=True)
    return replace(fit, jacobian=jacobian, is_preliminary=False)


def _compare(
    data: WeightedData, hypothesis: Hypothesis, x0: Array, jac: Array | None, max_nfev: int, reference: Fit
) -> Fit | None:
    """Return the preliminary fit; None where coarse simulations diverge at its start, or mislead it."""
    start = _move_inside(hypothesis, x0)
    problem = _LeastSquaresProblem(data, hypothesis, coarse=True)
    problem.measure_coarse_error(reference.hypothesis, reference.x, reference.weighted_residuals)
    if not np.isfinite(problem.evaluate(start)).all():
        return None
    jacobian = SecantJacobian(problem.evaluate, problem.jacobian, jac)
    result = _search(problem, start, jacobian, max_nfev, COST_TOLERANCE)
    # The error of coarse simulations depends on the effects, so only normal ones tell which model fits better.
    last, residuals = problem.evaluate_fine(result.x)
    fit = Fit(hypothesis, result.x, last, np.asarray(result.jac), result.status > 0, residuals, is_preliminary=True)
    continues_reference = hypothesis == reference.hypothesis and np.array_equal(x0, reference.x)
    return None if continues_reference and fit.chi2 > reference.chi2 + MAX_CHI2_RISE else fit


def _move_inside(hypothesis: Hypothesis, x0: Array) -> Array:
    """Return the starting point ``x0`` inside the bounds: the first step is no longer than the distance from them."""
    lower, upper = hypothesis.bounds()
    margin = np.minimum(0.01, 0.25 * (upper - lower))
    return np.clip(x0, lower + margin, upper - margin)


def _search(
    problem: "_LeastSquaresProblem",
    start: Array,
    jacobian: Callable[[Array], Array],
    max_nfev: int,
    cost_tolerance: float,
) -> OptimizeResult:
    return least_squares(
        problem.evaluate,
        start,
        jacobian,
        bounds=problem.hypothesis.bounds(),
        ftol=cost_tolerance,
        xtol=1e-6,
        gtol=GRADIENT_TOLERANCE,
        max_nfev=max_nfev,
    )


def linearize(data: WeightedData, hypothesis: Hypothesis, x: Array) -> tuple[Array, Array]:
    """Return the weighted residuals at normalized parameters ``x`` and their Jacobian from coarse simulations."""
    problem = _LeastSquaresProblem(data, hypothesis, coarse=True)
    return problem.evaluate_fine(x)[0], problem.jacobian(x)


def compute_difference_steps(hypothesis: Hypothesis, x: Array) -> Array:
    """Return the steps of one-sided differences at normalized parameters ``x``, (parameters,).

    They are negative at an upper bound: beyond it nothing changes.
    """
    return np.where(x + FINITE_DIFFERENCE_STEP > hypothesis.bounds()[1], -1.0, 1.0) * FINITE_DIFFERENCE_STEP


def compute_jacobian(data: WeightedData, hypothesis: Hypothesis, x: Array, *, coarse: bool, first: int = 0) -> Array:
    """Return the derivative of the weighted residuals and those of the priors at normalized parameters ``x``.

    It consists of one-sided differences within the bounds, in one batch, by the parameters from index ``first`` on. A
    parameter whose small change makes a simulation diverge gets a derivative of 0: it stays where it is.
    """
    n_priors = hypothesis.n_prior_parameters
    steps = compute_difference_steps(hypothesis, x)
    points = (x + np.diag(steps))[first:]
    before, *after = (hypothesis.build_setups(point, data.experiments) for point in (x, *points))
    columns = [
        np.concatenate([data.weight_residuals(changes) / step, prior])
        for changes, step, prior in zip(
            data.compute_changes(before, after, coarse=coarse),
            steps[first:],
            np.eye(len(x), n_priors)[first:],
            strict=True,
        )
    ]
    for column in columns:
        if not np.isfinite(column).all():
            column[:] = 0.0
    return np.stack(columns, axis=1)


def extend_jacobian(data: WeightedData, hypothesis: Hypothesis, x: Array, known: Array) -> Array:
    """Return an approximate Jacobian at normalized parameters ``x``, to begin a fit with.

    Its first columns are those of ``known``, from a fit without the last term; those of this term are computed from
    coarse simulations.
    """
    return np.hstack([known, compute_jacobian(data, hypothesis, x, coarse=True, first=known.shape[1])])


class _LeastSquaresProblem:
    """Weighted residuals and their Jacobian as functions of the normalized parameters.

    Coarse simulations have an error that hardly changes during a fit. It is determined at the starting point and
    subtracted everywhere.
    """

    def __init__(self, data: WeightedData, hypothesis: Hypothesis, *, coarse: bool) -> None:
        self._data = data
        self.hypothesis, self.coarse = hypothesis, coarse
        self._fine_cache: dict[bytes, tuple[Array, Residuals]] = {}
        self._last: tuple[bytes, Array] | None = None
        self.coarse_error: Array | float = 0.0
        """Error of the weighted residuals, without those of the priors."""

    def measure_coarse_error(self, hypothesis: Hypothesis, x: Array, weighted_residuals: Array) -> None:
        """Set the error to that of coarse simulations of ``hypothesis`` at ``x``, with its ``weighted_residuals``."""
        (coarse,) = self._data.compute_residuals(hypothesis, [x], coarse=True, may_diverge=True)
        vector = self._data.weight_residuals(coarse)
        self.coarse_error = vector - weighted_residuals[: len(vector)]

    def evaluate_fine(self, x: Array) -> tuple[Array, Residuals]:
        """Return the weighted residuals from normal simulations, and the residuals [SI]."""
        key = x.tobytes()
        if key not in self._fine_cache:
            residuals = self._data.compute_residuals(self.hypothesis, [x], may_diverge=True)[0]
            self._fine_cache[key] = self._assemble(x, residuals), residuals
        return self._fine_cache[key]

    def evaluate(self, x: Array) -> Array:
        """Return the weighted residuals followed by those of the priors."""
        if not self.coarse:
            return self.evaluate_fine(x)[0]
        key = x.tobytes()
        if self._last is None or self._last[0] != key:
            (residuals,) = self._data.compute_residuals(self.hypothesis, [x], coarse=True, may_diverge=True)
            vector = self._assemble(x, residuals)
            vector[: len(vector) - self.hypothesis.n_prior_parameters] -= self.coarse_error
            self._last = key, vector
        return self._last[1]

    def jacobian(self, x: Array) -> Array:
        """Return the Jacobian of :meth:`evaluate`."""
        return compute_jacobian(self._data, self.hypothesis, x, coarse=self.coarse)

    def _assemble(self, x: Array, residuals: Residuals) -> Array:
        priors = self._data.compute_prior_residuals(self.hypothesis, x)
        return np.concatenate([self._data.weight_residuals(residuals), priors])
