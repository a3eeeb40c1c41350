"""Search for one specimen of which a number is wrong, where no model of all specimens reaches the noise.

Specimens that are made alike share their missing effects, but each was cut, crimped and measured by itself. One wrong
number of one specimen leaves a misfit that no effect of all specimens explains.
"""

from dataclasses import replace

from klute_sim.diagnosis.fitting.bic import format_bic_drop
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.selection.candidates import list_further_terms
from klute_sim.diagnosis.selection.forward_selection import REFIT_MAX_NFEV, ForwardSelection
from klute_sim.diagnosis.selection.screening import Candidate, screen_candidates
from klute_sim.diagnosis.selection.selection_step import SelectionStep

MIN_GAIN_FRACTION = 0.8
"""Smallest predicted fraction of what a model leaves above the noise that a number of one specimen must take to be
fitted (assumed: the prediction is linear)."""
MAX_REFITS = 3
"""Largest number of numbers of specimens that are fitted beside each model."""


def find_deviating_specimen(search: ForwardSelection, numbers: list[EffectTerm]) -> ForwardSelection | None:
    """Return ``search`` with a last step that reaches the noise; None where there is none.

    The step adds an error of one number of one specimen, among ``numbers``, to a model of the history of ``search``,
    which has found no model that reaches the noise.
    """
    for index, step in enumerate(search.history):
        current = step.initial_fit
        excess = current.chi2 - search.data.n_effective
        search.report_stage("trying numbers of single specimens")
        candidates = screen_candidates(search.data, current, list_further_terms(numbers, current))
        promising = [candidate for candidate in candidates if candidate.predicted_gain > MIN_GAIN_FRACTION * excess]
        extended = _extend(search, current, promising[:MAX_REFITS])
        if extended is not None:
            history = [*search.history[:index], extended]
            terms = [*search.candidate_terms, *numbers]
            return replace(search, candidate_terms=terms, history=history)
    return None


def _extend(search: ForwardSelection, current: Fit, candidates: list[Candidate]) -> SelectionStep | None:
    """Return the step that adds the best of ``candidates`` to ``current``; None if none reaches the noise."""
    refits = search.refit_candidates(current, candidates) if candidates else []
    for preliminary in refits:
        refit = fit_hypothesis(search.data, preliminary.hypothesis, preliminary.x, max_nfev=REFIT_MAX_NFEV[1])
        gains = search.compute_validation_gains(current, refit)
        if search.has_misfit(refit) or search.rejection_reason(current, refit, gains):
            continue
        term = refit.hypothesis.terms[-1]
        drop = current.bic(search.data.n_effective) - refit.bic(search.data.n_effective)
        reason = f"BIC {format_bic_drop(drop)}; no effect of all specimens explains what '{term.specimen}' deviates by"
        ordered = (refit, *(other for other in refits if other is not preliminary))
        return SelectionStep(current, tuple(candidates), ordered, term, gains, reason)
    return None
