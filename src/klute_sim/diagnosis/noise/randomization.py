"""Randomization test of the hypothesis that a fit leaves noise alone.

Repeats share what a model lacks, and noise is independent between them. Under the hypothesis, the products of different
repeats' residuals have as often one sign as the other, so the sign of each repeat may be exchanged in every interval
that is longer than the noise is correlated (Fisher 1935, *The Design of Experiments*, section 21; Good 2005,
*Permutation, Parametric, and Bootstrap Tests of Hypotheses*, section 3.2). No distribution of the noise is assumed but
its symmetry; its size may change with time and channel.
"""

import numpy as np

from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData
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


def compute_p_value(data: WeightedData, fit: Fit, seed: int = 0) -> float | None:
    """Return the probability of a misfit as large as that of ``fit`` if only noise is left, one-sided.

    The statistic is the sum over trials, channels and pairs of repeats of the product of their residuals over the
    variance of the noise. A fit makes residuals of repeats unlike: with J the Jacobian of the weighted residuals and
    priors, they have the covariance I - J (J'J)^-1 J' under noise of unit variance. Its elements between repeats
    are subtracted. Returns None without repeats, or where fewer than :data:`MIN_BLOCKS` intervals can be formed.
    """
    groups = _multiply_repeats(data, fit)
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


def _multiply_repeats(data: WeightedData, fit: Fit) -> list[Array]:
    """Return the products of the residuals of repeats in each interval, summed over channels: (intervals, i, j) each.

    They count in independent samples. Channels of a trial with other numbers of repeats or intervals have an entry of
    their own, because their signs cannot be exchanged together.
    """
    factors = _factor_fit_covariance(data, fit)
    sums: dict[tuple[str, int, int], Array] = {}
    for channel, noise in data.noise.items():
        shared = [_align_by_group(data, factor, channel) for factor in factors]
        for group, repeats in _align_by_group(data, fit.residuals, channel).items():
            n_blocks = min(_count_blocks(repeats, noise), len(repeats.time))
            if n_blocks == 0:
                continue
            products = np.zeros((len(repeats.time), len(repeats.residuals), len(repeats.residuals)))
            for rows in (repeats, *(factor[group] for factor in shared)):
                products += np.einsum("it,jt->tij", rows.residuals, rows.residuals)
            edges = np.linspace(0, len(products), n_blocks + 1).astype(int)[:-1]
            blocks = np.add.reduceat(products, edges, axis=0)
            blocks /= noise.std**2 * noise.correlation_time(repeats.sampling_interval)
            key = group, len(repeats.residuals), n_blocks
            same = sums.get(key)
            sums[key] = blocks if same is None else same + blocks
    return list(sums.values())


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
