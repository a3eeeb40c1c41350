"""Bounded nonlinear least squares for the parameters of a hypothesis."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from klute_sim.diagnosis.experiments.base import Experiment, SimulationSetup
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.fit_cache import FitCache
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.noise.repeats import Noise, Residuals
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
class WeightedData:
    """Measured trials and the weights of their residuals."""

    simulator: Simulator
    """Simulator of the trials."""
    experiments: Sequence[Experiment]
    """Trials."""
    noise: Mapping[str, Noise]
    """Channel -> noise; other channels are not weighted and do not count."""
    cache: FitCache | None = None
    """Cache of finished fits."""

    @property
    def n_effective(self) -> float:
        """Effective number of independent samples."""
        return sum(
            len(series.time) / self.noise[channel].correlation_time(series.sampling_interval)
            for e in self.experiments
            for channel, series in e.measured.items()
            if channel in self.noise
        )

    def compute_residuals(
        self, hypothesis: Hypothesis, points: Sequence[Array], *, coarse: bool = False, may_diverge: bool = False
    ) -> list[list[dict[str, Array]]]:
        """Return measured minus simulated [SI] per point of normalized parameters, experiment and channel.

        ``coarse`` simulations are faster and less accurate. A simulation that diverges raises SimulationError; with
        ``may_diverge`` its residuals are infinite.
        """
        setups = [hypothesis.build_setups(x, self.experiments) for x in points]
        return [
            [
                {channel: series.value - simulated[channel] for channel, series in e.measured.items()}
                for e, simulated in zip(self.experiments, readings, strict=True)
            ]
            for readings in self.simulator.simulate(setups, self.experiments, coarse=coarse, may_diverge=may_diverge)
        ]

    @cached_property
    def representatives(self) -> list[int]:
        """For each experiment: the index of its first repeat with the same samples.

        Repeats have the same inputs but for noise, so they share derivatives. Samples at the limit of a sensor respond
        in one repeat and not in another, so such trials represent themselves.
        """
        indices = []
        for index, e in enumerate(self.experiments):
            same = (k for k, other in enumerate(self.experiments[:index]) if _has_same_samples(e, other))
            indices.append(next(same, index))
        return indices

    def compute_changes(
        self, before: Sequence[SimulationSetup], after: Sequence[Sequence[SimulationSetup]], *, coarse: bool = False
    ) -> list[list[dict[str, Array]]]:
        """Return the changes of the residuals [SI] from the setups ``before`` to each row of setups ``after``.

        A row has one setup per experiment. Only :attr:`representatives` are simulated. Where a simulation diverges, the
        change is infinite.
        """
        indices = sorted(set(self.representatives))
        rows = [[row[index] for index in indices] for row in (before, *after)]
        simulated = [self.experiments[i] for i in indices]
        base, *changed = self.simulator.simulate(rows, simulated, coarse=coarse, may_diverge=True)
        positions = [indices.index(index) for index in self.representatives]
        return [
            [{channel: base[k][channel] - value for channel, value in readings[k].items()} for k in positions]
            for readings in changed
        ]

    def weight_residuals(self, residuals: Residuals) -> Array:
        """Return one vector of weighted residuals; its square is chi squared over independent samples."""
        parts = [
            weight * row[channel]
            for row, weights in zip(residuals, self.weights, strict=True)
            for channel, weight in weights.items()
        ]
        return np.concatenate(parts)

    def split_weighted_residuals(self, weighted_residuals: Array) -> list[dict[str, Array]]:
        """Return the residuals [SI] per experiment and channel of a vector of :meth:`weight_residuals`.

        Residuals of priors that follow in the vector are left out.
        """
        rows, start = [], 0
        for e, weights in zip(self.experiments, self.weights, strict=True):
            row = {}
            for channel, weight in weights.items():
                end = start + len(e.measured[channel].time)
                row[channel] = weighted_residuals[start:end] / weight
                start = end
            rows.append(row)
        return rows

    @cached_property
    def weights(self) -> list[dict[str, Array | float]]:
        """For each experiment: channel -> weight of its residuals [1/SI], a scalar or one per sample."""
        return [
            {
                channel: self.noise[channel].weight(series.sampling_interval)
                / (e.noise_scale.get(channel, 1.0) * e.input_error_scale.get(channel, 1.0))
                for channel, series in e.measured.items()
                if channel in self.noise
            }
            for e in self.experiments
        ]

    def compute_prior_residuals(self, hypothesis: Hypothesis, x: Array) -> Array:
        """Return the residuals of the priors of ``hypothesis`` at normalized parameters ``x``.

        A gain of the mechanical input multiplies its noise as well, so least squares would favour a small gain
        (regression dilution). The expected derivative of half of chi squared by the gain ``g`` at the truth is the
        number ``n`` of independent samples of this noise. The corrected score (Nakamura, Biometrika 77:127, 1990)
        subtracts it, which for a small gain is a prior whose mean is ``n dg/dx``.
        """
        return np.asarray(x[: hypothesis.n_prior_parameters] - self.n_noisy_inputs * hypothesis.input_gains)

    @cached_property
    def n_noisy_inputs(self) -> float:
        """Effective number of independent samples of the noise of the mechanical input."""
        return sum(
            float(np.sum(share / np.square(e.input_error_scale.get(channel, 1.0))))
            / self.noise[channel].correlation_time(e.measured[channel].sampling_interval)
            for e in self.experiments
            for channel, share in e.input_noise_share.items()
            if channel in self.noise and channel in e.measured
        )

    def with_experiments(self, experiments: Sequence[Experiment]) -> "WeightedData":
        """Return other ``experiments`` with the same noise."""
        return WeightedData(self.simulator, experiments, self.noise, self.cache)


def _has_same_samples(experiment: Experiment, other: Experiment) -> bool:
    """Return whether two trials are repeats with the same duration and the same channels at the same times."""
    if experiment.group != other.group or experiment.limits or other.limits:
        return False
    if experiment.device.digest != other.device.digest or experiment.trusted != other.trusted:
        return False
    if experiment.dt != other.dt or len(experiment.command) != len(other.command):
        return False
    if experiment.measured.keys() != other.measured.keys():
        return False
    times = [(series.time, other.measured[channel].time) for channel, series in experiment.measured.items()]
    delay = experiment.start_time - other.start_time
    return all(len(a) == len(b) and np.allclose(a - delay, b, rtol=0.0, atol=1e-6) for a, b in times)


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
