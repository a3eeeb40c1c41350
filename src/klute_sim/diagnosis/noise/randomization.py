"""Randomization test of the hypothesis that a fit leaves noise and no relevant misfit.

Repeats share what a model lacks, and noise is independent between them. Under the hypothesis, the products of different
repeats' residuals have as often one sign as the other, so the sign of each repeat may be exchanged in every interval
that is longer than the noise is correlated (Fisher 1935, *The Design of Experiments*, section 21; Good 2005,
*Permutation, Parametric, and Bootstrap Tests of Hypotheses*, section 3.2). No distribution of the noise is assumed but
its symmetry; its size may change with time and channel.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import helmert

from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData
from klute_sim.diagnosis.noise.misfit import MIN_MISFIT_FRACTION
from klute_sim.diagnosis.noise.repeats import AlignedRepeats, Noise, Residuals, align_repeats
from klute_sim.types import Array

N_RANDOMIZATIONS = 4999
"""Number of random exchanges of signs; the smallest p-value is the inverse of one more."""
MIN_BLOCK_TIME = 0.5
"""Shortest interval [s] within which signs are exchanged together (assumed: filters and drift of usual sensors)."""
MIN_CORRELATION_TIMES = 3.0
"""Shortest such interval in correlation times of the noise of the channel (assumed)."""
MIN_BLOCKS = 8
"""Fewest intervals; fewer signs have too few combinations."""


class RepeatContrasts(NamedTuple):
    """Residuals of one channel of a group of repeats, in orthonormal combinations of the repeats."""

    contrasts: Array
    """Combinations of the residuals over the noise of independent samples, (repeats, samples); the first is the sum."""
    influence: Array
    """Unit changes of the fit in the same scale as the sum, (parameters, samples)."""
    n_blocks: int
    """Number of intervals within which signs are exchanged together."""
    tolerated: float
    """Mean product of two repeats' residuals that an irrelevant misfit leaves at most."""


def compute_p_value(data: WeightedData, fit: Fit, seed: int = 0) -> float | None:
    """Return the probability of a misfit as large as that of ``fit`` if no relevant misfit is left, one-sided.

    The statistic is the sum over trials, channels and pairs of repeats of the product of their residuals over the
    variance of the noise. A misfit up to :data:`klute_sim.diagnosis.noise.misfit.MIN_MISFIT_FRACTION` of the noise is
    irrelevant: time steps and the denoising of inputs leave as much. If the misfit is smaller, p-values are larger than
    uniform ones. Returns None without repeats, or where fewer than :data:`MIN_BLOCKS` intervals can be formed.
    """
    groups = [_multiply_repeats(entry) for entry in _collect_contrasts(data, fit)]
    if sum(map(len, groups)) < MIN_BLOCKS:
        return None
    rng = np.random.default_rng(seed)
    observed, randomized = 0.0, np.zeros(N_RANDOMIZATIONS)
    for products in groups:
        n_blocks, n_repeats = products.shape[:2]
        observed += float(_sum_products(products, np.ones((1, n_blocks, n_repeats)))[0])
        randomized += _sum_products(products, rng.choice([-1.0, 1.0], (N_RANDOMIZATIONS, n_blocks, n_repeats)))
    return float((1 + np.sum(randomized >= observed)) / (1 + N_RANDOMIZATIONS))


def _sum_products(products: Array, signs: Array) -> Array:
    """Return the sums of ``products`` (blocks, i, j) between repeats with ``signs`` (draws, blocks, i): (draws,)."""
    n_repeats = products.shape[1]
    different = products * (1.0 - np.eye(n_repeats))
    return np.asarray(np.einsum("dki,kij,dkj->d", signs, different, signs, optimize=True) / (n_repeats - 1.0))


def _multiply_repeats(entry: RepeatContrasts) -> Array:
    """Return the products of the residuals of repeats i and j beyond what is tolerated, (intervals, i, j)."""
    n_repeats, n_samples = entry.contrasts.shape
    residuals = helmert(n_repeats, full=True).T @ entry.contrasts
    products = np.einsum("it,jt->tij", residuals, residuals) - entry.tolerated
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
            tolerated = MIN_MISFIT_FRACTION**2 / correlation_time
            entries.append(RepeatContrasts(contrasts, influence, n_blocks, tolerated))
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
