"""Evidence for each name of a diagnosis, in numbers that are comparable between datasets."""

from collections.abc import Iterator
from typing import NamedTuple

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.result import Diagnosis


class NameEvidence(NamedTuple):
    """Evidence for one name."""

    gain: float
    """What the final model gains over the one without effects: the fall of BIC, or, where predictions decide, the share
    of the squared error that noise does not explain."""
    margin: float
    """Part of this gain that every examined model without the name misses, 0 to 1."""


def collect_evidence(diagnosis: Diagnosis) -> dict[EffectTerm, NameEvidence]:
    """Return the evidence for each added term of ``diagnosis``; data-driven terms have none.

    Without repeats only predictions tell: noise is estimated again after each effect, so no BIC compares with another.
    """
    terms = [term for term in diagnosis.added_terms if not term.effect_definition.data_driven]
    if diagnosis.final_fit is None or diagnosis.base_fit is None or not terms:
        return {}
    prediction = diagnosis.prediction
    if (
        prediction is not None
        and prediction.chosen.terms
        and prediction.chosen.identities >= {t.identity for t in terms}
    ):
        gain = prediction.base.error - prediction.chosen.error
        errors = [(model.identities, model.error - prediction.chosen.error) for model in prediction.models]
        explained = prediction.share
    elif not diagnosis.has_repeats:
        return {}
    else:
        n, best_bic = diagnosis.n_independent, diagnosis.final_fit.bic(diagnosis.n_independent)
        gain = explained = diagnosis.base_fit.bic(n) - best_bic
        errors = [(fit.identities, fit.bic(n) - best_bic) for fit in _iter_fits(diagnosis)]
    evidence = {}
    for term in terms:
        excesses = [excess for identities, excess in errors if term.identity not in identities]
        margin = min([gain, *excesses]) / gain if gain > 0.0 else 0.0
        evidence[term] = NameEvidence(explained, min(1.0, max(0.0, margin)))
    return evidence


def _iter_fits(diagnosis: Diagnosis) -> Iterator[Fit]:
    """Yield all models that were fitted to the same data with the same noise."""
    for step in diagnosis.selection_history:
        yield step.initial_fit
        yield from step.refits
    for model in diagnosis.equivalent_models:
        yield model.fit
