"""Test of the hypothesis that a fit leaves noise and no relevant misfit, by products of different repeats' residuals.

Repeats share what a model lacks, and noise is independent between them. Under the hypothesis, the products of different
repeats' residuals have as often one sign as the other, so the sign of each repeat may be exchanged in every interval
that is longer than the noise is correlated (Fisher 1935, *The Design of Experiments*, section 21; Good 2005,
*Permutation, Parametric, and Bootstrap Tests of Hypotheses*, section 3.2). No distribution of the noise is assumed but
its symmetry; its size may change with time and channel.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import helmert
from scipy.stats import norm

from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData
from klute_sim.diagnosis.noise.repeats import AlignedRepeats, Noise, Residuals, align_repeats
from klute_sim.types import Array

MIN_BLOCK_TIME = 0.5
"""Shortest interval [s] within which signs are exchanged together (assumed: filters and drift of usual sensors)."""
MIN_CORRELATION_TIMES = 3.0
"""Shortest such interval in correlation times of the noise of the channel (assumed)."""
MIN_BLOCKS = 8
"""Fewest intervals; fewer signs have too few combinations."""
N_CLEAN_DATASETS = 1000
"""Number of clean datasets of the benchmark on which the irrelevant misfit was measured."""
IRRELEVANT_MEAN_SQUARE, IRRELEVANT_SPREAD = 0.0290, 0.0225
"""Mean and standard deviation of the mean square of the irrelevant misfit, in variances of the noise."""


class RepeatContrasts(NamedTuple):
    """Residuals of one channel of a group of repeats, in orthonormal combinations of the repeats."""

    contrasts: Array
    """Combinations of the residuals over the noise of independent samples, (repeats, samples); the first is the sum."""
    influence: Array
    """Unit changes of the fit in the same scale as the sum, (parameters, samples)."""
    n_blocks: int
    """Number of intervals within which signs are exchanged together."""
    correlation_time: float
    """Samples within which the noise of the channel is correlated."""


class SharedMisfit(NamedTuple):
    """Products of the residuals of different repeats over the variance of the noise, summed over all samples."""

    total: float
    """Sum, which is 0 on average where only noise is left."""
    std: float
    """Standard deviation of the sum if the signs of all intervals are exchanged at random."""
    n_samples: float
    """Sum for a shared misfit as large as the noise: the number of independent samples."""


def compute_p_value(data: WeightedData, fit: Fit) -> float | None:
    """Return the probability of a misfit as large as that of ``fit`` if no relevant misfit is left, one-sided.

    Simulated datasets without a hidden effect share an irrelevant misfit: time steps and the denoising of inputs leave
    one. Its mean square is drawn from a normal distribution whose mean and standard deviation were measured on
    :data:`N_CLEAN_DATASETS` such datasets: an empirical null distribution (Efron 2004, *Journal of the American
    Statistical Association* 99, 96 to 104). Returns None without repeats, or where fewer than :data:`MIN_BLOCKS`
    intervals can be formed.
    """
    shared = measure_shared_misfit(data, fit)
    return None if shared is None else convert_to_p_value(shared)


def convert_to_p_value(
    shared: SharedMisfit, mean_square: float = IRRELEVANT_MEAN_SQUARE, spread: float = IRRELEVANT_SPREAD
) -> float:
    """Return the p-value of ``shared`` if the irrelevant misfit has this mean and standard deviation."""
    excess = shared.total - mean_square * shared.n_samples
    return float(norm.sf(excess / np.hypot(shared.std, spread * shared.n_samples)))


def measure_shared_misfit(data: WeightedData, fit: Fit) -> SharedMisfit | None:
    """Return the products of different repeats' residuals, summed; None where :func:`compute_p_value` has no answer."""
    total, variance, n_samples, n_blocks = 0.0, 0.0, 0.0, 0
    for entry in _collect_contrasts(data, fit):
        n_repeats = len(entry.contrasts)
        products = _multiply_repeats(entry)[:, *np.triu_indices(n_repeats, 1)] * (2.0 / (n_repeats - 1.0))
        total += float(products.sum())
        variance += float((products**2).sum())
        n_samples += n_repeats * entry.contrasts.shape[1] / entry.correlation_time
        n_blocks += entry.n_blocks
    return SharedMisfit(total, float(np.sqrt(variance)), n_samples) if n_blocks >= MIN_BLOCKS else None


def _multiply_repeats(entry: RepeatContrasts) -> Array:
    """Return the products of the residuals of repeats i and j, (intervals, i, j)."""
    n_repeats, n_samples = entry.contrasts.shape
    residuals = helmert(n_repeats, full=True).T @ entry.contrasts
    products = np.einsum("it,jt->tij", residuals, residuals)
    edges = np.linspace(0, n_samples, entry.n_blocks + 1).astype(int)[:-1]
    return np.asarray(np.add.reduceat(products, edges, axis=0))


def _collect_contrasts(data: WeightedData, fit: Fit) -> list[RepeatContrasts]:
    """Return the contrasts of every channel and group of repeats in which signs can be exchanged.

    The fit takes a part of the noise from the sum of the repeats. The other contrasts have the same noise and lose the
    same part here, by a linear fit with the same Jacobian and priors, so that sum and differences stay exchangeable.
    """
    factors = _factor_fit_covariance(data, fit)
    entries = []
    for channel, noise in data.noise.items():
        aligned = [_align_by_group(data, factor, channel) for factor in factors]
        for group, repeats in _align_by_group(data, fit.residuals, channel).items():
            n_blocks = min(_count_blocks(repeats, noise), len(repeats.time))
            if n_blocks == 0:
                continue
            n_repeats = len(repeats.residuals)
            correlation_time = noise.correlation_time(repeats.sampling_interval)
            scale = 1.0 / (noise.std * np.sqrt(correlation_time))
            contrasts = helmert(n_repeats, full=True) @ repeats.residuals * scale
            means = [factor[group].residuals.mean(axis=0) for factor in aligned]
            influence = np.sqrt(n_repeats) * scale * np.reshape(means, (len(means), len(repeats.time)))
            entries.append(RepeatContrasts(contrasts, influence, n_blocks, correlation_time))
    n_differences = max((len(entry.contrasts) for entry in entries), default=1) - 1
    for k in range(1, n_differences + 1):
        measured = [entry for entry in entries if len(entry.contrasts) > k]
        projections = sum(entry.influence @ entry.contrasts[k] for entry in measured)
        for entry in measured:
            entry.contrasts[k] -= projections @ entry.influence
    return entries


def _align_by_group(data: WeightedData, residuals: Residuals, channel: str) -> dict[str, AlignedRepeats]:
    return {r.group: r for r in align_repeats(data.experiments, residuals, channel, with_input_error=True)}


def _count_blocks(repeats: AlignedRepeats, noise: Noise) -> int:
    """Return the number of intervals of a trial for a channel with ``noise``."""
    correlation_time = noise.correlation_time(repeats.sampling_interval) * repeats.sampling_interval
    duration = float(repeats.time[-1] - repeats.time[0])
    return int(duration / max(MIN_BLOCK_TIME, MIN_CORRELATION_TIMES * correlation_time))


def _factor_fit_covariance(data: WeightedData, fit: Fit) -> list[list[dict[str, Array]]]:
    """Return the factors g of what the fit takes from the noise, J (J'J)^-1 J' = sum g g', as residuals."""
    covariance = np.linalg.pinv(fit.jacobian.T @ fit.jacobian)
    eigenvalues, eigenvectors = np.linalg.eigh(covariance)
    columns = fit.jacobian @ (eigenvectors * np.sqrt(np.maximum(eigenvalues, 0.0)))
    return [data.split_weighted_residuals(column) for column in columns.T]
