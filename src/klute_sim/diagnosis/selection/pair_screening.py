"""Screening of pairs of candidate effects: two effects that explain little alone may explain much together."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.fitting.hypothesis import Identity
from klute_sim.diagnosis.fitting.least_squares import Fit, complete_fit
from klute_sim.diagnosis.selection.candidates import is_same_cause
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.screening import Candidate, screen_candidates

MIN_DETERMINANT = 0.05
"""Smallest determinant of a pair's cosines; below, the two effects are one to these data (assumed)."""
MAX_REFITTED_PAIRS = 6
"""Largest number of pairs that are refitted."""
PAIR_MAX_NFEV = (5,)
"""Maximum number of function evaluations of these refits."""


class CandidatePair(NamedTuple):
    """Two effects that may be added together."""

    first: Candidate
    """The effect that explains more alone."""
    second: Candidate
    """The other one."""
    predicted_gain: float
    """Fall of chi squared that linearisation predicts."""


def screen_pairs(base_fit: Fit, candidates: Sequence[Candidate]) -> list[CandidatePair]:
    """Return pairs of ``candidates``, largest predicted fall of chi squared first, the better one of each pair first.

    By linearisation at ``base_fit``: the sensitivities orthogonal to the fitted parameters are projected together. A
    pair of equal effects, and one in which an effect would have a sign that it cannot have, is omitted.
    """
    if len(candidates) < 2:
        return []
    directions = np.array([c.direction for c in candidates])
    cosines = directions @ directions.T
    projections = -directions @ base_fit.weighted_residuals
    best: dict[frozenset[Identity], tuple[float, int, int]] = {}
    for i in range(len(candidates)):
        for k in range(i + 1, len(candidates)):
            first, second = candidates[i], candidates[k]
            determinant = 1.0 - cosines[i, k] ** 2
            if is_same_cause(first.term, second.term) or determinant < MIN_DETERMINANT:
                continue
            a = (projections[i] - cosines[i, k] * projections[k]) / determinant
            b = (projections[k] - cosines[i, k] * projections[i]) / determinant
            if not (_is_allowed(first, a) and _is_allowed(second, b)):
                continue
            gain = float(a * projections[i] + b * projections[k])
            key = frozenset([first.term.identity, second.term.identity])
            if key not in best or gain > best[key][0]:
                best[key] = gain, i, k
    ordered = sorted(best.values(), key=lambda entry: (-entry[0], entry[1:]))
    return [
        CandidatePair(candidates[i], candidates[k], gain)
        if candidates[i].predicted_gain >= candidates[k].predicted_gain
        else CandidatePair(candidates[k], candidates[i], gain)
        for gain, i, k in ordered
    ]


def _is_allowed(candidate: Candidate, amount: float) -> bool:
    """Return whether ``amount`` along the candidate's direction has a sign that its first parameter may have."""
    parameter = candidate.term.parameters[0]
    if parameter.neutral is None or candidate.term.number:
        return True
    scale = parameter.typical - parameter.neutral
    room = parameter.upper - parameter.neutral if amount * scale > 0.0 else parameter.neutral - parameter.lower
    return room > 0.0


def has_adequate_pair(search: ForwardSelection, base_fit: Fit, min_predicted_gain: float) -> bool:
    """Return whether two effects together explain the data of ``search`` to the noise between repeats.

    Pairs are refitted whose predicted fall of chi squared from ``base_fit`` is at least ``min_predicted_gain``, best
    first and up to :data:`MAX_REFITTED_PAIRS`.
    """
    candidates = search.history[0].candidates
    pairs = [pair for pair in screen_pairs(base_fit, candidates) if pair.predicted_gain >= min_predicted_gain]
    for pair in pairs[:MAX_REFITTED_PAIRS]:
        first_fit = _refit(search, base_fit, [pair.first])[0]
        if first_fit.has_diverged:
            continue
        # Beside the first effect, the second one begins elsewhere than alone.
        second = screen_candidates(search.data, first_fit, [pair.second.term])
        fits = _refit(search, first_fit, second)
        if any(not fit.has_diverged and not search.has_misfit(fit) for fit in fits):
            return True
    return False


def _refit(search: ForwardSelection, current: Fit, candidates: Sequence[Candidate]) -> list[Fit]:
    fits = search.refit_candidates(current, candidates, max_nfev_by_round=PAIR_MAX_NFEV)
    return [complete_fit(search.data, fit) for fit in fits]
