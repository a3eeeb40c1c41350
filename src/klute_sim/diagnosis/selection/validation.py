"""Validation of models: chi squared in trials that no fit has used, or in fitted groups that are left out in turn."""

from collections.abc import Sequence

from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import group_repeats

LEFT_OUT_MAX_NFEV = 4
"""Maximum number of function evaluations of a refit without one group (assumed)."""


def compute_validation_chi2(
    data: WeightedData, validation_data: Sequence[WeightedData], fits: Sequence[Fit]
) -> dict[str, list[float]]:
    """Return chi squared of each of ``fits`` to ``data`` in each group of ``validation_data``.

    Without validation trials, each fitted group in turn is left out and all models are refitted to the others.
    Only groups of its specimen tell anything about a number of one specimen, the last term of the last fit.
    """
    specimen = fits[-1].hypothesis.terms[-1].specimen if fits[-1].hypothesis.terms else None
    relevant = [each for each in validation_data if specimen in (None, each.experiments[0].specimen)]
    if not relevant:
        return _cross_validate(data, fits, specimen)
    return {each.experiments[0].group: [compute_chi2(each, fit) for fit in fits] for each in relevant}


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
    (residuals,) = data.compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)
    vector = data.weight_residuals(residuals)
    return float(vector @ vector)
