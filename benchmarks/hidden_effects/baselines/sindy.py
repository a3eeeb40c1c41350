"""Sparse regression of the missing force with PySINDy (Brunton et al. 2016, PNAS 113:3932).

Settings were chosen on datasets of an otherwise unused seed, where others perform similarly.
"""

import itertools
import warnings
from collections.abc import Sequence

import numpy as np
from benchmarks.hidden_effects.baselines.force_balance import BALANCE_TERMS, CandidateEffect
from benchmarks.hidden_effects.baselines.regression_system import RegressionSystem, compute_balances
from benchmarks.hidden_effects.baselines.trials import Trials, Verdict, compute_rms
from benchmarks.hidden_effects.score import format_effect

from klute_sim.types import Array

THRESHOLDS = (0.2, 0.4, 0.8, 1.6)
"""Thresholds in typical sizes of the terms."""
RIDGE_PENALTY = 1.0
"""Ridge penalty; a coefficient of typical size costs as much as one standard deviation."""
MAX_RMS_RATIO = 1.1
"""Largest RMS on validation trials, relative to the best regression, of a sparser regression that is accepted."""


def regress_sparsely(trials: Trials, exclude: Sequence[str]) -> Verdict:
    """Regress the missing force on :data:`force_balance.BALANCE_TERMS` by PySINDy's STLSQ.

    The influence of the uncertain device numbers, within their uncertainty, is projected off first. The threshold is
    the sparsest with nearly the best RMS on validation trials. A term with a coefficient of impossible sign is removed
    and the regression repeated. Terms of several effects make the verdict indistinguishable.
    """
    balances = compute_balances(trials)
    system, measured = RegressionSystem(balances.fit), balances.is_length_measured
    validation = balances.validation or balances.fit
    rows = [np.zeros(len(BALANCE_TERMS)), *(solve_sparse(system, t, measured, exclude) for t in THRESHOLDS)]
    errors = [compute_rms(np.concatenate(system.compute_residuals(validation, row))) for row in rows]
    best_row = min(
        (row for row, size in zip(rows, errors, strict=True) if size <= MAX_RMS_RATIO * min(errors)),
        key=np.count_nonzero,
    )
    terms = [(BALANCE_TERMS[i], best_row[i]) for i in np.flatnonzero(best_row)]
    effect_sets = _enumerate_effect_sets(
        [term.possible_effects(measured, exclude, steps > 0.0) for term, steps in terms]
    )
    before, after = (system.compute_residuals(balances.test, row) for row in (rows[0], best_row))
    return {
        "verdict": "indistinguishable" if len(effect_sets) > 1 else ("identified" if terms else "nothing-missing"),
        "effects": [meaning._asdict() for meaning in effect_sets[0]],
        "alternatives": [[format_effect(m._asdict()) for m in other] for other in effect_sets[1:]],
        "terms": {term.formula: term.typical_size * steps for term, steps in terms},
        "gap": balances.compute_test_gap(before, after),
    }


def solve_sparse(system: RegressionSystem, threshold: float, length_measured: bool, exclude: Sequence[str]) -> Array:
    """Return the coefficients of all terms in typical sizes."""
    from pysindy.optimizers import STLSQ

    target, terms = (
        system.project_out_numbers(columns) for columns in (system.missing_force[:, None], system.term_columns)
    )
    coefficients = np.zeros(len(BALANCE_TERMS))
    candidates = [
        i for i, term in enumerate(BALANCE_TERMS) if term.possible_effects(length_measured, exclude, is_positive=True)
    ]
    while candidates:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an empty solution is a valid answer
            fitted_coefficients = (
                STLSQ(threshold=threshold, alpha=RIDGE_PENALTY, unbias=False).fit(terms[:, candidates], target).coef_[0]
            )
        impossible = {
            i
            for i, c in zip(candidates, fitted_coefficients, strict=True)
            if c < 0 and not BALANCE_TERMS[i].possible_effects(length_measured, exclude, False)
        }
        if not impossible:
            coefficients[candidates] = fitted_coefficients
            break
        candidates = [i for i in candidates if i not in impossible]
    return coefficients


def _enumerate_effect_sets(choices: Sequence[Sequence[CandidateEffect]]) -> list[list[CandidateEffect]]:
    """Return all assignments of one effect to each term as sets of effects; one empty set without terms."""
    effect_sets: dict[tuple[str, ...], list[CandidateEffect]] = {}
    for assignment in itertools.product(*choices):
        effects = {format_effect(m._asdict()): m for m in assignment}  # terms of the same effect count once
        effect_sets.setdefault(tuple(sorted(effects)), list(effects.values()))
    return list(effect_sets.values())
