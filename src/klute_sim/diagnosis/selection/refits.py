"""Refits of a model without one of its terms, or with another in its place."""

from dataclasses import replace

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData


def refit_without_term(data: WeightedData, current: Fit, term: EffectTerm) -> Fit:
    """Return ``current`` refitted without ``term``."""
    index = current.hypothesis.terms.index(term)
    retained = [p.term_index != index for p in current.hypothesis.parameters]
    hypothesis, jacobian = current.hypothesis.without_term(term), current.jacobian[:, retained]
    preliminary = fit_hypothesis(data, hypothesis, current.x[retained], jacobian, reference=current)
    return fit_hypothesis(data, hypothesis, preliminary.x)


def refit_with_replacement(data: WeightedData, current: Fit, term: EffectTerm, replacement: EffectTerm) -> Fit:
    """Return ``current`` refitted with ``replacement``, initially neutral, in place of ``term``."""
    index, parameters = current.hypothesis.terms.index(term), current.hypothesis.parameters
    terms = tuple(replacement if t == term else t for t in current.hypothesis.terms)
    hypothesis = replace(current.hypothesis, terms=terms)
    x0 = hypothesis.initial_point()
    retained = [p.term_index != index for p in hypothesis.parameters]
    x0[retained] = current.x[[p.term_index != index for p in parameters]]
    return fit_hypothesis(data, hypothesis, x0)
