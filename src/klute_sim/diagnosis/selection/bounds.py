"""Models in place of those at a bound: other forms of effects, and numbers as they are declared."""

from collections.abc import Sequence
from dataclasses import replace

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.naming import find_infeasible_terms, find_numbers_at_limit, find_terms_at_bound
from klute_sim.diagnosis.selection.nested_forms import refit_with_containing_forms
from klute_sim.diagnosis.selection.refits import refit_with_replacement


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
    """Return ``fit`` with a simpler form of each effect that has a parameter at its bound; ``fit`` without any.

    Of the forms with fewer parameters and none of them at its bound, that with the lowest BIC is taken; the simplest
    form where there is none.
    """
    for term in find_terms_at_bound(fit):
        if term.number is None:
            fit = _choose_simpler_form(data, fit, term)
    return fit


def _choose_simpler_form(data: WeightedData, fit: Fit, term: EffectTerm) -> Fit:
    allowed = fit.hypothesis.device.spec.list_candidate_forms(term.effect_definition)
    simplest, *others = sorted(allowed, key=lambda form: len(form.parameters))
    if len(simplest.parameters) >= len(term.parameters):
        return fit
    n_parameters = range(len(simplest.parameters) + 1, len(term.parameters))
    between = [form for form in others if len(form.parameters) in n_parameters]
    simpler = [term._replace(form=form.name, parameter_keys=()) for form in (simplest, *between)]
    refits = [refit_with_replacement(data, fit, term, other) for other in simpler]
    inside = [refit for refit, other in zip(refits, simpler, strict=True) if other not in find_terms_at_bound(refit)]
    return min(inside, key=lambda refit: refit.bic(data.n_effective), default=refits[0])


def extend_at_bound(data: WeightedData, fit: Fit) -> Fit | None:
    """Return ``fit`` with a form that contains that of an effect at its bound, and has no value at its bound.

    That with the lowest BIC, None where there is none.
    """
    terms = [term for term in find_terms_at_bound(fit) if term.number is None]
    refits = [refit for term in terms for refit in refit_with_containing_forms(data, fit, term)]
    inside = [refit for refit in refits if not (refit.has_diverged or has_value_at_bound(refit))]
    return min(inside, key=lambda refit: refit.bic(data.n_effective), default=None)


def refine_effects(data: WeightedData, fit: Fit) -> Fit:
    """Return ``fit`` refined, with a simpler form of each effect whose refined fit has a parameter at its bound."""
    refined = fit_hypothesis(data, fit.hypothesis, fit.x, fine=True)
    simplified = simplify_at_bound(data, refined)
    return refined if simplified is refined else refine_effects(data, simplified)


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
