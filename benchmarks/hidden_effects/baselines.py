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
from force_balance import TERMS, Balance, Meaning, balance
from score import label

from klute_sim.dataset.dataset import Dataset, read, split
from klute_sim.diagnose import noise as noises
from klute_sim.diagnose.experiment import UNITS, Bench, Experiment
from klute_sim.diagnose.fit import Evidence, Fit, fit
from klute_sim.diagnose.hypothesis import Hypothesis, Term
from klute_sim.diagnose.noise import Alike, Noise, Residuals
from klute_sim.diagnose.prepare import prepare
from klute_sim.diagnose.screen import screen, terms
from klute_sim.diagnose.search import Search, shortlist
from klute_sim.errors import InputError

MOST_EFFECTS = 3
"""Of plain BIC: as many as the workflow may name."""
# Settings of the sparse regression, from datasets of a seed that no result is shown of; others do about as well there.
THRESHOLDS = (0.2, 0.4, 0.8, 1.6)
"""In typical sizes of the terms."""
RIDGE = 1.0
"""A term of typical size is believed like one standard deviation."""
TOLERATED = 1.1
"""How much worse than the best on selection trials a sparser regression may be, as a ratio of rms."""
HOW_TO_GET_PYSINDY = (
    "PySINDy is not installed: install it with 'pip install --group benchmark' (pip 25.1 or later) or "
    "'uv pip install --group benchmark'."
)

Verdict = dict[str, Any]


def need_pysindy() -> None:
    """Raise ModuleNotFoundError, with how to install it, if there is no PySINDy."""
    if importlib.util.find_spec("pysindy") is None:
        raise ModuleNotFoundError(HOW_TO_GET_PYSINDY)


def _timed(method: Callable[[Dataset, list[Experiment], Sequence[str]], Verdict]) -> Callable[..., Verdict]:
    """Read the dataset for ``method`` and note the seconds; what cannot be read is refused, as the program does."""

    def run(folder: Path, exclude: Sequence[str] = ()) -> Verdict:
        begin = time.perf_counter()
        try:
            dataset = read(folder)
            found = method(dataset, prepare(dataset, split(dataset)), exclude)
        except InputError as error:
            found = {"verdict": "insufficient-data", "effects": [], "said": str(error)}
        return {"alternatives": [], "gap": {}, **found, "s": time.perf_counter() - begin}

    return functools.update_wrapper(run, method)


@_timed
def plain_bic(dataset: Dataset, experiments: list[Experiment], exclude: Sequence[str]) -> Verdict:
    """Greedy forward selection by ``sum over channels of n log(RSS / n) + k log n``, every sample counted.

    Repeats are more samples and nothing else. No selection trials, no test of what is left, no rivals. ``exclude``
    names effects that are not looked for.
    """
    fitted = [e for e in experiments if e.use == "fit"]
    bench = Bench()
    try:
        base, evidence = _refitted(dataset, fitted, bench)
        current, open_ = base, terms(evidence, dataset.device, (), exclude)
        for _ in range(MOST_EFFECTS):
            evidence = Evidence(bench, fitted, _weights(current.residuals))
            best = _best(evidence, current, open_)
            if best is None or _classic(best) >= _classic(current):
                break
            current, added = best, best.hypothesis.terms[-1]
            open_ = [t for t in open_ if (t.effect, t.channel) != (added.effect, added.channel)]
        shown = [e for e in experiments if e.use == "show"]
        before, after = (evidence.on(shown).residuals(f.hypothesis, [f.steps])[0] for f in (base, current))
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
                for u, value in zip(current.hypothesis.unknowns, current.values, strict=True)
                if u.term == number
            },
        }
        for number, term in enumerate(own)
    ]
    return {"verdict": "named" if own else "nothing-missing", "effects": effects, "gap": _gap(shown, before, after)}


def _refitted(dataset: Dataset, fitted: list[Experiment], bench: Bench) -> tuple[Fit, Evidence]:
    """The device without effects; channels weighed by what is left of them, in turn."""
    plain = Hypothesis(dataset.device, tuple(dataset.uncertain.items()), ())
    residuals: Residuals = Evidence(bench, fitted, {}).residuals(plain, [plain.start()])[0]
    steps = plain.start()
    for _ in range(2):
        evidence = Evidence(bench, fitted, _weights(residuals))
        sizes = tuple((channel, each.deviation) for channel, each in evidence.noise.items())
        found = fit(evidence, Hypothesis(plain.device, plain.uncertain, sizes), steps)
        residuals, steps = found.residuals, found.steps
    return found, evidence


def _joined(residuals: Residuals) -> dict[str, np.ndarray]:
    channels = dict.fromkeys(channel for found in residuals for channel in found)
    return {channel: np.concatenate([f[channel] for f in residuals if channel in f]) for channel in channels}


def _weights(residuals: Residuals) -> dict[str, Noise]:
    """The textbook's noise: what the fit leaves, every sample on its own."""
    return {c: Noise(_rms(values), (Alike(1e-9, 1.0, len(values)),)) for c, values in _joined(residuals).items()}


def _classic(found: Fit) -> float:
    """BIC with a variance of each channel's own; constants left out."""
    joined = _joined(found.residuals).values()
    count = sum(map(len, joined))
    return sum(len(v) * np.log(np.mean(v * v)) for v in joined) + len(found.steps) * np.log(count)


def _best(evidence: Evidence, current: Fit, open_: Sequence[Term]) -> Fit | None:
    chosen = shortlist(screen(evidence, current, open_))
    refits = Search(evidence, [], open_).refit(current, chosen)
    return min(refits, key=_classic, default=None)


@_timed
def sindy(dataset: Dataset, experiments: list[Experiment], exclude: Sequence[str]) -> Verdict:
    """Sparse regression (PySINDy's STLSQ) of the force that the balance lacks on :data:`force_balance.TERMS`.

    What the device's uncertain numbers can do, within what is believed of them, is taken off first. The threshold is
    the sparsest that selection trials hardly mind. A term whose coefficient has an impossible sign is struck and the
    regression repeated. Terms that several effects share make the verdict ambiguous. ``exclude`` names effects that
    are not looked for. Raises ModuleNotFoundError without PySINDy.
    """
    need_pysindy()
    having = [e for e in experiments if {"force", "pressure"} <= e.measured.keys()]
    measured = any("muscle_length" in e.measured for e in having)
    trials = {use: [balance(dataset, e) for e in having if e.use == use] for use in ("fit", "select", "show")}
    if not sum(len(b.lacking) for b in trials["fit"]):
        raise InputError("no trial has a tendon under load")
    judges = trials["select"] or trials["fit"]
    system = System(trials["fit"])
    tried = [np.zeros(len(TERMS)), *(system.sparse(t, measured, exclude) for t in THRESHOLDS)]
    judged = [_rms(np.concatenate(system.left(judges, row))) for row in tried]
    chosen = min(
        (row for row, size in zip(tried, judged, strict=True) if size <= TOLERATED * min(judged)), key=np.count_nonzero
    )
    kept = [(TERMS[i], chosen[i]) for i in np.flatnonzero(chosen)]
    sets = _sets([term.possible(measured, exclude, steps > 0.0) for term, steps in kept])
    before, after = ([{"force": f} for f in system.left(trials["show"], row)] for row in (tried[0], chosen))
    return {
        "verdict": "ambiguous" if len(sets) > 1 else ("named" if kept else "nothing-missing"),
        "effects": [meaning._asdict() for meaning in sets[0]],
        "alternatives": [[label(m._asdict()) for m in other] for other in sets[1:]],
        "terms": {term.formula: term.size * steps for term, steps in kept},
        "gap": _gap([b.experiment for b in trials["show"]], before, after),
    }


class System:
    """What the fitted trials lack, with the device's uncertain numbers taken off."""

    def __init__(self, trials: Sequence[Balance]) -> None:
        """In units of the noise that repeats show; of what is lacking itself, where nothing was repeated."""
        lacking, base, self._terms = (
            np.concatenate([getattr(b, name) for b in trials]) for name in ("lacking", "base", "terms")
        )
        repeated = noises.measure([b.experiment for b in trials], [{"force": b.lacking} for b in trials]).values()
        self._noise = sum(each.deviation / np.sqrt(each.independent) for each in repeated) or _rms(lacking)
        self._lacking = lacking
        # Each number of the device is believed to one standard deviation: a row that asks for 0.
        self._believed = np.vstack([base / self._noise, np.eye(base.shape[1])])

    def _padded(self, columns: np.ndarray) -> np.ndarray:
        return np.vstack([columns / self._noise, np.zeros((self._believed.shape[1], columns.shape[1]))])

    def _projected(self, columns: np.ndarray) -> np.ndarray:
        """What is left of ``columns`` [N] once the numbers of the device have taken what they can."""
        basis, _ = np.linalg.qr(self._believed)
        padded = self._padded(columns)
        return padded - basis @ (basis.T @ padded)

    def sparse(self, threshold: float, measured: bool, exclude: Sequence[str]) -> np.ndarray:
        """Coefficients of all terms, in typical sizes."""
        from pysindy.optimizers import STLSQ

        target, terms = self._projected(self._lacking[:, None]), self._projected(self._terms)
        found = np.zeros(len(TERMS))
        open_ = [i for i, term in enumerate(TERMS) if term.possible(measured, exclude, positive=True)]
        while open_:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # that nothing is left is an answer
                fitted = STLSQ(threshold=threshold, alpha=RIDGE, unbias=False).fit(terms[:, open_], target).coef_[0]
            impossible = {
                i
                for i, c in zip(open_, fitted, strict=True)
                if c < 0 and not TERMS[i].possible(measured, exclude, False)
            }
            if not impossible:
                found[open_] = fitted
                break
            open_ = [i for i in open_ if i not in impossible]
        return found

    def left(self, trials: Sequence[Balance], row: np.ndarray) -> list[np.ndarray]:
        """What ``trials`` lack [N] with the terms' coefficients in ``row`` and the device refitted beside them."""
        rest = self._padded((self._lacking - self._terms @ row)[:, None])[:, 0]
        base = np.linalg.lstsq(self._believed, rest, rcond=None)[0]
        return [b.lacking - b.base @ base - b.terms @ row for b in trials]


def _sets(choices: Sequence[Sequence[Meaning]]) -> list[list[Meaning]]:
    """Every way to give each term one of its meanings, as sets of effects; one empty set for no terms."""
    found = {}
    for picked in itertools.product(*choices):
        named = {label(m._asdict()): m for m in picked}  # two terms of one effect are one effect
        found.setdefault(tuple(sorted(named)), list(named.values()))
    return list(found.values())


def _gap(shown: Sequence[Experiment], before: Residuals, after: Residuals) -> dict[str, dict[str, Any]]:
    """As in ``verdict.json``; of channels that were repeated."""
    floors, old, new = noises.measure(shown, after), _joined(before), _joined(after)
    return {
        channel: {
            "unit": UNITS[channel][0],
            "before": _rms(old[channel]) / UNITS[channel][1],
            "after": _rms(new[channel]) / UNITS[channel][1],
            "floor": floor.deviation / UNITS[channel][1],
        }
        for channel, floor in floors.items()
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values * values)))
