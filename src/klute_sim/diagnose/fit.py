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
TOLERANCE, FINE = 1e-5, 1e-7
"""Relative change of cost at which a fit has converged: one that is compared with others, and one that is kept."""


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
        settings = [hypothesis.settings(row, self.experiments) for row in rows]
        return [
            [
                {channel: series.value - shown[channel] for channel, series in e.measured.items()}
                for e, shown in zip(self.experiments, found, strict=True)
            ]
            for found in self.bench.simulate(settings, self.experiments, coarse=coarse)
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


FLAT = 1e-15
"""Gradient of chi squared, per step, that is none: of an effect that changes nothing where its fit begins. The solver
would divide by it."""
SLACK = 0.5
"""Rise of chi squared that a fit by long steps may end with, where it began as well as anywhere."""


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

    ``slope`` is the Jacobian at ``start``, or near enough to find the first direction, where it is known. On the way
    simulations are coarse, with what is wrong with them at the ``start`` taken off; the result's residuals never are. A
    ``fine`` fit goes the last steps, and takes its derivatives, with the short steps of these.
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
    # Not at a bound: the first step would be no longer than the distance from it.
    margin = np.minimum(0.01, 0.25 * (high - low))
    inside = np.clip(begin, low + margin, high - margin)
    problem = _Problem(evidence, hypothesis, inside, coarse=coarse)
    first = problem.finely(inside)
    if not len(inside):
        return Fit(hypothesis, inside, first[0], np.empty((len(first[0]), 0)), True, first[1])
    known = [] if slope is None else [slope]

    def slope_at(row: Array) -> Array:
        return known.pop() if known else problem.jacobian(row)

    result = least_squares(
        problem.vector,
        inside,
        slope_at,
        bounds=(low, high),
        ftol=TOLERANCE if coarse else FINE,
        xtol=1e-6,
        gtol=FLAT,
        max_nfev=rounds,
    )
    last, found = problem.finely(result.x), np.asarray(result.jac)
    if (
        coarse and last[0] @ last[0] > first[0] @ first[0] + SLACK
    ):  # what long steps get wrong has changed too much on the way
        return _fit(evidence, hypothesis, begin, slope, rounds, coarse=False)
    found[len(last[0]) - hypothesis.base :] = np.eye(hypothesis.base, len(hypothesis.unknowns))
    return Fit(hypothesis, result.x, last[0], found, result.status > 0, last[1])


def linear(evidence: Evidence, hypothesis: Hypothesis, row: Array) -> tuple[Array, Array]:
    """Weighted residuals at ``row`` of unknowns, and their derivatives, these by long steps."""
    problem = _Problem(evidence, hypothesis, row, coarse=True)
    return problem.finely(row)[0], problem.jacobian(row)


class _Problem:
    """The vector whose square is least, and its derivatives, by few long steps or many short ones.

    What long steps get wrong is known where a fit begins, and taken off everywhere: it hardly changes on the way.
    """

    def __init__(self, evidence: Evidence, hypothesis: Hypothesis, begin: Array, *, coarse: bool) -> None:
        self._evidence, self._hypothesis, self._coarse = evidence, hypothesis, coarse
        self._high = hypothesis.bounds()[1]
        self._fine: dict[bytes, tuple[Array, Residuals]] = {}
        self._wrong: Array | float = 0.0
        if coarse:
            self._wrong = self._simulated([begin])[0] - self.finely(begin)[0]

    def finely(self, row: Array) -> tuple[Array, Residuals]:
        """The vector at ``row`` by short steps, and the residuals [SI] in it."""
        key = row.tobytes()
        if key not in self._fine:
            residuals = self._evidence.residuals(self._hypothesis, [row])[0]
            self._fine[key] = self._joined(row, residuals), residuals
        return self._fine[key]

    def vector(self, row: Array) -> Array:
        """Weighted residuals at ``row``, those of the priors last."""
        return self._simulated([row])[0] - self._wrong if self._coarse else self.finely(row)[0]

    def jacobian(self, row: Array) -> Array:
        """Of :meth:`vector`: into the bounds, one unknown at a time, all at once on the bench."""
        signs = np.where(row + DIFFERENCE > self._high, -1.0, 1.0)
        moved = [row + DIFFERENCE * sign * unit for sign, unit in zip(signs, np.eye(len(row)), strict=True)]
        here, *vectors = self._simulated([row, *moved])
        return np.stack([(v - here) / (DIFFERENCE * s) for v, s in zip(vectors, signs, strict=True)], axis=1)

    def _simulated(self, rows: Sequence[Array]) -> list[Array]:
        found = self._evidence.residuals(self._hypothesis, rows, coarse=self._coarse)
        return [self._joined(row, each) for row, each in zip(rows, found, strict=True)]

    def _joined(self, row: Array, residuals: Residuals) -> Array:
        return np.concatenate([self._evidence.weighted(residuals), row[: self._hypothesis.base]])
