"""Friction with which trials begin: what an earlier motion left, and the device holds until it slides.

A muscle that was stretched or filled before the recording pulls more or less than a relaxed one, for a whole trial if
it is clamped. The first movement erases this only where it is long enough and comes early. So where a device with dry
friction leaves a misfit, the initial friction of each condition is estimated, and the search begins again. The result
counts only where it explains the data to the noise: elsewhere a friction that differs between trials could stand in for
any error of the force.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from klute_sim.device.equilibrium import holds_friction
from klute_sim.diagnosis.command_interpolation import Outcome, Preparation
from klute_sim.diagnosis.data_quality import has_repeats
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.filter_refinement import ADEQUATE_VERDICTS
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import group_repeats
from klute_sim.types import Array

MAX_MISFIT_FRACTION = 0.5
"""Largest chi squared above the noise with initial friction, over that without, for which a model is searched again
(assumed: other causes differ between trials, too)."""
MAX_MODELS = 5
"""Largest number of models with which initial friction is tried (assumed)."""
MAX_ESTIMATES = 4
"""Largest number of estimates of the initial friction and of the parameters, in turn (assumed)."""
FRACTION_TOLERANCE = 0.05
"""Change of all fractions at which the estimates end (assumed)."""
MIN_REPORTED_FRACTION = 0.2
"""Smallest initial friction that is reported, over all that the device can hold (assumed)."""


class _Estimate(NamedTuple):
    fit: Fit
    """Model with friction, fitted with the initial friction."""
    data: WeightedData
    """Fitted trials with their initial friction."""


def reconsider_initial_friction(
    outcome: Outcome,
    prepare: Callable[[list[Experiment]], Preparation],
    search_model: Callable[[Preparation], Outcome],
) -> tuple[Outcome, list[str]]:
    """Return ``outcome``, or that with an initial friction of each condition where it explains the data to the noise.

    Its remarks follow. ``prepare`` weighs trials and fits the device without added effects to them.
    """
    data, selected = outcome.data, outcome.selected
    is_adequate = selected.verdict in ADEQUATE_VERDICTS and selected.prediction is None
    if is_adequate or data.experiments[0].has_body or data.experiments[0].devices or not has_repeats(data.experiments):
        return outcome, []
    estimates = [
        estimate for fit in _list_models(outcome) if (estimate := _fit_with_initial_friction(data, fit)) is not None
    ]
    if not estimates:
        return outcome, []
    best = min(estimates, key=lambda estimate: estimate.fit.bic(data.n_effective))
    experiments = _estimate_initial_friction(best.data.with_experiments(outcome.experiments), best.fit)
    refined = search_model(prepare(experiments))
    if refined.selected.verdict not in ADEQUATE_VERDICTS or refined.selected.prediction is not None:
        return outcome, []
    return refined, _describe_initial_friction(refined.experiments)


def _list_models(outcome: Outcome) -> list[Fit]:
    """Return the models of ``outcome`` whose device holds a friction: the device alone, the result, then the best."""
    models = {fit.hypothesis.terms: fit for fit in (outcome.base_fit, outcome.selected.final_fit)}
    tried = [fit for step in outcome.search.history for fit in step.refits]
    for fit in sorted(tried, key=lambda fit: fit.bic(outcome.data.n_effective)):
        if len(models) < MAX_MODELS and _holds_friction(outcome.data, fit):
            models.setdefault(fit.hypothesis.terms, fit)
    return [fit for fit in models.values() if _holds_friction(outcome.data, fit)]


def _holds_friction(data: WeightedData, fit: Fit) -> bool:
    if fit.has_diverged:
        return False
    setups = fit.hypothesis.build_setups(fit.x, data.experiments)
    return any(holds_friction(setup.parameters) for setup in setups)


def _fit_with_initial_friction(data: WeightedData, fit: Fit) -> _Estimate | None:
    """Return ``fit`` with estimated initial friction; None where a large part of the misfit is left.

    Chi squared also falls by more than the logarithm of the number of independent samples for each condition, as the
    Bayesian information criterion requires of a parameter.
    """
    residuals = data.compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)[0]
    before = float(np.sum(data.weight_residuals(residuals) ** 2))
    experiments, estimate = _estimate_initial_friction(data, fit), _Estimate(fit, data)
    for _ in range(MAX_ESTIMATES):
        moved = data.with_experiments(experiments)
        estimate = _Estimate(fit_hypothesis(moved, fit.hypothesis, estimate.fit.x), moved)
        if estimate.fit.has_diverged:
            return None
        experiments = _take_joint_step(estimate)
        pairs = zip(experiments, moved.experiments, strict=True)
        if max(abs(new.initial_friction - old.initial_friction) for new, old in pairs) < FRACTION_TOLERANCE:
            break
    gain = before - estimate.fit.chi2
    is_shown = gain > len(group_repeats(data.experiments)) * math.log(data.n_effective)
    is_large = gain >= (1.0 - MAX_MISFIT_FRACTION) * (before - data.n_effective)
    return estimate if is_shown and is_large else None


def _take_joint_step(estimate: _Estimate) -> list[Experiment]:
    """Return the trials with the initial friction that a linear step of it and of all parameters reaches.

    One after the other they would converge slowly, because stiff friction decays as fast as less of it.
    """
    fit, experiments = estimate.fit, list(estimate.data.experiments)
    conditions = list(group_repeats(experiments).values())
    fractions = np.array([experiments[indices[0]].initial_friction for indices in conditions])
    directions = np.where(fractions < 0.0, -1.0, 1.0)
    relaxed, lengthened, shortened = (_simulate_fraction(estimate.data, fit, f) for f in (0.0, 1.0, -1.0))
    lower, upper = fit.hypothesis.bounds()
    columns = [fit.jacobian]
    for indices, direction in zip(conditions, directions, strict=True):
        slid = lengthened if direction > 0.0 else shortened
        column = [np.zeros(len(row)) for row in relaxed]
        for index in indices:
            column[index] = direction * (slid[index] - relaxed[index])
        columns.append(np.concatenate([*column, np.zeros(fit.hypothesis.n_prior_parameters)])[:, np.newaxis])
    # Rows of a weak prior keep the fraction of a condition that hardly depends on it near 0.
    prior = np.hstack([np.zeros((len(conditions), len(fit.x))), np.eye(len(conditions))])
    matrix = np.vstack([np.hstack(columns), prior])
    if not np.isfinite(matrix).all():
        return experiments
    residuals = np.append(fit.weighted_residuals, fractions)
    low, high = np.where(directions > 0.0, 0.0, -1.0), np.where(directions > 0.0, 1.0, 0.0)
    margin = 1e-9  # the solver requires lower < upper, and a start inside
    bounds = np.append(lower - fit.x, low - fractions) - margin, np.append(upper - fit.x, high - fractions) + margin
    step = lsq_linear(matrix, -residuals, bounds=bounds).x[len(fit.x) :]
    return _set_fractions(experiments, np.clip(fractions + step, low, high))


def _estimate_initial_friction(data: WeightedData, fit: Fit) -> list[Experiment]:
    """Return the trials of ``data`` with the initial friction of each condition that agrees best with ``fit``.

    Residuals are interpolated linearly between none and all of the friction, for either direction of the motion.
    """
    relaxed, lengthened, shortened = (_simulate_fraction(data, fit, fraction) for fraction in (0.0, 1.0, -1.0))
    fractions = []
    for indices in group_repeats(data.experiments).values():
        start, *ends = (np.concatenate([rows[i] for i in indices]) for rows in (relaxed, lengthened, shortened))
        sizes = [_minimize_norm(start, end - start) for end in ends]
        costs = [float(np.sum((start + size * (end - start)) ** 2)) for size, end in zip(sizes, ends, strict=True)]
        fractions.append(sizes[0] if costs[0] <= costs[1] else -sizes[1])
    return _set_fractions(data.experiments, fractions)


def _set_fractions(experiments: Sequence[Experiment], fractions: Iterable[float]) -> list[Experiment]:
    """Return ``experiments`` with the initial friction of their condition, in the order of the conditions."""
    changed = list(experiments)
    for indices, fraction in zip(group_repeats(experiments).values(), fractions, strict=True):
        for index in indices:
            changed[index] = replace(experiments[index], initial_friction=float(fraction))
    return changed


def _simulate_fraction(data: WeightedData, fit: Fit, fraction: float) -> list[Array]:
    """Return the weighted residuals of each trial of ``data`` that begins with this ``fraction`` of the friction."""
    return _weight_trials(data.with_experiments([replace(e, initial_friction=fraction) for e in data.experiments]), fit)


def _weight_trials(data: WeightedData, fit: Fit) -> list[Array]:
    """Return the weighted residuals of each trial."""
    (residuals,) = data.compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)
    return [
        np.concatenate([np.zeros(0), *(weight * row[channel] for channel, weight in weights.items())])
        for row, weights in zip(residuals, data.weights, strict=True)
    ]


def _minimize_norm(start: Array, change: Array) -> float:
    """Return the fraction in [0, 1] of ``change`` that leaves the smallest ``start`` + fraction * ``change``."""
    curvature = float(change @ change)
    if not (math.isfinite(curvature) and curvature > 0.0):  # no friction, or a simulation that diverges
        return 0.0
    return min(1.0, max(0.0, -float(start @ change) / curvature))


def _describe_initial_friction(experiments: Sequence[Experiment]) -> list[str]:
    """Return a sentence about the conditions that begin with friction."""
    fractions = {e.group: e.initial_friction for e in experiments if abs(e.initial_friction) >= MIN_REPORTED_FRACTION}
    if not fractions:
        return []
    parts = [
        f"{100.0 * abs(fraction):.0f} % in '{group}' ({'lengthened' if fraction > 0.0 else 'shortened'})"
        for group, fraction in fractions.items()
    ]
    return [
        "The device holds dry friction, and these conditions begin with what an earlier motion left of it. This is "
        f"estimated from each of them, also from the test trials: {', '.join(parts)}. Before each trial, move the "
        "device by several millimetres, always the same way."
    ]
