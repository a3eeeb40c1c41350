"""Effects of a model that may be absent: their 95 % interval contains the value without effect."""

from collections.abc import Sequence

import numpy as np

from klute_sim.diagnosis.final_model import FinalModel
from klute_sim.diagnosis.fitting.confidence_intervals import compute_confidence_intervals
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.localization.equation_residuals import compute_equation_residuals
from klute_sim.diagnosis.selection.refits import refit_without_term
from klute_sim.diagnosis.selection.robustness import check_convergence


def find_term_without_effect(fit: Fit, intervals: Sequence[tuple[float, float]]) -> tuple[EffectTerm, float] | None:
    """Return a term of ``fit`` whose only parameter may be the value without effect, and this value.

    That of a wrong number is the declared one. ``intervals`` hold the 95 % interval of each parameter. They follow from
    the differences between repeats or conditions, so they may contain that value although the fit is much better with
    the term. Returns None without such a term.
    """
    rows = list(zip(fit.hypothesis.parameters, intervals, strict=True))
    for index, term in enumerate(fit.hypothesis.terms):
        term_rows = [(parameter, interval) for parameter, interval in rows if parameter.term_index == index]
        if len(term_rows) != 1:
            continue
        parameter, (low, high) = term_rows[0]
        if not parameter.is_logarithmic and low <= parameter.initial <= high:  # a shape has no value without effect
            return term, parameter.initial
    return None


def remove_absent_effects(selected: FinalModel, seed: int) -> FinalModel:
    """Return ``selected`` without effects whose interval contains their absence; then the names are a part.

    If such an effect is the only one, it stays as a proxy. With an imperfect law the intervals hold the scatter of the
    effect between conditions, and predictions decide. ``seed`` is that of the restart of the fit without them.
    """
    absent = find_term_without_effect(selected.final_fit, selected.confidence_intervals)
    if absent is None or selected.verdict != "identified":
        return selected
    reasons = []
    while absent is not None:
        term, neutral = absent
        value = "declared value" if term.number else "value without effect"
        is_only = len(selected.final_fit.hypothesis.terms) == 1
        reasons.append(
            f"{term} {'is a proxy' if is_only else 'was found, too, and is left out'}: its 95 % "
            f"interval contains the {value}, {neutral:.4g}, because the repeats disagree about it by more than it is. "
            "More repeats, or larger motion and pressure steps, would tell."
        )
        if is_only:
            return selected._replace(verdict="unexplained", reasons=[*reasons, *selected.reasons])
        known = [reason for reason in selected.reasons if not reason.startswith(f"{term}: ")]
        selected = selected._replace(reasons=known)  # why a term was added is of no interest once it is left out
        reduced_fit = refit_without_term(selected.data, selected.final_fit, term)
        fit, has_converged = check_convergence(selected.data, reduced_fit, np.random.default_rng(seed))
        intervals = compute_confidence_intervals(selected.data, fit)
        selected = selected._replace(
            final_fit=fit,
            confidence_intervals=intervals,
            equation_residuals=compute_equation_residuals(selected.data, fit),
            has_converged=has_converged,
            absent_terms=(*selected.absent_terms, term),
        )
        absent = find_term_without_effect(fit, intervals)
    return selected._replace(verdict="identified-in-part", reasons=[*reasons, *selected.reasons])
