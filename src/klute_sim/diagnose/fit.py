"""The unknowns of a hypothesis, fitted to measured trials."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from klute_sim.diagnose.experiment import Array, Bench, Experiment
from klute_sim.diagnose.hypothesis import Hypothesis
from klute_sim.diagnose.noise import Noise, Residuals
from klute_sim.diagnose.store import Store

DIFFERENCE = 1e-3
"""Of an unknown, in steps of its own size, to take derivatives with."""
MOST_ROUNDS = 25
TOLERANCE = 1e-7
"""Relative change of cost at which a fit has converged."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Measured trials and what weighs their residuals."""

    bench: Bench
    experiments: Sequence[Experiment]
    noise: Mapping[str, Noise]
    store: Store | None = None
    """Where finished fits are kept."""

    @property
    def effective(self) -> float:
        """Independent samples in all."""
        return sum(
            len(series.time) / self.noise[channel].correlation(series.interval)
            for e in self.experiments
            for channel, series in e.measured.items()
            if channel in self.noise
        )

    def residuals(
        self, hypothesis: Hypothesis, rows: Sequence[Array], *, coarse: bool = False
    ) -> list[list[dict[str, Array]]]:
        """Measured minus simulated [SI] for each of ``rows`` of unknowns, in each experiment; ``coarse``: quickly."""
        experiments = [e.coarse for e in self.experiments] if coarse else self.experiments
        settings = [hypothesis.settings(row, experiments) for row in rows]
        return [
            [
                {channel: series.value - shown[channel] for channel, series in e.measured.items()}
                for e, shown in zip(experiments, found, strict=True)
            ]
            for found in self.bench.simulate(settings, experiments)
        ]

    def weighted(self, residuals: Residuals) -> Array:
        """One vector whose square is chi squared, counting only independent samples."""
        parts = [
            weight * found[channel]
            for found, weights in zip(residuals, self.weights, strict=True)
            for channel, weight in weights.items()
        ]
        return np.concatenate(parts)

    @cached_property
    def weights(self) -> list[dict[str, Array | float]]:
        """Per experiment: weighed channel -> what its residuals are multiplied by [1/SI], one or one per sample."""
        return [
            {
                c: self.noise[c].weight(series.interval) / e.loud.get(c, 1.0)
                for c, series in e.measured.items()
                if c in self.noise
            }
            for e in self.experiments
        ]

    def on(self, experiments: Sequence[Experiment]) -> "Evidence":
        """Other trials, weighed alike."""
        return Evidence(self.bench, experiments, self.noise, self.store)


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis with its unknowns found."""

    hypothesis: Hypothesis
    steps: Array
    """The unknowns, in steps of their sizes."""
    vector: Array
    """Weighted residuals, those of the priors last."""
    jacobian: Array
    """Of :attr:`vector` by the unknowns."""
    converged: bool
    residuals: Residuals = field(repr=False)
    """[SI]"""

    @property
    def cost(self) -> float:
        """Chi squared, priors included."""
        return float(self.vector @ self.vector)

    @property
    def values(self) -> list[float]:
        """The unknowns in their own units."""
        return self.hypothesis.values(self.steps)

    def criterion(self, effective: float) -> float:
        """BIC with the effective number of samples; differences of it decide."""
        return self.cost + (len(self.steps) - self.hypothesis.base) * float(np.log(effective))


def fit(
    evidence: Evidence,
    hypothesis: Hypothesis,
    start: Array | None = None,
    slope: Array | None = None,
    *,
    rounds: int = MOST_ROUNDS,
    fine: bool = False,
) -> Fit:
    """Fit ``hypothesis`` from ``start`` (in steps; None: nominal and neutral) by bounded least squares.

    ``slope`` is the Jacobian at ``start``, or near enough to find the first direction, where it is known. Residuals are
    never coarse; derivatives are, unless the fit is to be a ``fine`` one, which takes three times as long and comes
    out the same to a small part of what decides.
    """
    given = [e.name for e in evidence.experiments]
    question = repr((hypothesis, sorted(evidence.noise.items()), given, rounds, fine))
    begin = hypothesis.start() if start is None else start
    question += hashlib.sha256(begin.tobytes() + (b"" if slope is None else slope.tobytes())).hexdigest()
    kept = evidence.store.get(question) if evidence.store else None
    if kept is not None:
        residuals = evidence.residuals(hypothesis, [kept["steps"]])[0]
        return Fit(hypothesis, kept["steps"], kept["vector"], kept["jacobian"], bool(kept["converged"]), residuals)
    done = _fit(evidence, hypothesis, begin, slope, rounds, coarse=True)
    if fine and len(begin):
        done = _fit(evidence, hypothesis, done.steps, None, rounds, coarse=False)
    if evidence.store:
        whether = np.array(done.converged)
        evidence.store.put(question, steps=done.steps, vector=done.vector, jacobian=done.jacobian, converged=whether)
    return done


def _fit(
    evidence: Evidence, hypothesis: Hypothesis, begin: Array, slope: Array | None, rounds: int, *, coarse: bool
) -> Fit:
    low, high = hypothesis.bounds()
    prior = np.eye(hypothesis.base, len(hypothesis.unknowns))
    seen: dict[bytes, Residuals] = {}

    def vector(row: Array, residuals: Residuals) -> Array:
        return np.concatenate([evidence.weighted(residuals), row[: hypothesis.base]])

    def vector_at(row: Array) -> Array:
        if row.tobytes() not in seen:
            seen[row.tobytes()] = evidence.residuals(hypothesis, [row])[0]
        return vector(row, seen[row.tobytes()])

    known = [] if slope is None else [slope]

    def jacobian(row: Array) -> Array:
        if known:
            return known.pop()
        # Into the bounds, one unknown at a time, all at once on the bench.
        signs = np.where(row + DIFFERENCE > high, -1.0, 1.0)
        moved = [row + DIFFERENCE * sign * unit for sign, unit in zip(signs, np.eye(len(row)), strict=True)]
        rows = [row, *moved] if coarse else moved
        residuals = evidence.residuals(hypothesis, rows, coarse=coarse)
        vectors = [vector(*pair) for pair in zip(rows, residuals, strict=True)]
        here = vectors.pop(0) if coarse else vector_at(row)
        return np.stack([(v - here) / (DIFFERENCE * s) for v, s in zip(vectors, signs, strict=True)], axis=1)

    # Not at a bound: the first step would be no longer than the distance from it.
    margin = np.minimum(0.01, 0.25 * (high - low))
    inside = np.clip(begin, low + margin, high - margin)
    if not len(inside):
        there = vector_at(inside)
        return Fit(hypothesis, inside, there, np.empty((len(there), 0)), True, seen[inside.tobytes()])
    result = least_squares(
        vector_at,
        inside,
        jacobian,
        bounds=(low, high),
        ftol=TOLERANCE,
        xtol=1e-6,
        gtol=None,
        max_nfev=rounds,
    )
    there, found = vector_at(result.x), np.asarray(result.jac)
    found[len(there) - hypothesis.base :] = prior
    return Fit(hypothesis, result.x, there, found, result.status > 0, seen[result.x.tobytes()])
