"""Differences of mean outcomes between two conditions, paired or between groups of walkers, with Student's t."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from klute_sim.errors import InputError
from klute_sim.types import Array

CONFIDENCE = 0.95
"""Probability with which the interval contains the mean difference, if walkers differ at random."""


@dataclass(frozen=True, kw_only=True)
class MeanDifference:
    """Difference of one outcome between condition B and condition A."""

    n_a: int
    """Number of walkers under A."""
    n_b: int
    """Number of walkers under B; the same ones where the difference is paired."""
    mean_a: float
    """Mean of the outcome under A."""
    mean_b: float
    """Mean of the outcome under B."""
    difference: float
    """Mean of B minus mean of A."""
    low: float | None
    """Lower end of the interval of the difference; None: one walker has no interval."""
    high: float | None
    """Upper end."""

    @property
    def sign(self) -> int:
        """1 or -1 where the interval excludes zero; 0 where the sign is not sure."""
        if self.low is None or self.high is None or self.low <= 0.0 <= self.high:
            return 0
        return 1 if self.low > 0.0 else -1


def compute_paired_difference(a: Sequence[float], b: Sequence[float]) -> MeanDifference:
    """Return the difference of the outcomes ``a`` and ``b``, one pair per walker.

    Raises InputError when there is no pair, or the numbers of values differ.
    """
    if len(a) != len(b) or not a:
        raise InputError(f"{len(a)} and {len(b)} outcomes; allowed: equal numbers, 1 or more")
    values_a, values_b = (np.asarray(values, dtype=np.float64) for values in (a, b))
    n = len(values_a)
    error = None if n < 2 else float((values_b - values_a).std(ddof=1)) / math.sqrt(n)
    return _build(values_a, values_b, error, n - 1)


def compute_group_difference(a: Sequence[float], b: Sequence[float]) -> MeanDifference:
    """Return the difference of the outcomes ``a`` and ``b`` of two groups of walkers (Welch 1947, Biometrika 34:28).

    Raises InputError when a group is empty.
    """
    if not a or not b:
        raise InputError(f"{len(a)} and {len(b)} outcomes; allowed: 1 or more in each group")
    values_a, values_b = (np.asarray(values, dtype=np.float64) for values in (a, b))
    if min(len(a), len(b)) < 2:
        return _build(values_a, values_b, None, 0.0)
    squares = [float(values.var(ddof=1)) / len(values) for values in (values_a, values_b)]
    denominator = sum(square**2 / (len(v) - 1) for square, v in zip(squares, (values_a, values_b), strict=True))
    freedom = sum(squares) ** 2 / denominator if denominator > 0.0 else len(a) + len(b) - 2.0
    return _build(values_a, values_b, math.sqrt(sum(squares)), freedom)


def _build(a: Array, b: Array, error: float | None, degrees_of_freedom: float) -> MeanDifference:
    """Return the difference with its interval; ``error`` is its standard error."""
    mean_a, mean_b = float(a.mean()), float(b.mean())
    low = high = None
    if error is not None:
        half = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, degrees_of_freedom)) * error
        low, high = mean_b - mean_a - half, mean_b - mean_a + half
    return MeanDifference(
        n_a=len(a), n_b=len(b), mean_a=mean_a, mean_b=mean_b, difference=mean_b - mean_a, low=low, high=high
    )
