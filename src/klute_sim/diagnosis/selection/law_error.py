"""Simpler models beside which the error of a law would explain what further effects do.

No law is exact. What further effects add beside a far larger one may be an error of its law. So may what the larger one
would explain, too, if its size varied with the pressure or the muscle length: a friction of the seal that grows with
the pressure is no friction of the braid beside it. The larger effect alone, in another form, is as likely then.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.experiments.simulator import simulate_once
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.bounds import refine_effects
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.main_effect import MAX_FORM_EXCESS_FRACTION
from klute_sim.diagnosis.selection.refits import refit_without_term
from klute_sim.diagnosis.selection.robustness import EquivalentModel
from klute_sim.types import Array

MIN_VARIATION_SHARE = 0.75
"""Share of what further effects explain, from which on a variation of the effects before them explains it as well
(assumed: with four frictions of a seal that grow with the pressure it was 0.85 to 0.94, with 14 pairs and triples of
hidden effects at most 0.15, and with frictions of both braid and seal 0.54)."""


class SimplerRival(NamedTuple):
    """A model without the last effects, which an error of the laws of the others may replace."""

    model: EquivalentModel
    """The model, which leaves a misfit."""
    sentence: str
    """Why the last effects are not certain."""


def find_simpler_rival(search: ForwardSelection, base_fit: Fit, final_fit: Fit) -> SimplerRival | None:
    """Return the simplest model with some of the effects of ``final_fit`` that is as likely; None without one.

    It has the effects that were added first, or one of two. The others gain at most :data:`MAX_FORM_EXCESS_FRACTION` of
    what it gains, or a variation of its effects explains :data:`MIN_VARIATION_SHARE` of what they do. ``base_fit`` has
    no added effects. A mechanism has several pressures and lengths, so its effects are not varied.
    """
    if not search.has_repeats:
        return None
    n_base = len(base_fit.hypothesis.terms)
    names = final_fit.hypothesis.terms[n_base:]
    for smaller_fit in _iterate_smaller_fits(search, final_fit, n_base):
        first = smaller_fit.hypothesis.terms[n_base:]
        with_law = [term for term in first if _has_law(term)]
        if not with_law:
            continue
        remainder = smaller_fit.chi2 - final_fit.chi2
        if not 0.0 < remainder < np.inf:
            continue
        first_names, law_names = _join(first), _join(with_law)
        further_names = _join(term for term in names if term.identity not in smaller_fit.identities)
        if remainder <= MAX_FORM_EXCESS_FRACTION * (base_fit.chi2 - smaller_fit.chi2):
            evidence = f"{further_names} would add little to {first_names}"
        elif variable := _find_variable(search.data, smaller_fit, n_base, MIN_VARIATION_SHARE * remainder):
            evidence = f"If {law_names} varied with the {variable}, this would explain {further_names}, too"
        else:
            continue
        form = "in a form" if len(with_law) == len(first) else f"with {law_names} in a form"
        sentence = (
            f"{evidence}, which may stand for an error of the law of {law_names}. So {first_names} alone, {form} that "
            "is not in the catalogue, is as likely."
        )
        n = search.data.n_effective
        model = EquivalentModel(smaller_fit, smaller_fit.bic(n) - final_fit.bic(n), reaches_noise=False)
        return SimplerRival(model, sentence)
    return None


def _iterate_smaller_fits(search: ForwardSelection, final_fit: Fit, n_base: int) -> Iterator[Fit]:
    """Yield the fits with the first effects of ``final_fit``, and of two effects the fit with each alone."""
    names = final_fit.hypothesis.terms[n_base:]
    known = set()
    for step in search.history[1:]:
        first = step.initial_fit
        if first.identities < final_fit.identities:
            known.add(first.identities)
            yield refine_effects(search.data, first)
    for term in names if len(names) == 2 else ():
        if final_fit.identities - {term.identity} not in known:
            yield refit_without_term(search.data, final_fit, term)


def _find_variable(data: WeightedData, fit: Fit, n_base: int, min_fall: float) -> str:
    """Return on what the effects of ``fit`` would have to depend for chi squared to fall by ``min_fall``; '' if none.

    A variation is linear in the pressure or in the muscle length, and enters linearly: the derivative of the readings
    by the size of an effect is multiplied at each sample.
    """
    if data.experiments[0].devices:
        return ""
    chi2 = _compute_linear_chi2(fit, [])
    for variable, sensitivities in _iterate_variations(data, fit, n_base):
        if chi2 - _compute_linear_chi2(fit, sensitivities) >= min_fall:
            return variable
    return ""


def _iterate_variations(data: WeightedData, fit: Fit, n_base: int) -> Iterator[tuple[str, list[Array]]]:
    """Yield each variable with the derivatives of the weighted residuals by the variations of all sizes."""
    setups = fit.hypothesis.build_setups(fit.x, data.experiments)
    responses = [simulate_once(setup, e) for setup, e in zip(setups, data.experiments, strict=True)]
    sizes = [
        fit.jacobian[:, k]
        for k, parameter in enumerate(fit.hypothesis.parameters)
        if parameter.term_index is not None
        and parameter.term_index >= n_base
        and not parameter.is_logarithmic
        and _has_law(fit.hypothesis.terms[parameter.term_index])
    ]
    for variable, values in (
        ("pressure", [response.pressure for response in responses]),
        ("muscle length", [response.muscle_length for response in responses]),
    ):
        largest = max(float(np.abs(v).max()) for v in values)
        if not 0.0 < largest < np.inf:  # a device without a muscle has no pressure
            continue
        factors = [
            np.interp(e.measured[channel].time, response.time, value) / largest
            for e, response, value, weights in zip(data.experiments, responses, values, data.weights, strict=True)
            for channel in weights
        ]
        factor = np.concatenate([*factors, np.zeros(fit.hypothesis.n_prior_parameters)])
        yield variable, [factor * size for size in sizes]


def _compute_linear_chi2(fit: Fit, sensitivities: list[Array]) -> float:
    """Return chi squared of ``fit`` with further parameters of given ``sensitivities``, by linearisation."""
    columns = np.column_stack([fit.jacobian, *sensitivities])
    target = -fit.weighted_residuals
    residual = columns @ np.linalg.lstsq(columns, target)[0] - target
    return float(residual @ residual)


def _has_law(term: EffectTerm) -> bool:
    """Return whether ``term`` has a law that may have an error; wrong numbers and faults of instruments have none."""
    return not (term.number or term.channel)


def _join(terms: Iterable[EffectTerm]) -> str:
    return " and ".join(map(str, terms))
