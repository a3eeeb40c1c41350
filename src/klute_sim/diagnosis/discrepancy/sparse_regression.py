"""Sparse regression of a data-driven term for the equation with a misfit that no effect explains.

:mod:`klute_sim.diagnosis.localization.equation_residuals` identifies the equation. Its misfit is written as a
combination of library functions (:mod:`klute_sim.effects.families.discrepancy_terms`). All functions are first fitted
together in simulation. The problem is nearly linear there, and backward elimination removes the least important
function one after the other. No measured signal is differentiated, and every channel is weighted by its noise. The
remaining functions are refitted together with all other parameters, and the term must pass the acceptance tests of an
effect.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, fit_hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.localization.equation_residuals import EquationResidual, select_significant_equations
from klute_sim.diagnosis.localization.joint_equations import name_equation
from klute_sim.diagnosis.selection.forward_selection import (
    BIC_THRESHOLD,
    DIVERGENCE_REASON,
    REFIT_MAX_NFEV,
    ForwardSelection,
)
from klute_sim.effects.effect import Effect
from klute_sim.effects.families import discrepancy_formulas, discrepancy_terms, joint_terms
from klute_sim.types import Array

MAX_FUNCTIONS = 4
"""Maximum number of functions in a term; longer formulas are not readable."""
FULL_LIBRARY_MAX_NFEV = 8
"""Maximum number of function evaluations of the fit of the whole library, which need not converge."""
RIDGE_ALPHA = 1e-3
"""Ridge penalty of the regression on unit-length sensitivities; it prevents similar functions from cancelling."""
MIN_RELATIVE_SENSITIVITY = 1e-6
"""Norm of a function's sensitivity over the largest, below which the function is excluded."""
DISCREPANCY_EFFECTS = {
    "supply": discrepancy_terms.UNKNOWN_PRESSURE,
    "muscle and damper": discrepancy_terms.UNKNOWN_FORCE,
    "tendon": discrepancy_terms.UNKNOWN_TENDON_FORCE,
    "ankle": discrepancy_terms.UNKNOWN_ANKLE_MOMENT,
    "hinge joint": joint_terms.UNKNOWN_JOINT_MOMENT,
    "hinge joint or its devices": joint_terms.UNKNOWN_JOINT_MOMENT,
    "slide joint": joint_terms.UNKNOWN_GUIDE_FORCE,
    "slide joint or its devices": joint_terms.UNKNOWN_GUIDE_FORCE,
}
"""Effect that is the data-driven term of each kind of equation."""
SEPARATE_KINDS = {"muscle, damper or tendon": ("muscle and damper", "tendon")}
"""Kind of equation that holds several equations -> their kinds; other kinds are one equation."""


class Support(NamedTuple):
    """A set of functions of one equation."""

    term: EffectTerm
    """Term with these functions only."""
    x0: Array
    """Predicted normalized parameters of the whole model, by linearisation."""
    predicted_bic_gain: float
    """Fall of BIC that linearisation predicts."""


class DataDrivenTermResult(NamedTuple):
    """Result of the fit of a data-driven term."""

    fit: Fit | None
    """Fit with the term; None if no term was accepted."""
    reason: str
    """Sentence that gives the reason; '' for a term that was not tested."""
    equation: str = ""
    """Name of the equation that the term belongs to."""


def add_data_driven_term(
    search: ForwardSelection,
    current: Fit,
    base_fit: Fit,
    equation_residuals: Sequence[EquationResidual],
    exclude: Collection[str] = (),
) -> DataDrivenTermResult:
    """Fit the best data-driven term for the equations with significant residuals, and add it to ``current``.

    Effects that are not in ``base_fit`` and that the term makes redundant are removed. ``exclude`` names effects that
    are not candidates.
    """
    fitted = fit_data_driven_term(search, current, equation_residuals, exclude)
    subject = f"A data-driven term in the equation of {fitted.equation}"
    if fitted.fit is None:
        return fitted
    best_fit = fitted.fit
    rejection = search.rejection_reason(current, best_fit, search.compute_validation_gains(current, best_fit))
    if rejection:
        return fitted._replace(fit=None, reason=f"{subject} was tested and rejected: {rejection}.")
    bic_gain = current.bic(search.data.n_effective) - best_fit.bic(search.data.n_effective)
    reason = f"{subject} represents what no effect of the catalogue explains (BIC falls by {bic_gain:.0f})."
    return fitted._replace(fit=search.prune(best_fit, base_fit), reason=reason)


def fit_data_driven_term(
    search: ForwardSelection,
    current: Fit,
    equation_residuals: Sequence[EquationResidual],
    exclude: Collection[str] = (),
    *,
    max_supports: int = MAX_FUNCTIONS,
) -> DataDrivenTermResult:
    """Return ``current`` with the data-driven term that explains most, before any test of acceptance.

    Only equations with significant residuals get a term. ``exclude`` names effects that are not candidates. Of the sets
    of functions, the ``max_supports`` with the largest predicted gains are fitted.
    """
    terms = list_data_driven_terms(current, equation_residuals, exclude)
    if not terms:
        cause = (
            "no equation has a significant residual"
            if equation_residuals
            else "the measured channels check no equation of the device"
        )
        return DataDrivenTermResult(None, f"No data-driven term was fitted: {cause}.")
    supports = {name: find_supports(search.data, current, term) for name, term in terms.items()}
    equation = max(supports, key=lambda name: max((s.predicted_bic_gain for s in supports[name]), default=-np.inf))
    promising = [s for s in supports[equation] if s.predicted_bic_gain > 0.5 * search.bic_threshold]
    if not promising:
        reason = (
            f"A data-driven term in the equation of {equation} was tested, but none of its functions is predicted to "
            "explain more than noise would."
        )
        return DataDrivenTermResult(None, reason, equation)
    leading = sorted(promising, key=lambda support: -support.predicted_bic_gain)[:max_supports]
    fitted = [support for support in promising if any(support is other for other in leading)]  # smallest first
    best_fit = _fit_supports(search, current, fitted)
    if best_fit is None:
        reason = f"A data-driven term in the equation of {equation} was tested, but {DIVERGENCE_REASON}."
        return DataDrivenTermResult(None, reason, equation)
    return DataDrivenTermResult(best_fit, "", equation)


def list_data_driven_terms(
    current: Fit, equation_residuals: Sequence[EquationResidual], exclude: Collection[str] = ()
) -> dict[str, EffectTerm]:
    """Return the data-driven term of each equation with a significant residual, by the name of the equation.

    Where the data cannot separate muscle and tendon, either equation may lack something. The terms have all functions
    of their library. ``exclude`` names effects that are not candidates.
    """
    can_add_effect = current.hypothesis.device.spec.can_add_effect
    return {
        name_equation(kind, equation.part): _make_library(effect, equation.part)
        for equation in select_significant_equations(equation_residuals)
        for kind in SEPARATE_KINDS.get(equation.kind, (equation.kind,))
        for effect in (DISCREPANCY_EFFECTS[kind],)
        if effect.name not in exclude and can_add_effect(effect)
    }


def _make_library(effect: Effect, part: str | None) -> EffectTerm:
    """Return the term with all functions of ``effect``, of the joint or of the device ``part`` of a mechanism."""
    term = EffectTerm(effect.name, effect.forms[0].name)
    return term._replace(part=part) if effect.kind == "mechanism" else term._replace(tendon=part)


def format_formula(fit_result: Fit) -> str:
    """Return the data-driven term of ``fit_result`` as an equation; '' if there is none."""
    for index, term in enumerate(fit_result.hypothesis.terms):
        if term.effect_definition.data_driven:
            rows = zip(fit_result.hypothesis.parameters, fit_result.values, strict=True)
            return discrepancy_formulas.format_equation(
                term.effect_definition, {p.name: value for p, value in rows if p.term_index == index}
            )
    return ""


def find_supports(data: WeightedData, current: Fit, library: EffectTerm) -> list[Support]:
    """Return ``library``, a term with all its functions, with up to :data:`MAX_FUNCTIONS` of them, smallest first."""
    n_known, form = len(current.x), library.form_definition
    hypothesis = current.hypothesis.with_term(library)
    x0 = np.concatenate([current.x, np.zeros(len(form.parameters))])
    full_fit = fit_hypothesis(data, hypothesis, x0, max_nfev=FULL_LIBRARY_MAX_NFEV)
    # Right-hand side of the linearised least-squares problem in all parameters.
    target = full_fit.jacobian @ full_fit.x - full_fit.weighted_residuals
    basis, _ = np.linalg.qr(full_fit.jacobian[:, :n_known])
    functions = full_fit.jacobian[:, n_known:] - basis @ (basis.T @ full_fit.jacobian[:, n_known:])
    orthogonal_target = target - basis @ (basis.T @ target)
    norms = np.linalg.norm(functions, axis=0)
    columns = [k for k, norm in enumerate(norms) if norm > MIN_RELATIVE_SENSITIVITY * max(1.0, norms.max())]
    while columns:
        subsets = [
            [columns[k] for k in subset]
            for subset in _eliminate_functions(functions[:, columns] / norms[columns], orthogonal_target)
        ]
        supports = [
            _create_support(data, current, full_fit, target, subset)
            for subset in subsets
            if len(subset) <= MAX_FUNCTIONS
        ]
        pairs = [
            pair for support in supports for pair in zip(support.term.parameters, support.x0[n_known:], strict=True)
        ]
        infeasible = {parameter.key for parameter, size in pairs if size < 0.0 and parameter.lower == 0.0}
        if not infeasible:
            return sorted(supports, key=lambda support: len(support.term.parameter_keys))
        columns = [k for k in columns if form.parameters[k].key not in infeasible]
    return []


def _eliminate_functions(functions: Array, target: Array) -> list[list[int]]:
    """Return column subsets of ``functions``: all, then each with the least important function removed.

    The least important function is the one without which a ridge regression on ``target`` has the smallest residual.
    """
    columns = list(range(functions.shape[1]))
    subsets = [columns]
    while len(columns) > 1:
        smaller = [[column for column in columns if column != removed] for removed in columns]
        columns = min(smaller, key=lambda subset: _compute_ridge_cost(functions[:, subset], target))
        subsets.append(columns)
    return subsets


def _compute_ridge_cost(functions: Array, target: Array) -> float:
    """Return the squared residual of the ridge regression of ``target`` on the columns of ``functions``."""
    gram = functions.T @ functions + RIDGE_ALPHA * np.eye(functions.shape[1])
    residual = target - functions @ np.linalg.solve(gram, functions.T @ target)
    return float(residual @ residual)


def _create_support(data: WeightedData, current: Fit, full_fit: Fit, target: Array, indices: Sequence[int]) -> Support:
    n_known, term = len(current.x), full_fit.hypothesis.terms[-1]
    columns = full_fit.jacobian[:, [*range(n_known), *(n_known + k for k in indices)]]
    x0 = np.linalg.lstsq(columns, target)[0].astype(np.float64)
    residual = target - columns @ x0
    bic_gain = current.chi2 - float(residual @ residual) - len(indices) * float(np.log(data.n_effective))
    keys = tuple(term.form_definition.parameters[k].key for k in indices)
    return Support(term._replace(parameter_keys=keys), x0, bic_gain)


def _fit_supports(search: ForwardSelection, current: Fit, supports: Sequence[Support]) -> Fit | None:
    """Return the smallest model whose BIC is not decisively worse than the best; None if all of them diverge."""
    fits = []
    for support in supports:
        search.report_stage(f"fitting a data-driven term of {len(support.term.parameter_keys)}")
        hypothesis = current.hypothesis.with_term(support.term)
        fits.append(fit_hypothesis(search.data, hypothesis, support.x0, max_nfev=REFIT_MAX_NFEV[0]))
    fits = [fit for fit in fits if not fit.has_diverged]
    if not fits:
        return None
    bics = [fit.bic(search.data.n_effective) for fit in fits]
    best = next(fit for fit, bic in zip(fits, bics, strict=True) if bic < min(bics) + BIC_THRESHOLD)
    return fit_hypothesis(search.data, best.hypothesis, best.x, best.jacobian, max_nfev=REFIT_MAX_NFEV[-1])
