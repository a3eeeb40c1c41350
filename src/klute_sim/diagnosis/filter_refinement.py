"""Low-pass filters, corrected within the uncertainty that the noise leaves.

Short records and coloured noise show a cut-off frequency to a tenth only, and such an error looks like a missing effect
wherever a force jumps. The signals show it much better, but effects that are missing move it. So it is accepted only
where nothing is missing with it, or nothing beside the effects that are named. The signals also show whether a filter
has a delay and whether the channel is late to the inputs, because such a delay is large beside the effects.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from klute_sim.diagnosis.command_interpolation import Outcome, Preparation
from klute_sim.diagnosis.data_quality import has_repeats
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.channel_filter import ChannelFilter, Filters
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.misfit import has_misfit
from klute_sim.diagnosis.result import Verdict
from klute_sim.diagnosis.selection.naming import DELAY_EFFECTS
from klute_sim.diagnosis.selection.refits import refit_without_term
from klute_sim.types import Array

CUTOFF_DEVIATION = 0.1
"""Standard deviation of the logarithm of a cut-off frequency that the noise shows (assumed: records of 5 s)."""
LOG_CUTOFF_STEP = 0.04
"""Difference between the logarithms of two cut-off frequencies that are tried first."""
LOG_CUTOFF_FACTORS = LOG_CUTOFF_STEP * np.arange(-7, 8)
"""Logarithms of the cut-off frequencies that are tried first, over the one that the noise shows."""
LOG_CUTOFF_TOLERANCE = 1e-3
"""Accuracy of the logarithm of the best cut-off frequency."""
MAX_COST_RATIO = 0.5
"""Largest ratio of the misfit of a channel with filters of another kind to that with the likeliest ones (assumed)."""
ADEQUATE_VERDICTS: tuple[Verdict, ...] = "nothing-missing", "identified", "indistinguishable"
"""Verdicts of a model that may explain the data to the noise."""
MIN_COST_GAIN = 10.0
"""Smallest fall of the misfit by other cut-off frequencies for which the model is fitted again (assumed)."""
MAX_REFINEMENTS = 3
"""Largest number of such fits (assumed)."""


class _Candidate(NamedTuple):
    detected: Filters
    """Filters with the cut-off frequencies that the noise shows."""
    detected_costs: Mapping[str, float]
    """Channel -> sum of its squared weighted residuals with the detected filters."""
    detected_cost: float
    """Chi squared with the detected filters."""
    refined: Filters
    """Filters with the cut-off frequencies that the signals show."""
    refined_cost: float
    """Chi squared with the refined filters, and the squared deviation of the cut-off frequency."""


def refine_filters(
    preparation: Preparation, prepare: Callable[[list[Experiment]], Preparation], others: Sequence[Filters]
) -> Preparation:
    """Return ``preparation`` with other cut-off frequencies, by the same factor, where nothing is missing with them.

    ``others`` are filters of another kind or order that the noise permits, some of them with delay. They are compared
    only where something is missing, and taken where nothing is missing with them, or where they explain the signals
    much better. ``prepare`` weighs trials and fits the device without added effects to them.
    """
    detected = collect_filters(preparation.data)
    if not (detected and has_repeats(preparation.data.experiments)):
        return preparation
    has_misfit_before = _has_misfit(preparation)
    tried = [detected, *others] if has_misfit_before else [detected]
    candidates = [
        _compare_cutoffs(preparation.data, preparation.base_fit, filters) for filters in tried + _list_aligned(tried)
    ]
    best = min(candidates, key=lambda candidate: candidate.refined_cost)
    if not has_misfit_before and candidates[0].detected_cost - best.refined_cost < MIN_COST_GAIN:
        return preparation
    for _ in range(MAX_REFINEMENTS):
        refined = prepare([_replace_filters(e, best.refined) for e in preparation.experiments])
        if not _has_misfit(refined):
            return refined
        best = _compare_cutoffs(refined.data, refined.base_fit, best.refined)
        if best.detected_cost - best.refined_cost < MIN_COST_GAIN:
            break
    best = min(candidates, key=lambda candidate: candidate.detected_cost)
    if not _explains_much_more(best, candidates[0]):
        return preparation
    return prepare([_replace_filters(e, best.detected) for e in preparation.experiments])


def _explains_much_more(candidate: _Candidate, current: _Candidate) -> bool:
    """Return whether ``candidate`` leaves much less of a channel than the ``current`` filters: other channels may have
    the misfit of large effects.
    """
    costs = current.detected_costs
    return any(cost <= MAX_COST_RATIO * costs[channel] for channel, cost in candidate.detected_costs.items())


def reconsider_filters(
    outcome: Outcome,
    prepare: Callable[[list[Experiment]], Preparation],
    search_model: Callable[[Preparation], Outcome],
    permitted: Sequence[Filters],
) -> Outcome:
    """Return ``outcome``, or that with the filters which its model shows, where it explains the data to the noise.

    Those are filters with other cut-off frequencies, or others of those that the noise has ``permitted``: effects that
    were missing have decided, too. A lag or another clock of a filtered channel may be an error of its filter.
    """
    current, selected = collect_filters(outcome.data), outcome.selected
    filtered = {channel for filters in (current, *permitted) for channel in filters}
    delays = [t for t in outcome.terms if t.effect in DELAY_EFFECTS and t.channel in filtered]
    is_adequate = selected.verdict in ADEQUATE_VERDICTS
    if not filtered or (is_adequate and not delays):
        return outcome
    fit = selected.final_fit
    for term in delays:
        fit = refit_without_term(selected.data, fit, term)
    tried = [current, *(filters for filters in permitted if filters != current)]
    candidates = [_compare_cutoffs(selected.data, fit, filters) for filters in tried + _list_aligned(tried)]
    best = min(candidates, key=lambda candidate: candidate.refined_cost)
    if candidates[0].detected_cost - best.refined_cost < MIN_COST_GAIN:
        return outcome
    refined = search_model(prepare([_replace_filters(e, best.refined) for e in outcome.experiments]))
    if refined.selected.verdict not in ADEQUATE_VERDICTS:
        return outcome
    n_delays = sum(t.effect in DELAY_EFFECTS and t.channel in filtered for t in refined.terms)
    return refined if n_delays < len(delays) or not is_adequate else outcome


def collect_filters(data: WeightedData) -> dict[str, ChannelFilter]:
    """Return channel -> the filter that it went through in the trials of ``data``."""
    return dict(item for e in data.experiments for item in e.filters.items())


def _list_aligned(candidates: Sequence[Filters]) -> list[Filters]:
    """Return the variants of ``candidates`` whose channels are not late, without those that ``candidates`` contain."""
    aligned = [{c: applied.align() for c, applied in filters.items()} for filters in candidates]
    return [filters for filters in aligned if filters not in candidates]


def _compare_cutoffs(data: WeightedData, fit: Fit, filters: Filters) -> _Candidate:
    """Return ``filters`` with the cut-off frequencies that agree best with ``fit``."""

    def compute_cost(log_factor: float) -> float:
        residuals = _compute_residuals(data, fit, _scale_cutoffs(filters, log_factor))
        return float(residuals @ residuals) + (log_factor / CUTOFF_DEVIATION) ** 2

    detected = _compute_residuals(data, fit, filters)
    costs = dict.fromkeys(data.noise, 0.0)
    for row, weights in zip(data.split_weighted_residuals(detected), data.weights, strict=True):
        for channel, weight in weights.items():
            costs[channel] += float(np.sum((weight * row[channel]) ** 2))
    detected_cost = float(detected @ detected)
    if _scale_cutoffs(filters, LOG_CUTOFF_STEP) == filters:  # windows, which the noise shows exactly
        return _Candidate(filters, costs, detected_cost, filters, detected_cost)
    nearest = min(LOG_CUTOFF_FACTORS, key=compute_cost)
    bounds = nearest - LOG_CUTOFF_STEP, nearest + LOG_CUTOFF_STEP
    minimum = minimize_scalar(compute_cost, bounds=bounds, method="bounded", options={"xatol": LOG_CUTOFF_TOLERANCE})
    return _Candidate(filters, costs, detected_cost, _scale_cutoffs(filters, float(minimum.x)), float(minimum.fun))


def _compute_residuals(data: WeightedData, fit: Fit, filters: Filters) -> Array:
    """Return the weighted residuals of ``fit`` with ``filters``, after one linear step of all its parameters.

    The parameters of ``fit`` have taken a part of the error of its own filters.
    """
    filtered = data.with_experiments([_replace_filters(e, filters) for e in data.experiments])
    (residuals,) = filtered.compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)
    weighted = np.append(data.weight_residuals(residuals), data.compute_prior_residuals(fit.hypothesis, fit.x))
    if not np.isfinite(weighted).all():  # a simulation diverges
        return weighted
    return np.asarray(weighted - fit.jacobian @ np.linalg.lstsq(fit.jacobian, weighted)[0])


def _scale_cutoffs(filters: Filters, log_factor: float) -> Filters:
    return {channel: applied.scale_cutoff(float(np.exp(log_factor))) for channel, applied in filters.items()}


def _replace_filters(experiment: Experiment, filters: Filters) -> Experiment:
    return replace(experiment, filters=filters)


def _has_misfit(preparation: Preparation) -> bool:
    """Return whether repeats show a misfit of any channel without added effects."""
    data = preparation.data
    return has_misfit(data.experiments, preparation.base_fit.residuals, data.noise)
