"""Doubting the answer: would less do, does it come back from elsewhere, and could it be something else."""

from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, fit_hypothesis
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection, refit_without_term, select_shortlist
from klute_sim.diagnosis.selection.screening import screen_candidates

MAX_REPLACEMENTS = 5
"""Candidates that are tried in a term's place."""
RESTART_SIGMAS = 3.0
CHI2_TOLERANCE = 1.0
"""Difference of chi squared by which two fits are the same."""


class EquivalentModel(NamedTuple):
    """Another set of effects that the data cannot tell from the one that was found."""

    fit: Fit
    replaces: EffectTerm
    bic_difference: float
    """Of BIC; positive: a little worse than what was found."""


def find_smaller_model(search: ForwardSelection, best_fit: Fit) -> Fit | None:
    """A set with one term less that does as well as ``found``: one of its terms, and another in place of the rest.

    Two proxies that were taken one after the other are found out by that. None if there is no such set, or if
    ``found`` has less than three terms: with two, every single one has been tried before.
    """
    evidence, terms = search.data, best_fit.hypothesis.terms
    if len(terms) < 3:
        return None
    most = best_fit.bic(evidence.n_effective) + search.bic_threshold
    sets = []
    for kept in terms:
        less = best_fit
        for term in terms:
            if term != kept:
                less = refit_without_term(evidence, less, term)
        for refit in _refit_replacements(search, less, best_fit, most):
            if refit.bic(evidence.n_effective) <= most and not search.rejection_reason(
                less, refit, search.compute_validation_gains(less, refit)
            ):
                sets.append(refit)
    return min(sets, key=lambda one: one.bic(evidence.n_effective), default=None)


def _refit_replacements(search: ForwardSelection, reduced_fit: Fit, best_fit: Fit, bic_goal: float) -> list[Fit]:
    """``less`` with one more term each, refitted, of those that promise half of what ``found`` has over it."""
    taken = {(t.effect, t.channel) for t in reduced_fit.hypothesis.terms}
    open_ = [t for t in search.candidate_terms if (t.effect, t.channel) not in taken]
    promising = [
        c
        for c in screen_candidates(search.data, reduced_fit, open_)
        if c.predicted_gain > 0.5 * (reduced_fit.chi2 - best_fit.chi2)
    ]
    return (
        search.refit_candidates(reduced_fit, select_shortlist(promising)[:MAX_REPLACEMENTS], bic_goal)
        if promising
        else []
    )


def find_equivalent_models(search: ForwardSelection, best_fit: Fit) -> list[EquivalentModel]:
    """Sets with one of the terms of ``found`` exchanged that are within a decisive difference of BIC, or better.

    Only those that would have been accepted themselves: trials that were not fitted must gain from them, too.
    """
    evidence, best = search.data, best_fit.bic(search.data.n_effective)
    result = []
    for term in best_fit.hypothesis.terms:
        known = next(
            (s for s in search.history if s.added_term == term and s.refits[0].hypothesis == best_fit.hypothesis), None
        )
        if known is not None and search.has_repeats:  # else it has been weighed anew since
            less, refits = known.initial_fit, known.refits
        else:
            less = refit_without_term(evidence, best_fit, term)
            refits = tuple(_refit_replacements(search, less, best_fit, best))
        for refit in refits:
            other, difference = refit.hypothesis.terms[-1], refit.bic(evidence.n_effective) - best
            if (other.effect, other.channel) == (term.effect, term.channel) or difference > search.bic_threshold:
                continue
            if not search.rejection_reason(less, refit, search.compute_validation_gains(less, refit)):
                result.append(EquivalentModel(refit, term, difference))
    return sorted(result, key=lambda rival: rival.bic_difference)


def check_convergence(data: WeightedData, best_fit: Fit, rng: np.random.Generator) -> tuple[Fit, bool]:
    """``found`` finished finely, or a better fit near it, and whether fits from elsewhere come back to it.

    Elsewhere is :data:`AWAY` standard errors or more from where it is, in every unknown, as far as bounds allow.
    """
    if not len(best_fit.x):
        return best_fit, best_fit.converged
    best_fit = fit_hypothesis(data, best_fit.hypothesis, best_fit.x, fine=True)
    # Of unknowns that the data hardly hold, rounding may leave a variance below zero.
    errors = np.sqrt(np.maximum(0.0, np.diag(np.linalg.pinv(best_fit.jacobian.T @ best_fit.jacobian))))
    away = rng.choice([-1.0, 1.0], len(errors)) * np.maximum(RESTART_SIGMAS * errors, 0.02)
    again = fit_hypothesis(data, best_fit.hypothesis, best_fit.x + away)
    sure = best_fit.converged and again.converged and abs(again.chi2 - best_fit.chi2) < CHI2_TOLERANCE
    if again.chi2 < best_fit.chi2 - CHI2_TOLERANCE:
        best_fit = fit_hypothesis(data, best_fit.hypothesis, again.x, fine=True)
    return best_fit, sure
