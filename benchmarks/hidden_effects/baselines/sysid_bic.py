"""Forward selection by BIC with the optimiser of ``mujoco.sysid``.

``mujoco.sysid`` estimates numbers and names no effect, so the BIC chooses between models that it has fitted. Its
``Parameter`` and ``optimize`` (MuJoCo's bounded Gauss-Newton least squares) get the weighted residuals of the fit
trials and of the priors. The simulator is that of the package instead of ``build_residual_fn``, because a device on the
bench has no MuJoCo model.
"""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from benchmarks.hidden_effects.baselines.calibration import MAX_EFFECTS, Calibration, compute_bic
from benchmarks.hidden_effects.baselines.trials import Trials, Verdict

from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.screening import Candidate, screen_candidates
from klute_sim.types import Array

MAX_ITERATIONS = 15
"""Largest number of iterations of a fit."""
STEP = 1e-3
"""Step of the finite differences in normalized parameters, as in the fits of the package."""
RELATIVE_STEP_TOLERANCE = 1e-3
"""Relative change of the parameters at convergence."""
MAX_START = 1.0
"""Largest size of an effect at the start, in typical sizes."""

MAX_BOUND = 100.0
"""Bound of a parameter without one, in typical sizes or standard deviations: ``mujoco.sysid`` needs finite bounds."""


def select_by_sysid(trials: Trials, exclude: Sequence[str]) -> Verdict:
    """Return the effects that lower the BIC, added one at a time; each is fitted by ``mujoco.sysid``.

    In each step the effects that combine with the others are those of :meth:`Calibration.select_switches`.
    """
    with Calibration(trials, exclude) as calibration:
        switches, current = calibration.select_switches(), calibration.base
        for _ in range(MAX_EFFECTS):
            open_terms = [term for term in switches if term not in current.hypothesis.terms]
            candidates = screen_candidates(calibration.data, current, open_terms)
            fits = [_fit_candidate(calibration.data, current, candidate) for candidate in candidates]
            best = min((fit for fit in fits if not fit.has_diverged), key=compute_bic, default=None)
            if best is None or compute_bic(best) >= compute_bic(current):
                break
            current = best
        return calibration.describe(current)


def _fit_candidate(data: WeightedData, current: Fit, candidate: Candidate) -> Fit:
    hypothesis = current.hypothesis.with_term(candidate.term)
    start = hypothesis.initial_point()
    start[: len(current.x)] = current.x
    start[len(current.x) :] = [
        0.0 if parameter.is_logarithmic else np.clip(candidate.size, -MAX_START, MAX_START)
        for parameter in hypothesis.parameters[len(current.x) :]
    ]
    return fit_with_sysid(data, hypothesis, start)


def fit_with_sysid(data: WeightedData, hypothesis: Hypothesis, start: Array) -> Fit:
    """Fit ``hypothesis`` to ``data`` by ``mujoco.sysid`` from normalized parameters ``start``."""
    from mujoco import sysid

    lower, upper = (np.clip(bound, -MAX_BOUND, MAX_BOUND) for bound in hypothesis.bounds())
    margin = np.minimum(0.01, 0.25 * (upper - lower))  # a start at a bound can stall
    start = np.clip(start, lower + margin, upper - margin)
    parameters = sysid.ParameterDict()
    for index, (parameter, *limits) in enumerate(zip(hypothesis.parameters, start, lower, upper, strict=True)):
        parameters.add(sysid.Parameter(f"{index}_{parameter.name}", *limits))

    def evaluate(points: Sequence[Array], *, coarse: bool) -> Array:
        """Return the weighted residuals followed by those of the priors, one column per point."""
        rows = data.compute_residuals(hypothesis, points, coarse=coarse, may_diverge=True)
        columns = [
            np.concatenate([data.weight_residuals(row), point[: hypothesis.n_prior_parameters]])
            for point, row in zip(points, rows, strict=True)
        ]
        return np.stack(columns, axis=1)

    # Coarse simulations have an error that hardly changes during a fit.
    coarse_error = evaluate([start], coarse=True) - evaluate([start], coarse=False)

    def compute_residuals(x: Array, _: Any) -> tuple[list[Array], None, None]:
        """Return the residuals at one point, or at each column of ``x``."""
        return [evaluate(list(np.reshape(x, (len(start), -1)).T), coarse=True) - coarse_error], None, None

    solution, result = sysid.optimize(
        parameters,
        compute_residuals,
        verbose=False,
        max_iters=MAX_ITERATIONS,
        eps=STEP,
        xtol=RELATIVE_STEP_TOLERANCE,
        output=io.StringIO(),
    )
    x = np.asarray(solution.as_vector())
    (residuals,) = data.compute_residuals(hypothesis, [x], may_diverge=True)
    weighted = np.concatenate([data.weight_residuals(residuals), x[: hypothesis.n_prior_parameters]])
    return Fit(hypothesis, x, weighted, np.asarray(result.jac), True, residuals)
