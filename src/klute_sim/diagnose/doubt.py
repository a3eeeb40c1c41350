"""Doubting the answer: would less do, does it come back from elsewhere, and could it be something else."""

from typing import NamedTuple

import numpy as np

from klute_sim.diagnose.fit import Evidence, Fit, fit
from klute_sim.diagnose.hypothesis import Term
from klute_sim.diagnose.screen import screen
from klute_sim.diagnose.search import Search, drop, shortlist

MOST = 5
"""Candidates that are tried in a term's place."""
AWAY = 3.0
SAME = 1.0
"""Difference of chi squared by which two fits are the same."""


class Rival(NamedTuple):
    """Another set of effects that the data cannot tell from the one that was found."""

    fit: Fit
    replaces: Term
    difference: float
    """Of BIC; positive: a little worse than what was found."""


def fewer(search: Search, found: Fit) -> Fit | None:
    """A set with one term less that does as well as ``found``: one of its terms, and another in place of the rest.

    Two proxies that were taken one after the other are found out by that. None if there is no such set, or if
    ``found`` has less than three terms: with two, every single one has been tried before.
    """
    evidence, terms = search.evidence, found.hypothesis.terms
    if len(terms) < 3:
        return None
    most = found.criterion(evidence.effective) + search.decisive
    sets = []
    for kept in terms:
        less = found
        for term in terms:
            if term != kept:
                less = drop(evidence, less, term)
        for refit in _others(search, less, found, most):
            if refit.criterion(evidence.effective) <= most and not search.objection(
                less, refit, search.gains(less, refit)
            ):
                sets.append(refit)
    return min(sets, key=lambda one: one.criterion(evidence.effective), default=None)


def _others(search: Search, less: Fit, found: Fit, goal: float) -> list[Fit]:
    """``less`` with one more term each, refitted, of those that promise half of what ``found`` has over it."""
    taken = {(t.effect, t.channel) for t in less.hypothesis.terms}
    open_ = [t for t in search.candidates if (t.effect, t.channel) not in taken]
    promising = [c for c in screen(search.evidence, less, open_) if c.gain > 0.5 * (less.cost - found.cost)]
    return search.refit(less, shortlist(promising)[:MOST], goal) if promising else []


def rivals(search: Search, found: Fit) -> list[Rival]:
    """Sets with one of the terms of ``found`` exchanged that are within a decisive difference of BIC, or better.

    Only those that would have been accepted themselves: trials that were not fitted must gain from them, too.
    """
    evidence, best = search.evidence, found.criterion(search.evidence.effective)
    result = []
    for term in found.hypothesis.terms:
        known = next((s for s in search.steps if s.added == term and s.refits[0].hypothesis == found.hypothesis), None)
        if known is not None and search.repeated:  # else it has been weighed anew since
            less, refits = known.before, known.refits
        else:
            less = drop(evidence, found, term)
            refits = tuple(_others(search, less, found, best))
        for refit in refits:
            other, difference = refit.hypothesis.terms[-1], refit.criterion(evidence.effective) - best
            if (other.effect, other.channel) == (term.effect, term.channel) or difference > search.decisive:
                continue
            if not search.objection(less, refit, search.gains(less, refit)):
                result.append(Rival(refit, term, difference))
    return sorted(result, key=lambda rival: rival.difference)


def certified(evidence: Evidence, found: Fit, random: np.random.Generator) -> tuple[Fit, bool]:
    """``found`` finished finely, or a better fit near it, and whether fits from elsewhere come back to it.

    Elsewhere is :data:`AWAY` standard errors or more from where it is, in every unknown, as far as bounds allow.
    """
    if not len(found.steps):
        return found, found.converged
    found = fit(evidence, found.hypothesis, found.steps, fine=True)
    # Of unknowns that the data hardly hold, rounding may leave a variance below zero.
    errors = np.sqrt(np.maximum(0.0, np.diag(np.linalg.pinv(found.jacobian.T @ found.jacobian))))
    away = random.choice([-1.0, 1.0], len(errors)) * np.maximum(AWAY * errors, 0.02)
    again = fit(evidence, found.hypothesis, found.steps + away)
    sure = found.converged and again.converged and abs(again.cost - found.cost) < SAME
    if again.cost < found.cost - SAME:
        found = fit(evidence, found.hypothesis, again.steps, fine=True)
    return found, sure
