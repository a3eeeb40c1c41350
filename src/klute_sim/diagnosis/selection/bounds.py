"""Simpler forms of effects that have a parameter at its bound: the data do not determine the shape."""

from collections.abc import Sequence

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, fit_hypothesis
from klute_sim.diagnosis.selection.forward_selection import refit_with_replacement
from klute_sim.diagnosis.selection.naming import find_terms_at_bound


def simplify_terms(data: WeightedData, fit: Fit, terms: Sequence[EffectTerm]) -> Fit:
    """Return ``fit`` with each effect of ``terms`` in its simplest form; ``fit`` itself where all are simple."""
    for term in terms:
        forms = sorted(term.effect_definition.forms, key=lambda form: len(form.parameters))
        if term.number is None and len(forms[0].parameters) < len(term.parameters):
            simpler = term._replace(form=forms[0].name, parameter_keys=())
            fit = refit_with_replacement(data, fit, term, simpler)
    return fit


def simplify_at_bound(data: WeightedData, fit: Fit) -> Fit:
    """Return ``fit`` with the simplest form of each effect that has a parameter at its bound; ``fit`` without any."""
    return simplify_terms(data, fit, find_terms_at_bound(fit))


def refine_names(data: WeightedData, fit: Fit) -> Fit:
    """Return ``fit`` refined, with the simplest form of each effect whose refined fit has a parameter at its bound."""
    refined = fit_hypothesis(data, fit.hypothesis, fit.x, fine=True)
    simplified = simplify_at_bound(data, refined)
    return refined if simplified is refined else refine_names(data, simplified)
