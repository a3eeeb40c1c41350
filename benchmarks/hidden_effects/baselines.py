"""Two baseline methods that identify a missing effect on the same datasets under the same rules.

``select_by_bic`` is a careful engineer's approach without the workflow: the catalogue, simulator and fit of the
package, but the textbook BIC decides alone. ``regress_sparsely`` applies PySINDy to the force balance
(:mod:`force_balance`). Both return the same entries as ``verdict.json``: the verdict, effects, alternatives, and the
gap on the test trials.
"""

import functools
import importlib.util
import itertools
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.hidden_effects.force_balance import BALANCE_TERMS, CandidateEffect, ForceBalance, compute_balance
from benchmarks.hidden_effects.score import format_effect

from klute_sim.datasets.dataset import Dataset, load_dataset, split_dataset
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, fit_hypothesis
from klute_sim.diagnosis.noise import repeats as noises
from klute_sim.diagnosis.noise.autocorrelation import Autocorrelation
from klute_sim.diagnosis.noise.repeats import Noise, Residuals
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection, select_shortlist
from klute_sim.diagnosis.selection.screening import list_candidate_terms, screen_candidates
from klute_sim.errors import InputError

MAX_EFFECTS = 3
"""Largest number of effects of the BIC, equal to that of the workflow."""
# Settings of the sparse regression, chosen on datasets of an otherwise unused seed, where others perform similarly.
THRESHOLDS = (0.2, 0.4, 0.8, 1.6)
"""Thresholds in typical sizes of the terms."""
RIDGE_PENALTY = 1.0
"""Ridge penalty; a coefficient of typical size costs as much as one standard deviation."""
MAX_RMS_RATIO = 1.1
"""Largest RMS on validation trials, relative to the best regression, of a sparser regression that is accepted."""
PYSINDY_INSTALL_HINT = (
    "PySINDy is not installed: install it with 'pip install --group benchmark' (pip 25.1 or later) or "
    "'uv pip install --group benchmark'."
)

Verdict = dict[str, Any]


def require_pysindy() -> None:
    """Raise ModuleNotFoundError with installation advice if PySINDy is missing."""
    if importlib.util.find_spec("pysindy") is None:
        raise ModuleNotFoundError(PYSINDY_INSTALL_HINT)


def _as_timed_method(method: Callable[[Dataset, list[Experiment], Sequence[str]], Verdict]) -> Callable[..., Verdict]:
    """Return ``method`` as a function of the dataset folder that adds the duration and refuses unreadable datasets."""

    def run(folder: Path, exclude: Sequence[str] = ()) -> Verdict:
        start = time.perf_counter()
        try:
            dataset = load_dataset(folder)
            answer = method(dataset, prepare_experiments(dataset, split_dataset(dataset)), exclude)
        except InputError as error:
            answer = {"verdict": "insufficient-data", "effects": [], "said": str(error)}
        return {"alternatives": [], "gap": {}, **answer, "s": time.perf_counter() - start}

    return functools.update_wrapper(run, method)


@_as_timed_method
def select_by_bic(dataset: Dataset, experiments: list[Experiment], exclude: Sequence[str]) -> Verdict:
    """Greedy forward selection by ``sum over channels of n log(RSS / n) + k log n`` over all samples.

    Repeats only add samples. There are no validation trials, no residual tests and no equivalent models. Effects in
    ``exclude`` are not considered.
    """
    fit_experiments = [e for e in experiments if e.use == "fit"]
    simulator = Simulator()
    try:
        base, evidence = _refit_base(dataset, fit_experiments, simulator)
        current, candidates = base, list_candidate_terms(evidence, dataset.device, (), exclude)
        for _ in range(MAX_EFFECTS):
            evidence = WeightedData(simulator, fit_experiments, _estimate_noise(current.residuals))
            best = _find_best_refit(evidence, current, candidates)
            if best is None or _compute_bic(best) >= _compute_bic(current):
                break
            current, new_term = best, best.hypothesis.terms[-1]
            candidates = [t for t in candidates if (t.effect, t.channel) != (new_term.effect, new_term.channel)]
        test_experiments = [e for e in experiments if e.use == "test"]
        before, after = (
            evidence.with_experiments(test_experiments).compute_residuals(f.hypothesis, [f.x])[0]
            for f in (base, current)
        )
    finally:
        simulator.close()
    added_terms = current.hypothesis.terms[len(base.hypothesis.terms) :]
    effects = [
        {
            "name": term.effect,
            "form": term.form,
            "channel": term.channel,
            "parameters": {
                u.name: {"value": value}
                for u, value in zip(current.hypothesis.parameters, current.values, strict=True)
                if u.term_index == number
            },
        }
        for number, term in enumerate(added_terms)
    ]
    return {
        "verdict": "identified" if added_terms else "nothing-missing",
        "effects": effects,
        "gap": _compute_gap(test_experiments, before, after),
    }


def _refit_base(dataset: Dataset, fit_experiments: list[Experiment], simulator: Simulator) -> tuple[Fit, WeightedData]:
    """Fit the device without effects; its residuals weight the channels, alternately."""
    hypothesis = Hypothesis(dataset.device, tuple(dataset.uncertainties.items()), ())
    residuals: Residuals = WeightedData(simulator, fit_experiments, {}).compute_residuals(
        hypothesis, [hypothesis.initial_point()]
    )[0]
    steps = hypothesis.initial_point()
    for _ in range(2):
        evidence = WeightedData(simulator, fit_experiments, _estimate_noise(residuals))
        deviations = tuple((channel, noise.std) for channel, noise in evidence.noise.items())
        result = fit_hypothesis(evidence, Hypothesis(hypothesis.device, hypothesis.uncertainties, deviations), steps)
        residuals, steps = result.residuals, result.x
    return result, evidence


def _join_channels(residuals: Residuals) -> dict[str, np.ndarray]:
    channels = dict.fromkeys(channel for residual in residuals for channel in residual)
    return {
        channel: np.concatenate([residual[channel] for residual in residuals if channel in residual])
        for channel in channels
    }


def _estimate_noise(residuals: Residuals) -> dict[str, Noise]:
    """Return the textbook noise: residuals of the fit, independent in every sample."""
    return {
        c: Noise(_rms(values), (Autocorrelation(1e-9, 1.0, len(values)),))
        for c, values in _join_channels(residuals).items()
    }


def _compute_bic(candidate: Fit) -> float:
    """Return the BIC with a separate variance of each channel, without constants."""
    joined = _join_channels(candidate.residuals).values()
    count = sum(map(len, joined))
    return sum(len(v) * np.log(np.mean(v * v)) for v in joined) + len(candidate.x) * np.log(count)


def _find_best_refit(evidence: WeightedData, current: Fit, open_terms: Sequence[EffectTerm]) -> Fit | None:
    chosen = select_shortlist(screen_candidates(evidence, current, open_terms))
    refits = ForwardSelection(evidence, [], open_terms).refit_candidates(current, chosen)
    return min(refits, key=_compute_bic, default=None)


@_as_timed_method
def regress_sparsely(dataset: Dataset, experiments: list[Experiment], exclude: Sequence[str]) -> Verdict:
    """Sparse regression (PySINDy's STLSQ) of the missing force on :data:`force_balance.BALANCE_TERMS`.

    The influence of the uncertain device numbers, within their uncertainty, is projected off first. The threshold is
    the sparsest with nearly the best RMS on validation trials. A term with a coefficient of impossible sign is removed
    and the regression repeated. Terms of several effects make the verdict indistinguishable. Effects in ``exclude`` are
    not considered. Raises ModuleNotFoundError without PySINDy.
    """
    require_pysindy()
    usable = [e for e in experiments if {"force", "pressure"} <= e.measured.keys()]
    measured = any("muscle_length" in e.measured for e in usable)
    trials = {
        use: [compute_balance(dataset, e) for e in usable if e.use == use] for use in ("fit", "validation", "test")
    }
    if not sum(len(b.missing_force) for b in trials["fit"]):
        raise InputError("no trial has a tendon under load")
    validation_balances = trials["validation"] or trials["fit"]
    system = RegressionSystem(trials["fit"])
    rows = [np.zeros(len(BALANCE_TERMS)), *(system.solve_sparse(t, measured, exclude) for t in THRESHOLDS)]
    errors = [_rms(np.concatenate(system.residuals(validation_balances, row))) for row in rows]
    best_row = min(
        (row for row, size in zip(rows, errors, strict=True) if size <= MAX_RMS_RATIO * min(errors)),
        key=np.count_nonzero,
    )
    terms = [(BALANCE_TERMS[i], best_row[i]) for i in np.flatnonzero(best_row)]
    effect_sets = _enumerate_effect_sets(
        [term.possible_effects(measured, exclude, steps > 0.0) for term, steps in terms]
    )
    before, after = ([{"force": f} for f in system.residuals(trials["test"], row)] for row in (rows[0], best_row))
    return {
        "verdict": "indistinguishable" if len(effect_sets) > 1 else ("identified" if terms else "nothing-missing"),
        "effects": [meaning._asdict() for meaning in effect_sets[0]],
        "alternatives": [[format_effect(m._asdict()) for m in other] for other in effect_sets[1:]],
        "terms": {term.formula: term.typical_size * steps for term, steps in terms},
        "gap": _compute_gap([b.experiment for b in trials["test"]], before, after),
    }


class RegressionSystem:
    """Missing force of the fit trials after projection of the uncertain device numbers."""

    def __init__(self, trials: Sequence[ForceBalance]) -> None:
        """Set up the system in units of the noise of repeats, or of the missing force itself without repeats."""
        missing_force = np.concatenate([b.missing_force for b in trials])
        base_columns = np.concatenate([b.base_columns for b in trials])
        self._terms = np.concatenate([b.term_columns for b in trials])
        repeat_noise = noises.estimate_noise_from_repeats(
            [b.experiment for b in trials], [{"force": b.missing_force} for b in trials]
        ).values()
        self._noise = sum(noise.std / np.sqrt(noise.independent_fraction) for noise in repeat_noise) or _rms(
            missing_force
        )
        self._missing_force = missing_force
        # The prior of each device number is one standard deviation: a row with target 0.
        self._prior_rows = np.vstack([base_columns / self._noise, np.eye(base_columns.shape[1])])

    def _pad_with_prior(self, columns: np.ndarray) -> np.ndarray:
        return np.vstack([columns / self._noise, np.zeros((self._prior_rows.shape[1], columns.shape[1]))])

    def _project_out_base(self, columns: np.ndarray) -> np.ndarray:
        """Return ``columns`` [N] without the part that the device numbers can reproduce."""
        basis, _ = np.linalg.qr(self._prior_rows)
        padded = self._pad_with_prior(columns)
        return padded - basis @ (basis.T @ padded)

    def solve_sparse(self, threshold: float, length_measured: bool, exclude: Sequence[str]) -> np.ndarray:
        """Return the coefficients of all terms in typical sizes."""
        from pysindy.optimizers import STLSQ

        target, terms = self._project_out_base(self._missing_force[:, None]), self._project_out_base(self._terms)
        coefficients = np.zeros(len(BALANCE_TERMS))
        candidates = [
            i
            for i, term in enumerate(BALANCE_TERMS)
            if term.possible_effects(length_measured, exclude, is_positive=True)
        ]
        while candidates:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # an empty solution is a valid answer
                fitted_coefficients = (
                    STLSQ(threshold=threshold, alpha=RIDGE_PENALTY, unbias=False)
                    .fit(terms[:, candidates], target)
                    .coef_[0]
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

    def residuals(self, trials: Sequence[ForceBalance], coefficients: np.ndarray) -> list[np.ndarray]:
        """Return the residual force [N] of ``trials`` for term ``coefficients``, with the device numbers refitted."""
        remaining = self._pad_with_prior((self._missing_force - self._terms @ coefficients)[:, None])[:, 0]
        base_coefficients = np.linalg.lstsq(self._prior_rows, remaining, rcond=None)[0]
        return [b.missing_force - b.base_columns @ base_coefficients - b.term_columns @ coefficients for b in trials]


def _enumerate_effect_sets(choices: Sequence[Sequence[CandidateEffect]]) -> list[list[CandidateEffect]]:
    """Return all assignments of one effect to each term as sets of effects; one empty set without terms."""
    effect_sets = {}
    for assignment in itertools.product(*choices):
        effects = {format_effect(m._asdict()): m for m in assignment}  # terms of the same effect count once
        effect_sets.setdefault(tuple(sorted(effects)), list(effects.values()))
    return list(effect_sets.values())


def _compute_gap(
    test_experiments: Sequence[Experiment], before: Residuals, after: Residuals
) -> dict[str, dict[str, Any]]:
    """Return the gap as in ``verdict.json``, for channels with repeats."""
    floors, old, new = (
        noises.estimate_noise_from_repeats(test_experiments, after),
        _join_channels(before),
        _join_channels(after),
    )
    return {
        channel: {
            "unit": CHANNEL_UNITS[channel][0],
            "refitted": _rms(old[channel]) / CHANNEL_UNITS[channel][1],
            "after": _rms(new[channel]) / CHANNEL_UNITS[channel][1],
            "floor": floor.std / CHANNEL_UNITS[channel][1],
        }
        for channel, floor in floors.items()
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values * values)))
