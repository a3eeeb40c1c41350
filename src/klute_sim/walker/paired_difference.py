"""Paired differences between two conditions over several walkers, with the interval of Student's t."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from klute_sim.errors import InputError

CONFIDENCE = 0.95
"""Probability with which the interval contains the mean difference, if walkers differ at random."""


@dataclass(frozen=True, kw_only=True)
class PairedDifference:
    """Difference of one outcome between condition B and condition A."""

    n: int
    """Number of walkers that walked under both conditions."""
    mean_a: float
    """Mean of the outcome under A."""
    mean_b: float
    """Mean of the outcome under B."""
    difference: float
    """Mean of B minus A."""
    low: float | None
    """Lower end of the interval of the mean difference; None: one walker has no interval."""
    high: float | None
    """Upper end."""

    @property
    def sign(self) -> int:
        """1 or -1 where the interval excludes zero; 0 where the sign is not sure."""
        if self.low is None or self.high is None or self.low <= 0.0 <= self.high:
            return 0
        return 1 if self.low > 0.0 else -1


def compute_paired_difference(a: Sequence[float], b: Sequence[float]) -> PairedDifference:
    """Return the paired difference of the outcomes ``a`` and ``b``, one pair per walker.

    Raises InputError when there is no pair, or the numbers of values differ.
    """
    if len(a) != len(b) or not a:
        raise InputError(f"{len(a)} and {len(b)} outcomes; allowed: equal numbers, 1 or more")
    differences = np.asarray(b, dtype=np.float64) - np.asarray(a, dtype=np.float64)
    mean, n = float(differences.mean()), len(differences)
    low = high = None
    if n > 1:
        quantile = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, n - 1))
        half = quantile * float(differences.std(ddof=1)) / math.sqrt(n)
        low, high = mean - half, mean + half
    return PairedDifference(
        n=n, mean_a=float(np.mean(a)), mean_b=float(np.mean(b)), difference=mean, low=low, high=high
    )
