"""Candidate effects that a diagnosis rejected, each with the reason."""

from dataclasses import dataclass, replace

import numpy as np

from klute_sim.diagnosis.fitting.bic import format_bic_drop
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Identity
from klute_sim.diagnosis.imperfect_law import FOLD_WORDS
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.diagnosis.selection.forward_selection import DIVERGENCE_REASON
from klute_sim.diagnosis.selection.predictive_model import PredictiveModel, PredictiveResult, compare_errors
from klute_sim.diagnosis.selection.selection_step import SelectionStep

LAST_SCREENING_SEPARATOR = "; after that, "
"""Words between the reason of the fit and that of the last screening."""


@dataclass(frozen=True)
class Rejection:
    """A candidate effect that is not in the final model."""

    term: EffectTerm
    """The effect in its best form."""
    reason: str
    """Reason for the rejection, without a full stop."""
    is_fitted: bool = True
    """Whether the candidate was fitted; otherwise the screening alone judged it."""


def list_rejections(diagnosis: Diagnosis) -> list[Rejection]:
    """Return every candidate that is not in the final model, the most promising first.

    A candidate has the reason of the last step of the selection in which it was considered, or of the selection by
    prediction, which decides after it. One that was fitted before, and that later steps only screened, has both
    reasons. Of several forms of an effect, the one counts that came furthest.
    """
    added = {term.identity for term in diagnosis.added_terms}
    equivalent = {
        term.identity for model in diagnosis.equivalent_models for term in diagnosis.list_added_terms(model.fit)
    }
    rejections: dict[Identity, Rejection] = {}
    for step in diagnosis.selection_history:
        for key, rejection in _explain_step(step, diagnosis.n_independent).items():
            earlier = rejections.get(key)
            if earlier is not None and earlier.is_fitted and not rejection.is_fitted:
                rejection = replace(
                    earlier,
                    reason=f"{earlier.reason.split(LAST_SCREENING_SEPARATOR)[0]}{LAST_SCREENING_SEPARATOR}{rejection.reason}",
                )
            rejections[key] = rejection
        if step.added_term is not None:
            rejections[step.added_term.identity] = Rejection(step.added_term, _explain_removal(diagnosis))
    for term in diagnosis.absent_terms:
        reason = "it was found, too, but its 95 % interval contains its absence: the repeats do not prove it"
        rejections[term.identity] = Rejection(term, reason)
    if diagnosis.prediction is not None:
        rejections |= _explain_prediction(diagnosis.prediction)
    for key in equivalent & rejections.keys():
        reason = "a set of effects that contains it explains the data as well, or nearly so (see alternatives)"
        rejections[key] = Rejection(rejections[key].term, reason)
    return [rejection for key, rejection in rejections.items() if key not in added]


def _explain_removal(diagnosis: Diagnosis) -> str:
    """Return why an effect that the forward selection added is not in the final model."""
    if diagnosis.prediction is not None:
        return "it was added first, but predictions of left-out data decide, and the chosen model does not contain it"
    if any(term.effect_definition.data_driven for term in diagnosis.added_terms):
        return "it was added first, but a data-driven term took its place"
    return "it was added first, but the final model explains the data as well without it"


def _explain_step(step: SelectionStep, n_independent: float) -> dict[Identity, Rejection]:
    """Return the rejection of each candidate of ``step``: tested first, then fitted, then screened ones."""
    rejections: dict[Identity, Rejection] = {}
    for term, reason in step.rejections.items():
        rejections.setdefault(term.identity, Rejection(term, reason))
    initial_bic = step.initial_fit.bic(n_independent)
    gains = {fit.hypothesis.terms[-1]: initial_bic - fit.bic(n_independent) for fit in step.refits}
    has_converged = {fit.hypothesis.terms[-1]: fit.converged for fit in step.refits}
    for term, gain in gains.items():
        if not np.isfinite(gain):
            rejections.setdefault(term.identity, Rejection(term, DIVERGENCE_REASON))
            continue
        reason = f"other candidates fit better: with it, BIC {format_bic_drop(gain, 1)}"
        if not has_converged[term]:
            reason += " (its fit was stopped early)"
        if step.added_term is not None:
            reason += f"; with {step.added_term}, it {format_bic_drop(gains[step.added_term], 1)}"
        rejections.setdefault(term.identity, Rejection(term, reason))
    for candidate in step.candidates:
        reason = (
            "the screening predicts too small an improvement: it would lower chi squared by "
            f"{max(candidate.predicted_gain, 0.0):.1f}"
        )
        rejections.setdefault(candidate.term.identity, Rejection(candidate.term, reason, is_fitted=False))
    return rejections


def _explain_prediction(prediction: PredictiveResult) -> dict[Identity, Rejection]:
    """Return the rejection of each term of the models that predict left-out data, by the best model that has it."""
    rejections: dict[Identity, Rejection] = {}
    for model in prediction.models:
        ratio = compare_errors(model, prediction.base)
        outcome = "a simulation diverges in a prediction"
        if ratio is not None:
            outcome = f"the squared error of prediction changes by {100.0 * (ratio - 1.0):+.3g} %"
        for term in model.terms:
            others = " and ".join(str(other) for other in model.terms if other != term)
            reason = f"with {others} {outcome}" if others else outcome
            if ratio is not None:
                reason += f"; {model.obstacle or _explain_choice(model, prediction)}"
            rejections.setdefault(term.identity, Rejection(term, reason))
    return rejections


def _explain_choice(model: PredictiveModel, prediction: PredictiveResult) -> str:
    """Return why ``model``, which may be named, was not chosen, without a full stop."""
    chosen = prediction.chosen
    difference = (chosen.error - model.error) / prediction.base.error
    if not difference > 0.0:
        return "the chosen model predicts as well or better"
    if len(model.terms) <= len(chosen.terms):
        return f"too few of the selections without one {FOLD_WORDS[prediction.fold_kind]} choose it again"
    return (
        f"the chosen model has fewer effects, and its squared error is larger by {100.0 * difference:.2g} % of that "
        "without added effects: too small or too uncertain a gain for a further effect, or other models reach it, too"
    )
