"""The unknowns of a hypothesis, fitted to measured trials."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from klute_sim.diagnosis.experiments.base import Array, Experiment, Simulator
from klute_sim.diagnosis.fitting.fit_cache import FitCache
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.noise.repeats import Noise, Residuals

FINITE_DIFFERENCE_STEP = 1e-3
"""Of an unknown, in steps of its own size, to take derivatives with."""
DEFAULT_MAX_NFEV = 25
COST_TOLERANCE, FINE_COST_TOLERANCE = 1e-5, 1e-7
"""Relative change of cost at which a fit has converged: one that is compared with others, and one that is kept."""


@dataclass(frozen=True, eq=False)
class WeightedData:
    """Measured trials and what weighs their residuals."""

    simulator: Simulator
    experiments: Sequence[Experiment]
    noise: Mapping[str, Noise]
    cache: FitCache | None = None
    """Where finished fits are kept."""

    @property
    def n_effective(self) -> float:
        """Independent samples in all."""
        return sum(
            len(series.time) / self.noise[channel].correlation_time(series.sampling_interval)
            for e in self.experiments
            for channel, series in e.measured.items()
            if channel in self.noise
        )

    def compute_residuals(
        self, hypothesis: Hypothesis, points: Sequence[Array], *, coarse: bool = False
    ) -> list[list[dict[str, Array]]]:
        """Measured minus simulated [SI] for each of ``rows`` of unknowns, in each experiment; ``coarse``: quickly."""
        settings = [hypothesis.build_setups(row, self.experiments) for row in points]
        return [
            [
                {channel: series.value - shown[channel] for channel, series in e.measured.items()}
                for e, shown in zip(self.experiments, found, strict=True)
            ]
            for found in self.simulator.simulate(settings, self.experiments, coarse=coarse)
        ]

    def weight_residuals(self, residuals: Residuals) -> Array:
        """One vector whose square is chi squared, counting only independent samples."""
        parts = [
            weight * found[channel]
            for found, weights in zip(residuals, self.weights, strict=True)
            for channel, weight in weights.items()
        ]
        return np.concatenate(parts)

    @cached_property
    def weights(self) -> list[dict[str, Array | float]]:
        """Per experiment: weighed channel -> what its residuals are multiplied by [1/SI], one or one per sample."""
        return [
            {
                c: self.noise[c].weight(series.sampling_interval) / e.noise_scale.get(c, 1.0)
                for c, series in e.measured.items()
                if c in self.noise
            }
            for e in self.experiments
        ]

    def with_experiments(self, experiments: Sequence[Experiment]) -> "WeightedData":
        """Other trials, weighed alike."""
        return WeightedData(self.simulator, experiments, self.noise, self.cache)


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis with its unknowns found."""

    hypothesis: Hypothesis
    x: Array
    """The unknowns, in steps of their sizes."""
    weighted_residuals: Array
    """Weighted residuals, those of the priors last."""
    jacobian: Array
    """Of :attr:`vector` by the unknowns."""
    converged: bool
    residuals: Residuals = field(repr=False)
    """[SI]"""

    @property
    def chi2(self) -> float:
        """Chi squared, priors included."""
        return float(self.weighted_residuals @ self.weighted_residuals)

    @property
    def values(self) -> list[float]:
        """The unknowns in their own units."""
        return self.hypothesis.values(self.x)

    def bic(self, n_effective: float) -> float:
        """BIC with the effective number of samples; differences of it decide."""
        return self.chi2 + (len(self.x) - self.hypothesis.n_device_parameters) * float(np.log(n_effective))


GRADIENT_TOLERANCE = 1e-15
"""Gradient of chi squared, per step, that is none: of an effect that changes nothing where its fit begins. The solver
would divide by it."""
MAX_CHI2_RISE = 0.5
"""Rise of chi squared that a fit by long steps may end with, where it began as well as anywhere."""


def fit_hypothesis(
    data: WeightedData,
    hypothesis: Hypothesis,
    x0: Array | None = None,
    jac: Array | None = None,
    *,
    max_nfev: int = DEFAULT_MAX_NFEV,
    fine: bool = False,
) -> Fit:
    """Fit ``hypothesis`` from ``start`` (in steps; None: nominal and neutral) by bounded least squares.

    ``slope`` is the Jacobian at ``start``, or near enough to find the first direction, where it is known. On the way
    simulations are coarse, with what is wrong with them at the ``start`` taken off; the result's residuals never are. A
    ``fine`` fit goes the last steps, and takes its derivatives, with the short steps of these.
    """
    given = [e.name for e in data.experiments]
    question = repr((hypothesis, sorted(data.noise.items()), given, max_nfev, fine))
    begin = hypothesis.initial_point() if x0 is None else x0
    question += hashlib.sha256(begin.tobytes() + (b"" if jac is None else jac.tobytes())).hexdigest()
    kept = data.cache.get(question) if data.cache else None
    if kept is not None:
        residuals = data.compute_residuals(hypothesis, [kept["steps"]])[0]
        return Fit(hypothesis, kept["steps"], kept["vector"], kept["jacobian"], bool(kept["converged"]), residuals)
    done = _solve(data, hypothesis, begin, jac, max_nfev, coarse=True)
    if fine and len(begin):
        done = _solve(data, hypothesis, done.x, None, max_nfev, coarse=False)
    if data.cache:
        whether = np.array(done.converged)
        data.cache.put(
            question, steps=done.x, vector=done.weighted_residuals, jacobian=done.jacobian, converged=whether
        )
    return done


def _solve(
    data: WeightedData, hypothesis: Hypothesis, x0: Array, jac: Array | None, max_nfev: int, *, coarse: bool
) -> Fit:
    low, high = hypothesis.bounds()
    # Not at a bound: the first step would be no longer than the distance from it.
    margin = np.minimum(0.01, 0.25 * (high - low))
    inside = np.clip(x0, low + margin, high - margin)
    problem = _LeastSquaresProblem(data, hypothesis, inside, coarse=coarse)
    first = problem.evaluate_fine(inside)
    if not len(inside):
        return Fit(hypothesis, inside, first[0], np.empty((len(first[0]), 0)), True, first[1])
    known = [] if jac is None else [jac]

    def slope_at(row: Array) -> Array:
        return known.pop() if known else problem.jacobian(row)

    result = least_squares(
        problem.evaluate,
        inside,
        slope_at,
        bounds=(low, high),
        ftol=COST_TOLERANCE if coarse else FINE_COST_TOLERANCE,
        xtol=1e-6,
        gtol=GRADIENT_TOLERANCE,
        max_nfev=max_nfev,
    )
    last, found = problem.evaluate_fine(result.x), np.asarray(result.jac)
    if (
        coarse and last[0] @ last[0] > first[0] @ first[0] + MAX_CHI2_RISE
    ):  # what long steps get wrong has changed too much on the way
        return _solve(data, hypothesis, x0, jac, max_nfev, coarse=False)
    found[len(last[0]) - hypothesis.n_device_parameters :] = np.eye(
        hypothesis.n_device_parameters, len(hypothesis.parameters)
    )
    return Fit(hypothesis, result.x, last[0], found, result.status > 0, last[1])


def linearize(data: WeightedData, hypothesis: Hypothesis, x: Array) -> tuple[Array, Array]:
    """Weighted residuals at ``row`` of unknowns, and their derivatives, these by long steps."""
    problem = _LeastSquaresProblem(data, hypothesis, x, coarse=True)
    return problem.evaluate_fine(x)[0], problem.jacobian(x)


class _LeastSquaresProblem:
    """The vector whose square is least, and its derivatives, by few long steps or many short ones.

    What long steps get wrong is known where a fit begins, and taken off everywhere: it hardly changes on the way.
    """

    def __init__(self, data: WeightedData, hypothesis: Hypothesis, x0: Array, *, coarse: bool) -> None:
        self._data, self._hypothesis, self._coarse = data, hypothesis, coarse
        self._upper = hypothesis.bounds()[1]
        self._fine_cache: dict[bytes, tuple[Array, Residuals]] = {}
        self._coarse_error: Array | float = 0.0
        if coarse:
            self._coarse_error = self._evaluate_points([x0])[0] - self.evaluate_fine(x0)[0]

    def evaluate_fine(self, x: Array) -> tuple[Array, Residuals]:
        """The vector at ``row`` by short steps, and the residuals [SI] in it."""
        key = x.tobytes()
        if key not in self._fine_cache:
            residuals = self._data.compute_residuals(self._hypothesis, [x])[0]
            self._fine_cache[key] = self._assemble(x, residuals), residuals
        return self._fine_cache[key]

    def evaluate(self, x: Array) -> Array:
        """Weighted residuals at ``row``, those of the priors last."""
        return self._evaluate_points([x])[0] - self._coarse_error if self._coarse else self.evaluate_fine(x)[0]

    def jacobian(self, x: Array) -> Array:
        """Of :meth:`vector`: into the bounds, one unknown at a time, all at once on the bench."""
        signs = np.where(x + FINITE_DIFFERENCE_STEP > self._upper, -1.0, 1.0)
        moved = [x + FINITE_DIFFERENCE_STEP * sign * unit for sign, unit in zip(signs, np.eye(len(x)), strict=True)]
        here, *vectors = self._evaluate_points([x, *moved])
        return np.stack(
            [(v - here) / (FINITE_DIFFERENCE_STEP * s) for v, s in zip(vectors, signs, strict=True)], axis=1
        )

    def _evaluate_points(self, points: Sequence[Array]) -> list[Array]:
        found = self._data.compute_residuals(self._hypothesis, points, coarse=self._coarse)
        return [self._assemble(row, each) for row, each in zip(points, found, strict=True)]

    def _assemble(self, x: Array, residuals: Residuals) -> Array:
        return np.concatenate([self._data.weight_residuals(residuals), x[: self._hypothesis.n_device_parameters]])
