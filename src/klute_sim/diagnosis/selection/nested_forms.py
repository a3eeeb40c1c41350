"""Fits of forms of an effect beside those of its simpler forms: one that contains another cannot explain less.

Where a form explains less than one with fewer parameters, which all have counterparts in it, its fit may have ended in
a local minimum, and begins again where the simpler form ended. A form whose parameter ends at its bound may be part of
such a form, too: a valve that is symmetric in part only.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis, Identity
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.types import Array

MIN_CHI2_EXCESS = 1.0
"""Chi squared that a form leaves beyond a simpler one from which on its fit is wrong, and not only unfinished
(assumed)."""


def restart_nested_forms(data: WeightedData, fits: Sequence[Fit], max_nfev: int) -> list[Fit]:
    """Return ``fits``, which differ in their last term, with better ones of forms that explain less than a simpler one.

    ``max_nfev`` is the largest number of evaluations of a new fit.
    """
    return [_restart_at_simpler_form(data, fit, fits, max_nfev) for fit in fits]


def _restart_at_simpler_form(data: WeightedData, fit: Fit, fits: Sequence[Fit], max_nfev: int) -> Fit:
    simpler = [other for other in fits if _is_simpler_form(other.hypothesis.terms[-1], fit.hypothesis.terms[-1])]
    for other in sorted(simpler, key=lambda other: other.chi2):
        if not other.chi2 < fit.chi2 - MIN_CHI2_EXCESS:
            break
        start = _carry_values(other, fit.hypothesis, len(fit.hypothesis.terms) - 1)
        if start is not None:
            restarted = fit_hypothesis(data, fit.hypothesis, start, max_nfev=max_nfev)
            return restarted if restarted.chi2 < fit.chi2 else fit
    return fit


def _is_simpler_form(term: EffectTerm, other: EffectTerm) -> bool:
    """Return whether ``term`` is another form of the effect of ``other``, with fewer parameters."""
    return term.identity == other.identity and len(term.parameters) < len(other.parameters)


def select_best_fits(fits: Iterable[Fit]) -> list[Fit]:
    """Return the best of the ``fits`` of each cause, best first, whatever the form of its effects."""
    best: dict[frozenset[Identity], Fit] = {}
    for fit in sorted(fits, key=lambda fit: fit.chi2):
        best.setdefault(fit.identities, fit)
    return list(best.values())


def refit_with_containing_forms(data: WeightedData, fit: Fit, term: EffectTerm, *, is_fine: bool = True) -> list[Fit]:
    """Return ``fit`` refitted with each form that contains that of its ``term`` in its place, from its values.

    Those that are not fine end with coarse simulations.
    """
    index, refits = fit.hypothesis.terms.index(term), []
    for form in fit.hypothesis.device.spec.list_candidate_forms(term.effect_definition):
        other = term._replace(form=form.name, parameter_keys=())
        if not _is_simpler_form(term, other):
            continue
        terms = tuple(other if t == term else t for t in fit.hypothesis.terms)
        hypothesis = replace(fit.hypothesis, terms=terms)
        start = _carry_values(fit, hypothesis, index)
        if start is not None:
            refits.append(fit_hypothesis(data, hypothesis, start, fine=is_fine))
    return refits


def _carry_values(simple: Fit, hypothesis: Hypothesis, index: int) -> Array | None:
    """Return the point of ``hypothesis`` with the values of ``simple``, and initial ones of its other parameters.

    Both differ in the form of their term ``index``, whose forms may have other scales and bounds. A parameter has the
    name of the simpler form, or one that ends with it, as the resistance of a valve to filling. None where a parameter
    of the simpler form has no counterpart.
    """
    start = hypothesis.initial_point()
    start[[p.term_index != index for p in hypothesis.parameters]] = simple.x[
        [p.term_index != index for p in simple.hypothesis.parameters]
    ]
    indices = {p.name: i for i, p in enumerate(hypothesis.parameters) if p.term_index == index}
    for parameter, x in zip(simple.hypothesis.parameters, simple.x, strict=True):
        if parameter.term_index != index:
            continue
        match = [i for name, i in indices.items() if name == parameter.name or name.endswith(f"_{parameter.name}")]
        if len(match) != 1:
            return None
        start[match[0]] = hypothesis.parameters[match[0]].normalize(parameter.denormalize(float(x)))
    return np.clip(start, *hypothesis.bounds())
