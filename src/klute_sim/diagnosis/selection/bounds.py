"""Models in place of those at a bound: simpler forms of effects, and numbers as they are declared."""

from collections.abc import Sequence
from dataclasses import replace

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, fit_hypothesis
from klute_sim.diagnosis.selection.forward_selection import refit_with_replacement
from klute_sim.diagnosis.selection.naming import find_infeasible_terms, find_numbers_at_limit, find_terms_at_bound


def has_value_at_bound(fit: Fit) -> bool:
    """Return whether ``fit`` has a parameter or a number at its bound, or parameters that no part has."""
    at_bound = find_terms_at_bound(fit) or find_infeasible_terms(fit)
    return bool(at_bound or (fit.hypothesis.terms and find_numbers_at_limit(fit)))


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


def restore_declared_numbers(data: WeightedData, fit: Fit) -> Fit:
    """Return ``fit`` with the numbers at the limit of their declared uncertainty as declared, refitted in the others.

    Returns ``fit`` itself without any. The registration of a walk is always fitted.
    """
    hypothesis = fit.hypothesis
    at_limit = dict(hypothesis.uncertainties).keys() & find_numbers_at_limit(fit)
    if not at_limit:
        return fit
    retained = [p.term_index is not None or p.name not in at_limit for p in hypothesis.parameters]
    uncertainties = tuple((key, deviation) for key, deviation in hypothesis.uncertainties if key not in at_limit)
    reduced = replace(hypothesis, uncertainties=uncertainties)
    return restore_declared_numbers(data, fit_hypothesis(data, reduced, fit.x[retained]))
