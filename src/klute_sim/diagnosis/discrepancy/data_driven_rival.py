"""Comparison of named effects with a data-driven term: an unknown effect may explain the data as well.

Several effects of the catalogue together can imitate one that is not in it. A data-driven term at the equation with the
misfit represents any such effect. Names stand if the term is not better. Where the names are of several kinds at once
(the device, an instrument, a wrong number), which is a coincidence, an equally good term makes them indistinguishable.
Where names leave a misfit and a term elsewhere leaves none, the term decides.
"""

from collections.abc import Collection, Iterable
from typing import NamedTuple

import numpy as np

from klute_sim.datasets.mechanism import is_model_number
from klute_sim.device.schema.document import PNEUMATIC_SECTIONS
from klute_sim.diagnosis.discrepancy.sparse_regression import fit_data_driven_term
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.localization.equation_residuals import compute_equation_residuals
from klute_sim.diagnosis.selection.bounds import refine_effects
from klute_sim.diagnosis.selection.candidates import acts_on_pressure
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.main_effect import list_rivals_of_step
from klute_sim.diagnosis.selection.naming import find_implausible_number, find_naming_obstacle, list_kinds
from klute_sim.diagnosis.selection.pair_screening import has_adequate_pair
from klute_sim.diagnosis.selection.predictive_model import MIN_TERM_SHARE
from klute_sim.diagnosis.selection.robustness import MAX_EXCESS_FRACTION, EquivalentModel
from klute_sim.diagnosis.selection.validation import MAX_VALIDATION_LOSS
from klute_sim.types import Array

DECISIVE_MARGIN = 3.0
"""Margin of a data-driven term over names, in thresholds of BIC, from which no search for other names is worth its time
(assumed)."""
MIN_PAIR_GAIN_FRACTION = 0.5
"""Predicted gain of a pair of effects over the gain of a data-driven term, from which on the pair is refitted (assumed:
linearisation underestimates the gain of frictions by almost as much)."""
MIN_NAMED_SHARE = 0.6
"""Share of the fall of chi squared with the term, from which on names are listed beside it (assumed: as where the law
is imperfect, :mod:`klute_sim.diagnosis.selection.predictive_selection`)."""
MIN_CONTAINED_SHARE = 0.99
"""Share of a name's squared sensitivity that the functions of a term explain, from which on the term contains the name
(assumed; it is 1 where a function is the law of the name, such as Coulomb friction)."""


class RivalOfNumber(NamedTuple):
    """An effect that is in no catalogue, in place of a number that would be wrong by an implausible amount."""

    model: EquivalentModel
    """The data-driven term that explains most; the effect may explain more."""
    sentence: str
    """Why the number is not the only name."""


class AdequateTerm(NamedTuple):
    """A data-driven term with which repeats show no misfit."""

    fit: Fit
    """Fit of the term without added effects."""
    equation: str
    """Name of the equation that the term belongs to."""


def compute_refusal_threshold(search: ForwardSelection) -> float:
    """Return the fall of BIC from which a data-driven term refuses names that explain the data to the noise."""
    return search.bic_threshold + _compute_simulation_chi2(search)


def compute_decisive_threshold(search: ForwardSelection) -> float:
    """Return the fall of BIC from which a data-driven term is decisive."""
    return DECISIVE_MARGIN * search.bic_threshold + _compute_simulation_chi2(search)


def _compute_simulation_chi2(search: ForwardSelection) -> float:
    """Return chi squared of the error of the simulation, which the many functions of a data-driven term can fit."""
    simulation_error = max((e.simulation_error for e in search.data.experiments), default=0.0)
    return simulation_error * simulation_error * search.data.n_effective


def find_adequate_term(search: ForwardSelection, base_fit: Fit, exclude: Collection[str] = ()) -> AdequateTerm | None:
    """Return a data-driven term in one equation that is added to ``base_fit`` and leaves no misfit; None without one.

    ``exclude`` names effects that are not candidates.
    """
    residuals = compute_equation_residuals(search.data, base_fit)
    fitted = fit_data_driven_term(search, base_fit, residuals, exclude, max_supports=1)
    if fitted.fit is None or search.has_misfit(fitted.fit):
        return None
    return AdequateTerm(fitted.fit, fitted.equation)


def predicts_as_well(search: ForwardSelection, term_fit: Fit, named_fit: Fit) -> bool:
    """Return whether ``term_fit`` predicts every validation group as well as ``named_fit`` (names must, too)."""
    gains = search.compute_validation_gains(named_fit, term_fit)
    return min(gains.values(), default=0.0) >= -MAX_VALIDATION_LOSS


def find_data_driven_rival(
    search: ForwardSelection, base_fit: Fit, named_fit: Fit, exclude: Collection[str] = ()
) -> EquivalentModel | None:
    """Return ``base_fit`` with a data-driven term in place of the names of ``named_fit``, if it is as good.

    Its repeats show no misfit, its BIC is lower by more than :func:`compute_refusal_threshold` (not higher by more than
    the usual threshold where the names are of several kinds), and it predicts every validation group as well.
    A term that contains the names does not refuse them. ``exclude`` names effects that are not candidates.
    """
    names = named_fit.hypothesis.terms[len(base_fit.hypothesis.terms) :]
    if not names:
        return None
    adequate = find_adequate_term(search, base_fit, exclude)
    if adequate is None:
        return None
    term_fit = adequate.fit
    bic_difference = compute_bic_difference(search, term_fit, named_fit)
    if bic_difference > (search.bic_threshold if len(list_kinds(names)) > 1 else -compute_refusal_threshold(search)):
        return None
    if contains_names(term_fit, named_fit, names) or not predicts_as_well(search, term_fit, named_fit):
        return None
    return EquivalentModel(term_fit, bic_difference)


def find_rival_of_number(
    search: ForwardSelection, base_fit: Fit, named_fit: Fit, exclude: Collection[str] = ()
) -> RivalOfNumber | None:
    """Return the rival of names that are only numbers, one of them wrong by an implausible amount.

    Returns None where all numbers are plausible (:func:`~klute_sim.diagnosis.selection.naming.find_implausible_number`)
    or where no data-driven term represents the misfit. Nor is there a rival where ``exclude`` has the name of this
    term: who measured the number rules the term out, and another equation represents the misfit less well.
    """
    names = named_fit.hypothesis.terms[len(base_fit.hypothesis.terms) :]
    if not names or not all(term.number for term in names):
        return None
    implausible = find_implausible_number(named_fit)
    if implausible is None:
        return None
    term, error = implausible
    residuals = compute_equation_residuals(search.data, base_fit)
    fitted = fit_data_driven_term(search, base_fit, residuals, max_supports=1)
    if fitted.fit is None or fitted.fit.hypothesis.terms[-1].effect in exclude:
        return None
    sentence = (
        f"{term} would be wrong by {error:.1f} times its plausible error (assumed), so an effect in the "
        f"equation of {fitted.equation} that is in no catalogue is as likely. Measure the number."
    )
    return RivalOfNumber(EquivalentModel(fitted.fit, compute_bic_difference(search, fitted.fit, named_fit)), sentence)


def contains_names(term_fit: Fit, named_fit: Fit, names: Iterable[EffectTerm]) -> bool:
    """Return whether the data-driven term of ``term_fit`` is ``names`` and something more.

    The sizes of all names then change the readings as a combination of the functions of the term does: of the squared
    sensitivities, the functions explain at least :data:`MIN_CONTAINED_SHARE`.
    """
    functions = _select_sensitivities(term_fit, term_fit.hypothesis.terms[-1:])
    sizes = _select_sensitivities(named_fit, names)
    remainder = sizes - functions @ np.linalg.lstsq(functions, sizes)[0]
    return bool(np.all((remainder**2).sum(axis=0) <= (1.0 - MIN_CONTAINED_SHARE) * (sizes**2).sum(axis=0)))


def _select_sensitivities(fit: Fit, terms: Iterable[EffectTerm]) -> Array:
    """Return the sensitivities of the samples to the sizes of ``terms`` of ``fit``, (samples, sizes); not to shapes.

    The rows of the priors, which come last, are left out: only one of two fits may have the delay of a command.
    """
    hypothesis, indices = fit.hypothesis, {fit.hypothesis.terms.index(term) for term in terms}
    columns = [k for k, p in enumerate(hypothesis.parameters) if p.term_index in indices and not p.is_logarithmic]
    return fit.jacobian[: len(fit.jacobian) - hypothesis.n_prior_parameters, columns]


def compute_bic_difference(search: ForwardSelection, term_fit: Fit, named_fit: Fit) -> float:
    """Return the BIC of ``term_fit`` minus that of ``named_fit``."""
    n = search.data.n_effective
    return term_fit.bic(n) - named_fit.bic(n)


def locate_term(term: EffectTerm) -> str:
    """Return the part that ``term`` is in: the supply, a device, the mechanism, the body or an instrument."""
    if term.number and is_model_number(term.number):
        return "mechanism"
    if term.number:
        return "supply" if term.number.partition(".")[0] in PNEUMATIC_SECTIONS else "device"
    effect = term.effect_definition
    return "supply" if effect.kind == "device" and acts_on_pressure(effect) else effect.kind


class DecisiveTerm(NamedTuple):
    """A data-driven term that explains the data to the noise where no names do, and the names that come nearest."""

    adequate: AdequateTerm
    """The term."""
    named_fit: Fit | None
    """Fit of the names that take most of what the term explains; None if there are none."""
    rivals: list[EquivalentModel]
    """Other names that take nearly as much."""


def find_decisive_term(
    search: ForwardSelection, base_fit: Fit, named_fit: Fit, exclude: Collection[str] = ()
) -> DecisiveTerm | None:
    """Return a data-driven term in one equation that explains the data to the noise, where no names do.

    ``named_fit`` is the best fit of the selection and leaves a misfit. The term must be better by
    :func:`compute_decisive_threshold` and predict every validation group as well, and no pair of effects may
    reach the noise: effects are added one at a time, and a pair of which neither explains much alone is passed by.

    One cause suffices then, at the place of the term (supply, device, joint). Names there may be a part of it: an
    imperfect law, or another form. Then there is no decisive term. Names elsewhere that take at least
    :data:`MIN_NAMED_SHARE` of what the term explains are listed beside it, but no more of them than the term has
    functions. A name that takes less than :data:`MIN_TERM_SHARE` of it only fills up what the others leave. ``exclude``
    names effects that are not candidates.
    """
    adequate = find_adequate_term(search, base_fit, exclude)
    if adequate is None:
        return None
    term_fit = adequate.fit
    if compute_bic_difference(search, term_fit, named_fit) > -compute_decisive_threshold(search):
        return None
    if not predicts_as_well(search, term_fit, named_fit):
        return None
    gain = base_fit.chi2 - term_fit.chi2
    data_driven_term = term_fit.hypothesis.terms[-1]
    named_fit, last_step = base_fit, None
    for step in search.history[: len(data_driven_term.parameter_keys)]:
        if step.added_term is None or named_fit.chi2 - step.refits[0].chi2 < MIN_TERM_SHARE * gain:
            break
        named_fit, last_step = step.refits[0], step
    is_named = last_step is not None and base_fit.chi2 - named_fit.chi2 >= MIN_NAMED_SHARE * gain
    names = named_fit.hypothesis.terms[len(base_fit.hypothesis.terms) :]
    if is_named and {locate_term(term) for term in names} == {locate_term(data_driven_term)}:
        return None
    if has_adequate_pair(search, base_fit, MIN_PAIR_GAIN_FRACTION * gain):
        return None
    if last_step is None or not is_named:
        return DecisiveTerm(adequate, None, [])
    named_fit = refine_effects(search.data, named_fit)
    if base_fit.chi2 - named_fit.chi2 < MIN_NAMED_SHARE * gain or find_naming_obstacle(search.data, named_fit):
        return DecisiveTerm(adequate, None, [])
    max_chi2 = named_fit.chi2 + MAX_EXCESS_FRACTION * (base_fit.chi2 - named_fit.chi2)
    return DecisiveTerm(adequate, named_fit, list_rivals_of_step(search, last_step, named_fit, max_chi2, named_fit))
