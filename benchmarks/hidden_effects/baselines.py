"""Two other ways to name a missing effect, on the same datasets, judged by the same rules.

``plain_bic`` is what a careful engineer does without the workflow: its catalogue, simulator and fitter, but the
textbook's BIC decides alone. ``sindy`` is PySINDy on the force balance (:mod:`force_balance`). Both answer with what
``verdict.json`` has of it: the verdict, effects, alternatives, and the gap on trials that no fit saw.
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
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment, Simulator
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData, fit_hypothesis
from klute_sim.diagnosis.noise import repeats as noises
from klute_sim.diagnosis.noise.repeats import Autocorrelation, Noise, Residuals
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection, select_shortlist
from klute_sim.diagnosis.selection.screening import list_candidate_terms, screen_candidates
from klute_sim.errors import InputError

MAX_EFFECTS = 3
"""Of plain BIC: as many as the workflow may name."""
# Settings of the sparse regression, from datasets of a seed that no result is shown of; others do about as well there.
THRESHOLDS = (0.2, 0.4, 0.8, 1.6)
"""In typical sizes of the terms."""
RIDGE_PENALTY = 1.0
"""A term of typical size is believed like one standard deviation."""
MAX_RMS_RATIO = 1.1
"""How much worse than the best on selection trials a sparser regression may be, as a ratio of rms."""
PYSINDY_INSTALL_HINT = (
    "PySINDy is not installed: install it with 'pip install --group benchmark' (pip 25.1 or later) or "
    "'uv pip install --group benchmark'."
)

Verdict = dict[str, Any]


def require_pysindy() -> None:
    """Raise ModuleNotFoundError, with how to install it, if there is no PySINDy."""
    if importlib.util.find_spec("pysindy") is None:
        raise ModuleNotFoundError(PYSINDY_INSTALL_HINT)


def _as_timed_method(method: Callable[[Dataset, list[Experiment], Sequence[str]], Verdict]) -> Callable[..., Verdict]:
    """Read the dataset for ``method`` and note the seconds; what cannot be read is refused, as the program does."""

    def run(folder: Path, exclude: Sequence[str] = ()) -> Verdict:
        begin = time.perf_counter()
        try:
            dataset = load_dataset(folder)
            found = method(dataset, prepare_experiments(dataset, split_dataset(dataset)), exclude)
        except InputError as error:
            found = {"verdict": "insufficient-data", "effects": [], "said": str(error)}
        return {"alternatives": [], "gap": {}, **found, "s": time.perf_counter() - begin}

    return functools.update_wrapper(run, method)


@_as_timed_method
def select_by_bic(dataset: Dataset, experiments: list[Experiment], exclude: Sequence[str]) -> Verdict:
    """Greedy forward selection by ``sum over channels of n log(RSS / n) + k log n``, every sample counted.

    Repeats are more samples and nothing else. No selection trials, no test of what is left, no rivals. ``exclude``
    names effects that are not looked for.
    """
    fitted = [e for e in experiments if e.use == "fit"]
    bench = Simulator()
    try:
        base, evidence = _refit_base(dataset, fitted, bench)
        current, open_ = base, list_candidate_terms(evidence, dataset.device, (), exclude)
        for _ in range(MAX_EFFECTS):
            evidence = WeightedData(bench, fitted, _estimate_noise(current.residuals))
            best = _find_best_refit(evidence, current, open_)
            if best is None or _compute_bic(best) >= _compute_bic(current):
                break
            current, added = best, best.hypothesis.terms[-1]
            open_ = [t for t in open_ if (t.effect, t.channel) != (added.effect, added.channel)]
        shown = [e for e in experiments if e.use == "show"]
        before, after = (
            evidence.with_experiments(shown).compute_residuals(f.hypothesis, [f.x])[0] for f in (base, current)
        )
    finally:
        bench.close()
    own = current.hypothesis.terms[len(base.hypothesis.terms) :]
    effects = [
        {
            "name": term.effect,
            "form": term.form,
            "channel": term.channel,
            "parameters": {
                u.key: {"value": value}
                for u, value in zip(current.hypothesis.parameters, current.values, strict=True)
                if u.term_index == number
            },
        }
        for number, term in enumerate(own)
    ]
    return {
        "verdict": "named" if own else "nothing-missing",
        "effects": effects,
        "gap": _compute_gap(shown, before, after),
    }


def _refit_base(dataset: Dataset, fit_experiments: list[Experiment], simulator: Simulator) -> tuple[Fit, WeightedData]:
    """The device without effects; channels weighed by what is left of them, in turn."""
    plain = Hypothesis(dataset.device, tuple(dataset.uncertainties.items()), ())
    residuals: Residuals = WeightedData(simulator, fit_experiments, {}).compute_residuals(
        plain, [plain.initial_point()]
    )[0]
    steps = plain.initial_point()
    for _ in range(2):
        evidence = WeightedData(simulator, fit_experiments, _estimate_noise(residuals))
        sizes = tuple((channel, each.std) for channel, each in evidence.noise.items())
        found = fit_hypothesis(evidence, Hypothesis(plain.device, plain.uncertainties, sizes), steps)
        residuals, steps = found.residuals, found.x
    return found, evidence


def _join_channels(residuals: Residuals) -> dict[str, np.ndarray]:
    channels = dict.fromkeys(channel for found in residuals for channel in found)
    return {channel: np.concatenate([f[channel] for f in residuals if channel in f]) for channel in channels}


def _estimate_noise(residuals: Residuals) -> dict[str, Noise]:
    """The textbook's noise: what the fit leaves, every sample on its own."""
    return {
        c: Noise(_rms(values), (Autocorrelation(1e-9, 1.0, len(values)),))
        for c, values in _join_channels(residuals).items()
    }


def _compute_bic(candidate: Fit) -> float:
    """BIC with a variance of each channel's own; constants left out."""
    joined = _join_channels(candidate.residuals).values()
    count = sum(map(len, joined))
    return sum(len(v) * np.log(np.mean(v * v)) for v in joined) + len(candidate.x) * np.log(count)


def _find_best_refit(evidence: WeightedData, current: Fit, open_terms: Sequence[EffectTerm]) -> Fit | None:
    chosen = select_shortlist(screen_candidates(evidence, current, open_terms))
    refits = ForwardSelection(evidence, [], open_terms).refit_candidates(current, chosen)
    return min(refits, key=_compute_bic, default=None)


@_as_timed_method
def regress_sparsely(dataset: Dataset, experiments: list[Experiment], exclude: Sequence[str]) -> Verdict:
    """Sparse regression (PySINDy's STLSQ) of the force that the balance lacks on :data:`force_balance.TERMS`.

    What the device's uncertain numbers can do, within what is believed of them, is taken off first. The threshold is
    the sparsest that selection trials hardly mind. A term whose coefficient has an impossible sign is struck and the
    regression repeated. Terms that several effects share make the verdict ambiguous. ``exclude`` names effects that
    are not looked for. Raises ModuleNotFoundError without PySINDy.
    """
    require_pysindy()
    having = [e for e in experiments if {"force", "pressure"} <= e.measured.keys()]
    measured = any("muscle_length" in e.measured for e in having)
    trials = {use: [compute_balance(dataset, e) for e in having if e.use == use] for use in ("fit", "select", "show")}
    if not sum(len(b.missing_force) for b in trials["fit"]):
        raise InputError("no trial has a tendon under load")
    judges = trials["select"] or trials["fit"]
    system = RegressionSystem(trials["fit"])
    tried = [np.zeros(len(BALANCE_TERMS)), *(system.solve_sparse(t, measured, exclude) for t in THRESHOLDS)]
    judged = [_rms(np.concatenate(system.residuals(judges, row))) for row in tried]
    chosen = min(
        (row for row, size in zip(tried, judged, strict=True) if size <= MAX_RMS_RATIO * min(judged)),
        key=np.count_nonzero,
    )
    kept = [(BALANCE_TERMS[i], chosen[i]) for i in np.flatnonzero(chosen)]
    sets = _enumerate_effect_sets([term.possible_effects(measured, exclude, steps > 0.0) for term, steps in kept])
    before, after = ([{"force": f} for f in system.residuals(trials["show"], row)] for row in (tried[0], chosen))
    return {
        "verdict": "ambiguous" if len(sets) > 1 else ("named" if kept else "nothing-missing"),
        "effects": [meaning._asdict() for meaning in sets[0]],
        "alternatives": [[format_effect(m._asdict()) for m in other] for other in sets[1:]],
        "terms": {term.formula: term.typical_size * steps for term, steps in kept},
        "gap": _compute_gap([b.experiment for b in trials["show"]], before, after),
    }


class RegressionSystem:
    """What the fitted trials lack, with the device's uncertain numbers taken off."""

    def __init__(self, trials: Sequence[ForceBalance]) -> None:
        """In units of the noise that repeats show; of what is lacking itself, where nothing was repeated."""
        lacking, base, self._terms = (
            np.concatenate([getattr(b, name) for b in trials]) for name in ("lacking", "base", "terms")
        )
        repeated = noises.estimate_noise_from_repeats(
            [b.experiment for b in trials], [{"force": b.missing_force} for b in trials]
        ).values()
        self._noise = sum(each.std / np.sqrt(each.independent_fraction) for each in repeated) or _rms(lacking)
        self._missing_force = lacking
        # Each number of the device is believed to one standard deviation: a row that asks for 0.
        self._prior_rows = np.vstack([base / self._noise, np.eye(base.shape[1])])

    def _pad_with_prior(self, columns: np.ndarray) -> np.ndarray:
        return np.vstack([columns / self._noise, np.zeros((self._prior_rows.shape[1], columns.shape[1]))])

    def _project_out_base(self, columns: np.ndarray) -> np.ndarray:
        """What is left of ``columns`` [N] once the numbers of the device have taken what they can."""
        basis, _ = np.linalg.qr(self._prior_rows)
        padded = self._pad_with_prior(columns)
        return padded - basis @ (basis.T @ padded)

    def solve_sparse(self, threshold: float, length_measured: bool, exclude: Sequence[str]) -> np.ndarray:
        """Coefficients of all terms, in typical sizes."""
        from pysindy.optimizers import STLSQ

        target, terms = self._project_out_base(self._missing_force[:, None]), self._project_out_base(self._terms)
        found = np.zeros(len(BALANCE_TERMS))
        open_ = [
            i
            for i, term in enumerate(BALANCE_TERMS)
            if term.possible_effects(length_measured, exclude, is_positive=True)
        ]
        while open_:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # that nothing is left is an answer
                fitted = (
                    STLSQ(threshold=threshold, alpha=RIDGE_PENALTY, unbias=False).fit(terms[:, open_], target).coef_[0]
                )
            impossible = {
                i
                for i, c in zip(open_, fitted, strict=True)
                if c < 0 and not BALANCE_TERMS[i].possible_effects(length_measured, exclude, False)
            }
            if not impossible:
                found[open_] = fitted
                break
            open_ = [i for i in open_ if i not in impossible]
        return found

    def residuals(self, trials: Sequence[ForceBalance], coefficients: np.ndarray) -> list[np.ndarray]:
        """What ``trials`` lack [N] with the terms' coefficients in ``row`` and the device refitted beside them."""
        rest = self._pad_with_prior((self._missing_force - self._terms @ coefficients)[:, None])[:, 0]
        base = np.linalg.lstsq(self._prior_rows, rest, rcond=None)[0]
        return [b.missing_force - b.base_columns @ base - b.term_columns @ coefficients for b in trials]


def _enumerate_effect_sets(choices: Sequence[Sequence[CandidateEffect]]) -> list[list[CandidateEffect]]:
    """Every way to give each term one of its meanings, as sets of effects; one empty set for no terms."""
    found = {}
    for picked in itertools.product(*choices):
        named = {format_effect(m._asdict()): m for m in picked}  # two terms of one effect are one effect
        found.setdefault(tuple(sorted(named)), list(named.values()))
    return list(found.values())


def _compute_gap(
    test_experiments: Sequence[Experiment], before: Residuals, after: Residuals
) -> dict[str, dict[str, Any]]:
    """As in ``verdict.json``; of channels that were repeated."""
    floors, old, new = (
        noises.estimate_noise_from_repeats(test_experiments, after),
        _join_channels(before),
        _join_channels(after),
    )
    return {
        channel: {
            "unit": CHANNEL_UNITS[channel][0],
            "before": _rms(old[channel]) / CHANNEL_UNITS[channel][1],
            "after": _rms(new[channel]) / CHANNEL_UNITS[channel][1],
            "floor": floor.std / CHANNEL_UNITS[channel][1],
        }
        for channel, floor in floors.items()
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values * values)))
