"""Margin of names over a free term: whether an unknown effect would explain the data as well as the named ones.

Several effects of the catalogue together can imitate one that is not in it. A data-driven term at the equation with the
misfit represents any such effect. Names stand if the term is not better. Where the names are in several places at once
(the device, an instrument, a wrong number), which is a coincidence, an equally good term makes them indistinguishable.
"""

from collections.abc import Collection

from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.selection.equation_residuals import compute_equation_residuals
from klute_sim.diagnosis.selection.forward_selection import MAX_VALIDATION_LOSS, ForwardSelection
from klute_sim.diagnosis.selection.robustness import EquivalentModel
from klute_sim.diagnosis.selection.sparse_regression import fit_free_term


def find_free_model(
    search: ForwardSelection, base_fit: Fit, named_fit: Fit, exclude: Collection[str] = ()
) -> EquivalentModel | None:
    """Return ``base_fit`` with a data-driven term in place of the names of ``named_fit``, if it is as good.

    Its repeats show no misfit, its BIC is lower by more than the threshold (not higher by more than the threshold where
    the names are in several places), and it predicts every validation group as well (names must, too). ``exclude``
    names effects that are not candidates.
    """
    names = named_fit.hypothesis.terms[len(base_fit.hypothesis.terms) :]
    if not names:
        return None
    residuals = compute_equation_residuals(search.data, base_fit)
    free_fit = fit_free_term(search, base_fit, residuals, exclude, max_supports=1).fit
    if free_fit is None or search.has_misfit(free_fit):
        return None
    places = {"number" if term.number else term.effect_definition.kind for term in names}
    n = search.data.n_effective
    bic_difference = free_fit.bic(n) - named_fit.bic(n)
    if bic_difference > (search.bic_threshold if len(places) > 1 else -search.bic_threshold):
        return None
    gains = search.compute_validation_gains(named_fit, free_fit)
    if min(gains.values(), default=0.0) < -MAX_VALIDATION_LOSS:
        return None
    return EquivalentModel(free_fit, names[-1], bic_difference)
