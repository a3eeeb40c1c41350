"""Autocorrelation of noise: the number of samples that carry the information of one independent sample."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.types import Array

MAX_INTERVAL_RATIO = 1.1
"""Ratio of sampling intervals up to which they count as equal."""
SOKAL_WINDOW = 5.0
"""Correlation times up to which lags are summed (Sokal 1997, *Functional Integration*, pages 131 to 192)."""


class Autocorrelation(NamedTuple):
    """Autocorrelation of noise at one sampling rate."""

    sampling_interval: float
    """Time between samples [s]."""
    correlation_time: float
    """Number of samples that carry the information of one independent sample; at least 1."""
    n_samples: int
    """Number of samples it was estimated from."""


def pool_by_rate(autocorrelations: Sequence[Autocorrelation]) -> tuple[Autocorrelation, ...]:
    """Return the mean autocorrelation of each sampling rate, weighted by the number of samples."""
    rates: list[list[Autocorrelation]] = []
    for entry in sorted(autocorrelations):
        if rates and entry.sampling_interval < MAX_INTERVAL_RATIO * rates[-1][0].sampling_interval:
            rates[-1].append(entry)
        else:
            rates.append([entry])
    pooled = []
    for rate in rates:
        counts = [entry.n_samples for entry in rate]
        means = np.average([entry[:2] for entry in rate], axis=0, weights=counts)
        pooled.append(Autocorrelation(float(means[0]), max(1.0, float(means[1])), sum(counts)))
    return tuple(pooled)


def estimate_correlation_time(residual: Array) -> float:
    """Return the integrated autocorrelation time of ``residual`` [samples]: 1 for independent samples.

    ``residual`` is the deviation of one repeat from the mean of all, so its mean is noise as well: a sensor with
    another zero.
    """
    autocorrelation = _autocorrelate(residual)
    sums = 2.0 * np.cumsum(autocorrelation) - 1.0
    is_converged = np.arange(len(residual)) >= SOKAL_WINDOW * sums
    return float(max(1.0, sums[int(is_converged.argmax()) if is_converged.any() else -1]))


def estimate_persistence_time(residual: Array) -> float:
    """Return the autocorrelation time of ``residual`` [samples] up to the first zero of the autocorrelation.

    A misfit oscillates; without this limit its negative lobes would make it look like many independent samples.
    """
    autocorrelation = _autocorrelate(residual)
    is_past_zero = autocorrelation <= 0.0
    end = int(is_past_zero.argmax()) if is_past_zero.any() else None
    return float(max(1.0, 2.0 * autocorrelation[:end].sum() - 1.0))


def _autocorrelate(residual: Array) -> Array:
    """Return the autocorrelation by lag, 1 at lag 0; that of independent samples if ``residual`` is 0 everywhere."""
    size = 1 << (2 * len(residual) - 1).bit_length()
    spectrum = np.fft.rfft(residual, size)
    power = np.fft.irfft((spectrum * spectrum.conj()).real, size)[: len(residual)]
    autocorrelation: Array = power / power[0] if power[0] > 0.0 else np.eye(1, len(residual))[0]
    return autocorrelation
