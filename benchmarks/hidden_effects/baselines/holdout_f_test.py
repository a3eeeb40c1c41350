"""Exhaustive search with an F-test on held-out trials and a bounded false discovery rate.

After LISDD (Wang 2026, "Where is my physics wrong? Localized and identifiable discovery of model discrepancy",
arXiv:2606.23215), which selects missing terms by exhaustive hold-out and confirms them by a sample-split F-test at a
bounded false discovery rate. Its localisation to regions of the operating space is left out.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from benchmarks.hidden_effects.baselines.calibration import Calibration
from benchmarks.hidden_effects.baselines.trials import Trials, Verdict
from scipy.stats import false_discovery_control
from scipy.stats import t as student_t

from klute_sim.diagnosis.fitting.hypothesis import EffectTerm
from klute_sim.diagnosis.fitting.least_squares import Fit, linearize
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.errors import InputError
from klute_sim.types import Array

FALSE_DISCOVERY_RATE = 0.05
"""Rate of false discoveries among the accepted models (Benjamini and Hochberg 1995, J R Stat Soc B 57:289)."""


class HoldOutResult(NamedTuple):
    """A model with its test."""

    fit: Fit
    p_value: float
    """Probability of such an improvement by a model one of whose effects is not there."""
    chi2: float
    """Chi squared of the prediction of the held-out trials."""


def search_on_holdout(trials: Trials, exclude: Sequence[str]) -> Verdict:
    """Return the accepted model that predicts the validation trials best.

    Each single and each pair of :meth:`Calibration.select_switches` is fitted to the fit trials and tested on the
    validation trials: a single against the device without effects, a pair against either of its singles, of which the
    larger p-value counts.
    """
    validation = trials.with_use("validation")
    if not validation:
        raise InputError("no trial is held out for validation")
    with Calibration(trials, exclude, with_repeats=True) as calibration:
        held_out = calibration.data.with_experiments(validation)
        jacobian = linearize(held_out, calibration.base.hypothesis, calibration.base.x)[1]
        n_trial = len(jacobian) - calibration.base.hypothesis.n_prior_parameters
        predictions: dict[frozenset[EffectTerm], tuple[Fit, Array]] = {}
        switches = calibration.select_switches()
        for count in range(3):
            for terms in itertools.combinations(switches, count):
                fit = calibration.fit(terms)
                if fit is not None:
                    predictions[frozenset(terms)] = fit, _predict(held_out, fit)
        tests = []
        for key, (fit, residual) in predictions.items():
            smaller = [entry for term in key if (entry := predictions.get(key - {term}))]
            if key and len(smaller) == len(key) and np.isfinite(residual).all():
                p_values = [
                    compute_p_value(before, before - residual, jacobian[:n_trial], held_out.n_effective)
                    for _, before in smaller
                ]
                tests.append(HoldOutResult(fit, max(p_values), float(residual @ residual)))
        adjusted = false_discovery_control([test.p_value for test in tests]) if tests else np.empty(0)
        accepted = [test for test, p in zip(tests, adjusted, strict=True) if p <= FALSE_DISCOVERY_RATE]
        best = min(accepted, key=lambda test: test.chi2, default=None)
        return {
            **calibration.describe(calibration.base if best is None else best.fit),
            "p_value": None if best is None else best.p_value,
        }


def _predict(held_out: WeightedData, fit: Fit) -> Array:
    (residuals,) = held_out.compute_residuals(fit.hypothesis, [fit.x], may_diverge=True)
    return held_out.weight_residuals(residuals)


def compute_p_value(residual: Array, change: Array, jacobian: Array, n_effective: float) -> float:
    """Return the p-value of the F-test that ``change`` explains the held-out ``residual``, one-sided.

    ``change`` (samples,) was predicted without the held-out trials, so that only its amplitude is estimated there,
    beside the numbers of the device with derivatives ``jacobian`` (samples, numbers). The test is that of one added
    regressor, with as many independent samples as ``n_effective``; F is the square of t, and a negative amplitude
    contradicts the effect.
    """
    basis, _ = np.linalg.qr(jacobian)
    residual, change = (vector - basis @ (basis.T @ vector) for vector in (residual, change))
    degrees_of_freedom = n_effective - jacobian.shape[1] - 1
    norm = float(change @ change)
    if norm == 0.0 or degrees_of_freedom <= 0:
        return 1.0
    explained = float(change @ residual) ** 2 / norm
    remainder = float(residual @ residual) - explained
    t = np.sign(change @ residual) * np.sqrt(explained / (max(remainder, 1e-300) / degrees_of_freedom))
    return float(student_t.sf(t, degrees_of_freedom))
