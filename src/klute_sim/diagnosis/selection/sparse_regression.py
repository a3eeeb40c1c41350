"""Where no effect explains the data: a data-driven term at the equation that lacks something.

The equation is known by then (:mod:`klute_sim.diagnosis.selection.equation_residuals`). What it lacks is written as a combination of
functions of what acts there (:mod:`klute_sim.effects.families.discrepancy_terms`). All of them together are fitted in simulation; from
there everything is nearly linear, and sparse regression (PySINDy) takes away one after the other that is missed least.
Nothing measured has to be derived for this, and every channel weighs as its noise lets it. The few that are left are
fitted again together with all other unknowns, and the term has to pass the gates of a named effect.
"""

import warnings
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.diagnosis.experiments.base import Array
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, fit_hypothesis
from klute_sim.diagnosis.selection.equation_residuals import EquationResidual, select_significant_equations
from klute_sim.diagnosis.selection.forward_selection import BIC_THRESHOLD, REFIT_MAX_NFEV, ForwardSelection
from klute_sim.effects.effect import Effect
from klute_sim.effects.families import discrepancy_terms
from klute_sim.errors import MissingExtraError

MAX_FUNCTIONS = 4
"""In a term: more are no longer read."""
FULL_LIBRARY_MAX_NFEV = 8
"""Rounds of fitting all functions together: it only has to get near."""
RIDGE_ALPHA = 1e-3
"""Of the regression, over the length of each function's signature: only keeps twins from cancelling each other."""
MAX_REGRESSION_ITERATIONS = 50
"""Of the regression: more than there are functions in a library."""
MIN_RELATIVE_SENSITIVITY = 1e-6
"""Length of a function's change, over the longest, below which it has none."""
DISCREPANCY_EFFECTS = {
    "supply": discrepancy_terms.UNKNOWN_PRESSURE,
    "muscle and damper": discrepancy_terms.UNKNOWN_FORCE,
    "muscle, damper or tendon": discrepancy_terms.UNKNOWN_FORCE,
    "tendon": discrepancy_terms.UNKNOWN_TENDON_FORCE,
}
"""Equation -> the effect that is a term of it."""


class Support(NamedTuple):
    """Some functions of one equation, together."""

    term: EffectTerm
    x0: Array
    """All unknowns with it, in steps, if everything were linear."""
    predicted_bic_gain: float
    """By how much BIC would fall if everything were linear."""


class DiscrepancyResult(NamedTuple):
    """What became of the attempt."""

    fit: Fit | None
    """With the term; None: none was kept."""
    reason: str
    """In plain words."""


def fit_discrepancy_term(
    search: ForwardSelection,
    current: Fit,
    base_fit: Fit,
    equation_residuals: Sequence[EquationResidual],
    exclude: Collection[str] = (),
) -> DiscrepancyResult:
    """The best term that can be added to ``current``; effects of it that ``base`` lacks and that become idle go.

    The ``equations`` that lack something are tried, and the one that promises most is fitted. ``exclude`` names effects
    that are not looked for.
    """
    may_lack = current.hypothesis.device.spec.can_add_effect
    suspected = {each.name: DISCREPANCY_EFFECTS[each.name] for each in select_significant_equations(equation_residuals)}
    open_ = {name: effect for name, effect in suspected.items() if effect.name not in exclude and may_lack(effect)}
    if not open_:
        return DiscrepancyResult(
            None, "No data-driven term was looked for: it is not known which equation lacks something."
        )
    try:
        found = {name: find_supports(search.data, current, effect) for name, effect in open_.items()}
    except MissingExtraError as missing:
        return DiscrepancyResult(None, f"No data-driven term was looked for: {missing}.")
    where = max(found, key=lambda name: max((each.predicted_bic_gain for each in found[name]), default=-np.inf))
    tried = f"A data-driven term at the equation of {where} was tried"
    promising = [each for each in found[where] if each.predicted_bic_gain > 0.5 * search.bic_threshold]
    if not promising:
        return DiscrepancyResult(None, f"{tried}, but none of its functions promises to explain more than noise would.")
    best = _fit_supports(search, current, promising)
    objection = search.rejection_reason(current, best, search.compute_validation_gains(current, best))
    if objection:
        return DiscrepancyResult(None, f"{tried} and not kept: {objection}.")
    fall = current.bic(search.data.n_effective) - best.bic(search.data.n_effective)
    return DiscrepancyResult(
        search.prune(best, base_fit),
        f"A data-driven term at the equation of {where} stands in for what has no name (BIC falls by {fall:.0f}).",
    )


def format_formula(fit_result: Fit) -> str:
    """The data-driven term of ``found`` with its coefficients, in a line; '' if there is none."""
    for number, term in enumerate(fit_result.hypothesis.terms):
        if term.effect_definition.data_driven:
            rows = zip(fit_result.hypothesis.parameters, fit_result.values, strict=True)
            return discrepancy_terms.format_equation(
                term.effect_definition, {u.key: value for u, value in rows if u.term_index == number}
            )
    return ""


def find_supports(data: WeightedData, current: Fit, effect: Effect) -> list[Support]:
    """Combinations of the functions of ``effect``, the smallest first, none larger than :data:`MOST_FUNCTIONS`.

    Raises MissingExtraError without PySINDy.
    """
    regression = _create_regression()
    known, form = len(current.x), effect.forms[0]
    hypothesis = current.hypothesis.with_term(EffectTerm(effect.name, form.name))
    begin = np.concatenate([current.x, np.zeros(len(form.parameters))])
    whole = fit_hypothesis(data, hypothesis, begin, max_nfev=FULL_LIBRARY_MAX_NFEV)
    # What the weighted data ask of all unknowns, as if everything were linear from here.
    asked = whole.jacobian @ whole.x - whole.weighted_residuals
    basis, _ = np.linalg.qr(whole.jacobian[:, :known])
    functions = whole.jacobian[:, known:] - basis @ (basis.T @ whole.jacobian[:, known:])
    left = asked - basis @ (basis.T @ asked)
    lengths = np.linalg.norm(functions, axis=0)
    open_ = [k for k, length in enumerate(lengths) if length > MIN_RELATIVE_SENSITIVITY * max(1.0, lengths.max())]
    while open_:
        rows = [
            [open_[k] for k in few]
            for few in _eliminate_functions(regression, functions[:, open_] / lengths[open_], left)
        ]
        found = [_create_support(data, current, whole, asked, row) for row in rows if len(row) <= MAX_FUNCTIONS]
        pairs = [pair for each in found for pair in zip(each.term.parameters, each.x0[known:], strict=True)]
        impossible = {parameter.key for parameter, steps in pairs if steps < 0.0 and parameter.lower == 0.0}
        if not impossible:
            return sorted(found, key=lambda each: len(each.term.parameter_keys))
        open_ = [k for k in open_ if form.parameters[k].key not in impossible]
    return []


def _create_regression() -> Any:
    try:
        from pysindy.optimizers import SSR
    except ModuleNotFoundError:
        raise MissingExtraError("a data-driven term", "sparse") from None
    return SSR(criteria="model_residual", alpha=RIDGE_ALPHA, max_iter=MAX_REGRESSION_ITERATIONS)


def _eliminate_functions(regression: Any, functions: Array, target: Array) -> list[list[int]]:
    """Columns of ``functions``: all, then ever fewer; the one that ``left`` is explained without best goes first."""
    every = list(range(functions.shape[1]))
    if len(every) == 1:
        return [every]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of coefficients that are nearly none
        regression.fit(functions, target[:, np.newaxis])
    # The first entry is overwritten by the next: it was that of all of them.
    return [every, *(np.flatnonzero(row[0]).tolist() for row in regression.history_[1:])]


def _create_support(data: WeightedData, current: Fit, full_fit: Fit, target: Array, indices: Sequence[int]) -> Support:
    known, term = len(current.x), full_fit.hypothesis.terms[-1]
    columns = full_fit.jacobian[:, [*range(known), *(known + k for k in indices)]]
    start = np.linalg.lstsq(columns, target)[0].astype(np.float64)
    left = target - columns @ start
    fall = current.chi2 - float(left @ left) - len(indices) * float(np.log(data.n_effective))
    keys = tuple(term.form_definition.parameters[k].key for k in indices)
    return Support(EffectTerm(term.effect, term.form, None, keys), start, fall)


def _fit_supports(search: ForwardSelection, current: Fit, supports: Sequence[Support]) -> Fit:
    """The smallest of ``promising`` whose BIC is no worse than the best by what decides."""
    fits = []
    for each in supports:
        search.progress(f"fitting a data-driven term of {len(each.term.parameter_keys)}")
        fits.append(
            fit_hypothesis(search.data, current.hypothesis.with_term(each.term), each.x0, max_nfev=REFIT_MAX_NFEV[0])
        )
    criteria = [one.bic(search.data.n_effective) for one in fits]
    best = next(one for one, own in zip(fits, criteria, strict=True) if own < min(criteria) + BIC_THRESHOLD)
    return fit_hypothesis(search.data, best.hypothesis, best.x, best.jacobian, max_nfev=REFIT_MAX_NFEV[-1])
