"""Validation of models: chi squared in trials that no fit has used, or in fitted groups that are left out in turn."""

from collections.abc import Sequence

import numpy as np

from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import group_repeats
from klute_sim.types import Array

MIN_VALIDATION_GAIN = 0.05
"""Minimum relative fall of chi squared on validation trials (assumed: about that of an effect of a quarter of the
noise)."""
MAX_VALIDATION_LOSS = 0.02
"""Maximum relative rise of chi squared in one group of validation trials (assumed)."""
LEFT_OUT_MAX_NFEV = 4
"""Maximum number of function evaluations of a refit without one group (assumed)."""


def compute_validation_chi2(
    data: WeightedData, validation_data: Sequence[WeightedData], fits: Sequence[Fit]
) -> dict[str, list[float]]:
    """Return chi squared of each of ``fits`` to ``data`` in each group that tells about the last term of the last fit.

    Without such groups in ``validation_data``, each fitted group in turn is left out and all models are refitted to the
    others.
    """
    groups = select_validation_data(validation_data, fits[0], fits[-1])
    if not groups:
        return _cross_validate(data, fits, _get_last_specimen(fits[-1]))
    return {group.experiments[0].group: [compute_chi2(group, fit) for fit in fits] for group in groups}


def select_validation_data(validation_data: Sequence[WeightedData], before: Fit, after: Fit) -> list[WeightedData]:
    """Return those groups of ``validation_data`` that tell about the last term of ``after``.

    Only groups of its specimen tell anything about a number of one specimen. Nor do groups where the readings of both
    fits hardly differ: friction does nothing while the muscle is held. A term that explains little of the fitted trials
    explains as little of any group. ``before`` is without the term.
    """
    specimen = _get_last_specimen(after)
    groups = [group for group in validation_data if specimen in (None, group.experiments[0].specimen)]
    if after.chi2 > (1.0 - MIN_VALIDATION_GAIN) * before.chi2:
        return groups
    return [group for group in groups if _differ(group, before, after)]


def _differ(data: WeightedData, before: Fit, after: Fit) -> bool:
    """Return whether the readings of both fits differ enough for a gain, or chi squared rises too much."""
    first, last = (_compute_weighted_residuals(data, fit) for fit in (before, after))
    if not (np.isfinite(first).all() and np.isfinite(last).all()):
        return True
    chi2, difference = float(first @ first), last - first
    is_worse = float(last @ last) > (1.0 + MAX_VALIDATION_LOSS) * chi2
    return is_worse or float(difference @ difference) >= MIN_VALIDATION_GAIN * chi2


def _get_last_specimen(fit: Fit) -> str | None:
    """Return the specimen that alone has the last term of ``fit``; None for a term of all, and without terms."""
    return fit.hypothesis.terms[-1].specimen if fit.hypothesis.terms else None


def _cross_validate(data: WeightedData, fits: Sequence[Fit], specimen: str | None) -> dict[str, list[float]]:
    experiments = data.experiments
    groups = [
        group
        for group, members in group_repeats(experiments).items()
        if specimen in (None, experiments[members[0]].specimen)
    ]
    if len(groups) < 2:  # without its only group, the number would stay as that group has fitted it
        return {}
    chi2 = {}
    for group in groups:
        training = data.with_experiments([e for e in experiments if e.group != group])
        held_out = data.with_experiments([e for e in experiments if e.group == group])
        refits = [fit_hypothesis(training, fit.hypothesis, fit.x, max_nfev=LEFT_OUT_MAX_NFEV) for fit in fits]
        chi2[group] = [compute_chi2(held_out, refit) for refit in refits]
    return chi2


def compute_chi2(data: WeightedData, fit: Fit) -> float:
    """Return chi squared of ``fit`` in the trials of ``data``, without priors; infinite where a simulation diverges."""
    vector = _compute_weighted_residuals(data, fit)
    return float(vector @ vector)


def _compute_weighted_residuals(data: WeightedData, fit: Fit) -> Array:
    (residuals,) = data.compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)
    return data.weight_residuals(residuals)
