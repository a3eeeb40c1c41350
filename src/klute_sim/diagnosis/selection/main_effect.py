"""Rivals of an effect that explains nearly all of a misfit, where others, far smaller, complete it.

The laws of a simulation are never exact. Where one effect takes nearly all of the misfit, the small ones that are
needed to reach the noise may stand for an error of the law. So another effect that explains almost as much as the large
one is as likely.
"""

from klute_sim.diagnosis.fitting.hypothesis import Identity
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.selection.bounds import refine_effects
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.naming import find_naming_obstacle
from klute_sim.diagnosis.selection.robustness import EquivalentModel
from klute_sim.diagnosis.selection.selection_step import SelectionStep

MAX_FORM_EXCESS_FRACTION = 0.01
"""Largest excess of chi squared of a rival over the fit with the first effect alone, as a fraction of what that effect
gains; or what the small effects gain, if that is more (assumed: the form of an effect is known to a tenth of its
size)."""
MAX_REMAINDER_FRACTION = 0.03
"""Largest part of the fall of chi squared that the other effects add beside an effect with such rivals (assumed)."""


def find_rivals_of_main_effect(search: ForwardSelection, base_fit: Fit, final_fit: Fit) -> list[EquivalentModel]:
    """Return the rivals of the first effect of ``final_fit``, best first; each is the only name of its model.

    Empty where ``final_fit`` has one name, or where the others gain more than :data:`MAX_REMAINDER_FRACTION` of the
    fall of chi squared. Repeats show a misfit beside a rival, as they do beside the first effect alone.
    """
    names = final_fit.hypothesis.terms[len(base_fit.hypothesis.terms) :]
    step = search.history[0] if search.history else None
    if len(names) < 2 or step is None or step.added_term is None or not search.has_repeats:
        return []
    if step.added_term.identity not in {term.identity for term in names}:
        return []
    main_fit = refine_effects(search.data, step.refits[0])
    remainder = main_fit.chi2 - final_fit.chi2
    if not 0.0 < remainder <= MAX_REMAINDER_FRACTION * (base_fit.chi2 - final_fit.chi2):
        return []
    max_chi2 = main_fit.chi2 + max(remainder, MAX_FORM_EXCESS_FRACTION * (base_fit.chi2 - main_fit.chi2))
    # Uncertain numbers may be at their limits beside one effect, as long as others do not relieve them.
    return list_rivals_of_step(search, step, main_fit, max_chi2, final_fit, accepts_numbers_at_limit=True)


def list_rivals_of_step(
    search: ForwardSelection,
    step: SelectionStep,
    named_fit: Fit,
    max_chi2: float,
    final_fit: Fit,
    *,
    accepts_numbers_at_limit: bool = False,
) -> list[EquivalentModel]:
    """Return the fits whose last term is another one than that of ``named_fit``, up to ``max_chi2``, best first.

    ``step`` has added the last term. Differences of BIC are those from ``final_fit``. ``accepts_numbers_at_limit``
    is that of :func:`~klute_sim.diagnosis.selection.naming.find_naming_obstacle`.
    """
    n, name = search.data.n_effective, named_fit.hypothesis.terms[-1]
    rivals: dict[Identity, EquivalentModel] = {}
    for refit in step.refits[1:]:
        identity = refit.hypothesis.terms[-1].identity
        if refit.chi2 > max_chi2 or identity == name.identity or identity in rivals:
            continue
        rival = refine_effects(search.data, refit)
        if rival.chi2 > max_chi2:
            continue
        if find_naming_obstacle(search.data, rival, accepts_numbers_at_limit=accepts_numbers_at_limit):
            continue
        gains = search.compute_validation_gains(step.initial_fit, rival)
        if not search.rejection_reason(step.initial_fit, rival, gains):
            rivals[identity] = EquivalentModel(rival, rival.bic(n) - final_fit.bic(n), reaches_noise=False)
    return sorted(rivals.values(), key=lambda rival: rival.difference)
