"""Robustness checks: smaller models, multi-start convergence, equivalent models."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis, Identity
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.selection.bounds import extend_at_bound, has_value_at_bound, refine_effects, simplify_at_bound
from klute_sim.diagnosis.selection.candidates import is_same_cause, list_further_terms
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.diagnosis.selection.naming import find_implausible_number, find_naming_obstacle
from klute_sim.diagnosis.selection.refits import refit_without_term
from klute_sim.diagnosis.selection.screening import (
    predict_gains,
    screen_candidates,
    select_best_causes,
    select_shortlist,
)
from klute_sim.diagnosis.selection.validation import MAX_VALIDATION_LOSS
from klute_sim.types import ProgressCallback

MAX_REPLACEMENTS = 5
"""Maximum number of candidates that replace a term (assumed)."""
MAX_EXCHANGES = 4
"""Maximum number of times that an equivalent model takes the place of the best one (assumed)."""
MAX_FIRST_TERMS, MAX_SECOND_TERMS = 6, 3
"""Largest number of first terms of other pairs, and of second terms beside each of them (assumed)."""
MAX_REMAINDER_FRACTION = 0.1
"""Largest part of the fall of chi squared with a pair that the first term of another pair leaves (assumed)."""
MIN_SECOND_GAIN_FRACTION = 0.5
"""Smallest predicted part of what a model leaves, without one of its terms, that another term takes (assumed)."""
RESTART_SIGMAS = 3.0
"""Distance of the restart from the fit, in standard errors of each parameter (assumed)."""
MIN_RESTART_OFFSET = 0.02
"""Minimum distance of the restart from the fit, in normalized parameters (assumed)."""
MAX_EXCESS_FRACTION = 0.03
"""Largest excess of BIC of a rival that explains the data to the noise, too, as a fraction of what the replaced term
gains (assumed)."""
MAX_EXCESS_FACTOR = 5.0
"""Largest excess of BIC of such a rival, over the difference of BIC that decides (assumed)."""
AIC_PENALTY = 2.0
"""Fall of chi squared that Akaike's information criterion requires of a further parameter."""
CHI2_TOLERANCE = 1.0
"""Difference of chi squared below which two fits agree (assumed)."""


class EquivalentModel(NamedTuple):
    """Another set of effects that explains the data as well as the best fit."""

    fit: Fit
    """Fit of the other set."""
    difference: float
    """Difference from the best fit in :attr:`criterion`; positive where the best fit is better."""
    criterion: Literal["BIC", "prediction error"] = "BIC"
    """What is compared: BIC, or the squared error of prediction, whose difference is relative to that of the best
    fit."""
    reaches_noise: bool = True
    """Whether it explains the data as well as the best fit; otherwise nearly as much."""


def select_final_fit(
    search: ForwardSelection, best_fit: Fit, seed: int, progress: ProgressCallback
) -> tuple[Fit, bool, list[EquivalentModel]]:
    """Return the refined model that ``best_fit`` ends with, whether it has converged, and its equivalents, best first.

    A smaller model takes its place, or an equivalent one where BIC prefers it decisively, where ``best_fit`` has a
    value at a bound, or where only ``best_fit`` needs a number that is wrong by more than is plausible. None does that
    leaves a misfit.
    """
    progress(0.65, "restarting the fit from another point")
    fit, has_converged = refine_and_simplify(search, best_fit, np.random.default_rng(seed))
    smaller_fit = find_smaller_model(search, fit)
    if smaller_fit is not None:
        smaller_fit, is_reproducible = refine_and_simplify(search, smaller_fit, np.random.default_rng(seed))
        n = search.data.n_effective
        is_as_good = smaller_fit.bic(n) <= fit.bic(n) + search.bic_threshold  # still, after both were refined
        if is_as_good and not has_value_at_bound(smaller_fit) and not search.has_misfit(smaller_fit):
            fit, has_converged = smaller_fit, is_reproducible
    progress(0.7, "searching for equivalent models")
    pairs = find_equivalent_pairs(search, fit)
    equivalent_models = _merge_rivals(search, fit, find_equivalent_models(search, fit), pairs)
    for _ in range(MAX_EXCHANGES):  # the equivalents of another model may hold a better one
        better_fit = _find_better_model(search, fit, equivalent_models)
        if better_fit is None:
            break
        fit, has_converged = refine_and_simplify(search, better_fit, np.random.default_rng(seed))
        equivalent_models = _merge_rivals(search, fit, find_equivalent_models(search, fit), pairs)
    return fit, has_converged, equivalent_models


def _merge_rivals(
    search: ForwardSelection, fit: Fit, models: Sequence[EquivalentModel], pairs: Sequence[Fit]
) -> list[EquivalentModel]:
    """Return ``models`` and those of ``pairs`` that are as good as ``fit`` and others than these, best first.

    The pairs were as good as another fit, which ``fit`` may have replaced.
    """
    n, max_excess = search.data.n_effective, MAX_EXCESS_FACTOR * search.bic_threshold
    known = {fit.identities, *(model.fit.identities for model in models)}
    merged = list(models)
    for pair in pairs:
        difference = pair.bic(n) - fit.bic(n)
        is_as_good = difference <= (search.bic_threshold if search.has_misfit(pair) else max_excess)
        if is_as_good and pair.identities not in known:
            merged.append(EquivalentModel(pair, difference))
    return sorted(merged, key=lambda model: model.difference)


def _find_better_model(search: ForwardSelection, fit: Fit, equivalent_models: Sequence[EquivalentModel]) -> Fit | None:
    """Return the equivalent model that takes the place of ``fit``; None if none does."""
    adequate = [model for model in equivalent_models if not search.has_misfit(model.fit)]
    if adequate and (adequate[0].difference < -search.bic_threshold or has_value_at_bound(fit)):
        return adequate[0].fit
    if find_implausible_number(fit) is None:
        return None
    return next(
        (
            model.fit
            for model in adequate
            if model.difference <= search.bic_threshold and find_implausible_number(model.fit) is None
        ),
        None,
    )


def find_smaller_model(search: ForwardSelection, best_fit: Fit) -> Fit | None:
    """Return a fit with two terms that is as good as ``best_fit``: one of its terms and one other term.

    Two proxies that were added one after the other may hide a single effect. Returns None if there is no such fit, or
    if ``best_fit`` has fewer than three terms; the selection has tested single effects already.
    """
    data, terms = search.data, best_fit.hypothesis.terms
    if len(terms) < 3:
        return None
    max_bic = best_fit.bic(data.n_effective) + search.bic_threshold
    smaller_fits = []
    for retained in terms:
        reduced_fit = best_fit
        for term in terms:
            if term != retained:
                reduced_fit = refit_without_term(data, reduced_fit, term)
        for refit in _refit_replacements(search, reduced_fit, best_fit, max_bic):
            if refit.bic(data.n_effective) <= max_bic and not search.rejection_reason(
                reduced_fit, refit, search.compute_validation_gains(reduced_fit, refit)
            ):
                smaller_fits.append(refit)
    return min(smaller_fits, key=lambda fit: fit.bic(data.n_effective), default=None)


def _refit_replacements(search: ForwardSelection, reduced_fit: Fit, best_fit: Fit, bic_goal: float) -> list[Fit]:
    """Return refits of ``reduced_fit`` with one more term that may reach at least half the gain of ``best_fit``."""
    unused = list_further_terms(search.candidate_terms, reduced_fit)
    min_gain = MIN_SECOND_GAIN_FRACTION * (reduced_fit.chi2 - best_fit.chi2)
    promising = [c for c in screen_candidates(search.data, reduced_fit, unused) if c.predicted_gain > min_gain]
    if not promising:
        return []
    return search.refit_candidates(reduced_fit, select_shortlist(promising)[:MAX_REPLACEMENTS], bic_goal)


def find_equivalent_models(search: ForwardSelection, best_fit: Fit) -> list[EquivalentModel]:
    """Return the models with one replaced term that are not decisively worse, best first.

    The BIC of such a model is higher by at most the threshold. Where repeats show no misfit beside it either, it may be
    higher by :data:`MAX_EXCESS_FRACTION` of what the replaced term gains, and by :data:`MAX_EXCESS_FACTOR` times the
    threshold: an effect that is not in the catalogue may be as close to both. The replacement must pass the acceptance
    tests of the selection, including validation. It must be nameable: where its refined fit has a parameter at a bound,
    it is fitted again from the values of ``best_fit``, and then a simpler form takes its place or none does.
    """
    data, best_bic = search.data, best_fit.bic(search.data.n_effective)
    models: list[EquivalentModel] = []
    for term in best_fit.hypothesis.terms:
        step = next(
            (s for s in search.history if s.added_term == term and s.refits[0].hypothesis == best_fit.hypothesis), None
        )
        if step is not None and search.has_repeats:  # without repeats, the noise has been re-estimated since
            reduced_fit, refits = step.initial_fit, step.refits
        else:
            reduced_fit = refit_without_term(data, best_fit, term)
            refits = tuple(_refit_replacements(search, reduced_fit, best_fit, best_bic))
        for refit in refits:
            is_other = refit.hypothesis.terms[-1].identity != term.identity
            if not (is_other and _is_equivalent(search, reduced_fit, refit, best_fit)):
                continue
            rival = refine_effects(data, refit)
            if find_naming_obstacle(data, rival):
                rival = refine_effects(data, _restart_at(data, refit, best_fit))
            is_known = any(model.fit.hypothesis == rival.hypothesis for model in models)
            if is_known or find_naming_obstacle(data, rival):
                continue
            if _is_equivalent(search, reduced_fit, rival, best_fit):
                models.append(EquivalentModel(rival, rival.bic(data.n_effective) - best_bic))
    return sorted(models, key=lambda model: model.difference)


def find_equivalent_pairs(search: ForwardSelection, best_fit: Fit) -> list[Fit]:
    """Return fits of the pairs of terms that explain the data as well as ``best_fit``; none where it has not added two.

    Two wrong numbers, such as radius and turns, may look like two effects, such as tapered ends and a thinner wall,
    although no effect imitates one of the numbers. So pairs are compared whose first term the first step of
    ``search`` fitted alone. It leaves at most :data:`MAX_REMAINDER_FRACTION` of the fall of chi squared to the second.
    """
    first_step = search.history[0] if search.history else None
    if first_step is None or not search.has_repeats:
        return []
    base_fit, data = first_step.initial_fit, search.data
    names = {term.identity for term in best_fit.hypothesis.terms[len(base_fit.hypothesis.terms) :]}
    if len(names) != 2:
        return []
    max_chi2 = best_fit.chi2 + MAX_REMAINDER_FRACTION * (base_fit.chi2 - best_fit.chi2)
    # Terms that are one to the data, such as the lengths of muscle and tendon, leave the same.
    firsts = {round(fit.chi2): fit for fit in reversed(first_step.refits) if fit.chi2 <= max_chi2}
    pairs: dict[frozenset[Identity], Fit] = {}
    for first_fit in [firsts[chi2] for chi2 in sorted(firsts)[:MAX_FIRST_TERMS]]:
        first = first_fit.hypothesis.terms[-1]
        others = [c for c in first_step.candidates if not is_same_cause(c.term, first)]
        promising = select_best_causes(predict_gains(first_fit, others), MAX_SECOND_TERMS)
        min_gain = MIN_SECOND_GAIN_FRACTION * (first_fit.chi2 - best_fit.chi2)
        for candidate in screen_candidates(data, first_fit, [c.term for c in promising]):
            identities = frozenset([first.identity, candidate.term.identity])
            if candidate.predicted_gain < min_gain or identities == names or identities in pairs:
                continue
            (refit,) = search.refit_candidates(first_fit, [candidate], best_fit.bic(data.n_effective))
            if not _is_equivalent(search, first_fit, refit, best_fit):
                continue
            pair_fit = refine_effects(data, refit)
            if not find_naming_obstacle(data, pair_fit) and _is_equivalent(search, first_fit, pair_fit, best_fit):
                pairs[identities] = pair_fit
    return list(pairs.values())


def _restart_at(data: WeightedData, rival: Fit, best_fit: Fit) -> Fit:
    """Return ``rival`` refitted from the values of ``best_fit`` for the parameters that both have.

    A fit may leave a value that the data do not determine at its bound. This is no fault of the rival.
    """
    known = dict(zip(_identify_parameters(best_fit.hypothesis), best_fit.x, strict=True))
    keys = _identify_parameters(rival.hypothesis)
    start = np.array([known.get(key, x) for key, x in zip(keys, rival.x, strict=True)])
    return fit_hypothesis(data, rival.hypothesis, start)


def _identify_parameters(hypothesis: Hypothesis) -> list[tuple[EffectTerm | None, str]]:
    """Return term (None for the device) and name of each parameter of ``hypothesis``."""
    terms, parameters = hypothesis.terms, hypothesis.parameters
    return [(None if p.term_index is None else terms[p.term_index], p.name) for p in parameters]


def _is_equivalent(search: ForwardSelection, reduced_fit: Fit, rival: Fit, best_fit: Fit) -> bool:
    """Return whether ``rival`` is acceptable and not decisively worse than ``best_fit``.

    Both add a term to ``reduced_fit``. A small effect improves validation trials by hardly more than the selection
    requires, or by less where the comparison of whole models has found it. Then a rival need not reach that minimum. It
    suffices that it explains them nearly as well: by about the same fraction, or such that fitted and validation trials
    together prefer ``best_fit`` by no more than twice the difference that decides in the fitted ones alone.
    """
    if _adds_only_shape(rival, best_fit):
        return False
    n = search.data.n_effective
    excess, gain = rival.bic(n) - best_fit.bic(n), reduced_fit.bic(n) - best_fit.bic(n)
    max_excess = min(MAX_EXCESS_FRACTION * gain, MAX_EXCESS_FACTOR * search.bic_threshold)
    if excess > search.bic_threshold and (
        excess > max_excess or search.has_misfit(best_fit) or search.has_misfit(rival)
    ):
        return False
    gains = search.compute_validation_gains(reduced_fit, rival)
    if not search.rejection_reason(reduced_fit, rival, gains):
        return True
    chi2 = search.compute_validation_chi2(reduced_fit, best_fit, rival).values()
    if not chi2 or excess + sum(of_rival - of_best for _, of_best, of_rival in chi2) <= 2.0 * search.bic_threshold:
        required = -MAX_VALIDATION_LOSS
    else:
        best_gains = [1.0 - of_best / of_reduced for of_reduced, of_best, _ in chi2]
        required = float(np.mean(best_gains)) - MAX_VALIDATION_LOSS
    return not search.rejection_reason(reduced_fit, rival, gains, required)


def _adds_only_shape(rival: Fit, best_fit: Fit) -> bool:
    """Return whether ``rival`` has more parameters than ``best_fit``, for the shape of a law, and gains nothing so.

    The effect of its last term has a simpler form, and AIC (Akaike, 1974) is not lower with the rival: an exponent
    that may have any value imitates other laws.
    """
    term, n_further = rival.hypothesis.terms[-1], len(rival.x) - len(best_fit.x)
    n_simplest = min(len(form.parameters) for form in term.effect_definition.forms)
    return n_further > 0 and len(term.parameters) > n_simplest and best_fit.chi2 - rival.chi2 <= AIC_PENALTY * n_further


def refine_and_simplify(search: ForwardSelection, best_fit: Fit, rng: np.random.Generator) -> tuple[Fit, bool]:
    """Return ``best_fit`` as :func:`check_convergence` does.

    Effects that end with a parameter at a bound have a simpler form, or, if that shows a misfit, a form that contains
    theirs, unless BIC is decisively higher with it.
    """
    fit, has_converged = check_convergence(search.data, best_fit, rng)
    simplified = simplify_at_bound(search.data, fit)
    if not (simplified is fit or search.has_misfit(simplified)):
        return refine_and_simplify(search, simplified, rng)
    extended, n = extend_at_bound(search.data, fit), search.data.n_effective
    if extended is None or search.has_misfit(extended) or extended.bic(n) > fit.bic(n) + search.bic_threshold:
        return fit, has_converged
    return check_convergence(search.data, extended, rng)


def check_convergence(data: WeightedData, best_fit: Fit, rng: np.random.Generator) -> tuple[Fit, bool]:
    """Refine ``best_fit`` and restart it from a perturbed point.

    Returns the better fit, and whether both fits converged and agree. The restart is :data:`RESTART_SIGMAS` standard
    errors away in each parameter, within its bounds. Where it ends elsewhere, it is refined as well: the error of
    coarse simulations depends on where a fit begins.
    """
    if not len(best_fit.x):
        return best_fit, best_fit.converged
    best_fit = fit_hypothesis(data, best_fit.hypothesis, best_fit.x, fine=True)
    # Rounding may make the variance of a poorly determined parameter negative.
    std_errors = np.sqrt(np.maximum(0.0, np.diag(np.linalg.pinv(best_fit.jacobian.T @ best_fit.jacobian))))
    signs = rng.choice([-1.0, 1.0], len(std_errors))
    offset = signs * np.maximum(RESTART_SIGMAS * std_errors, MIN_RESTART_OFFSET)
    restarted = fit_hypothesis(data, best_fit.hypothesis, best_fit.x + offset, best_fit.jacobian, reference=best_fit)
    if not (restarted.converged and _have_equal_chi2(restarted, best_fit)):
        restarted = fit_hypothesis(data, best_fit.hypothesis, restarted.x, fine=True)
    has_converged = best_fit.converged and restarted.converged and _have_equal_chi2(restarted, best_fit)
    return restarted if restarted.chi2 < best_fit.chi2 - CHI2_TOLERANCE else best_fit, has_converged


def _have_equal_chi2(first: Fit, second: Fit) -> bool:
    """Return whether two fits of one hypothesis end with the same chi squared, within :data:`CHI2_TOLERANCE`."""
    return abs(first.chi2 - second.chi2) < CHI2_TOLERANCE
