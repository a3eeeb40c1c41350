"""Products of different repeats' residuals, which show what repeats share.

Repeats share what a model lacks, and noise is independent between them, so products of different repeats' residuals are
0 on average where only noise is left. They are summed over intervals that are longer than the noise is correlated, so
the sums are independent, and their scatter shows the variance of their total; no distribution of the noise is assumed,
and its size may change with time and channel. All channels are summed together, because a disturbance of the device, as
of its supply, is in all of them.
"""

import itertools
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import helmert

from klute_sim.datasets.mechanism_channels import DISPLAY_UNITS
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import AlignedRepeats, Noise, Residuals, align_repeats
from klute_sim.types import Array

MIN_BLOCK_TIME = 0.5
"""Shortest interval [s] (assumed: filters of usual sensors)."""
MIN_CORRELATION_TIMES = 3.0
"""Shortest interval in correlation times of the noise of the channel (assumed)."""
MIN_BLOCKS = 8
"""Fewest intervals; the scatter of fewer is not known well enough."""
LOAD_UNITS = frozenset(DISPLAY_UNITS[si_unit] for si_unit in ("N", "N*m", "Pa"))
"""Units for display of channels that measure a load; the others measure a motion."""


class RepeatContrasts(NamedTuple):
    """Residuals of one channel of a group of repeats, in orthonormal combinations of the repeats."""

    channel: str
    """Name of the channel."""
    group: str
    """Name of the group of repeats."""
    trials: tuple[str, ...]
    """Names of the repeats that measured the channel."""
    contrasts: Array
    """Combinations of the residuals over the noise of independent samples, (repeats, samples); the first is the sum."""
    influence: Array
    """Unit changes of the fit in the same scale as the sum, (parameters, samples)."""
    n_blocks: int
    """Number of intervals of the channel."""
    correlation_time: float
    """Samples within which the noise of the channel is correlated."""


class RepeatProducts(NamedTuple):
    """Products of the residuals of different repeats over the variance of the noise.

    Samples count alike in all channels. Their correlation time would be a bad weight: it is estimated from differences
    of the same repeats, so it is short where these happen to be small and the products large.
    """

    products: Array
    """Sums over an interval and all channels for each pair of repeats, (products,)."""
    n_samples: Array
    """Sums for a shared misfit as large as the noise, that is numbers of samples, in channels of loads and of motions,
    (products, 2)."""


def compute_repeat_products(data: WeightedData, fit: Fit) -> RepeatProducts | None:
    """Return the products of different repeats' residuals.

    Returns None without repeats, or where fewer than :data:`MIN_BLOCKS` intervals can be formed.
    """
    return sum_products(_collect_contrasts(data, fit))


def sum_products(contrasts: Sequence[RepeatContrasts]) -> RepeatProducts | None:
    """Return the products of the repeats in ``contrasts``; None as in :func:`compute_repeat_products`.

    A pair of repeats has one product in each interval of its group, over all channels that both measured. The pairs of
    a channel are weighted so that a shared misfit as large as the noise adds up to its samples in all repeats.
    """
    groups: dict[str, list[RepeatContrasts]] = defaultdict(list)
    for entry in contrasts:
        groups[entry.group].append(entry)
    rows: list[Array] = []
    n_intervals = 0
    for entries in groups.values():
        n_blocks = min(entry.n_blocks for entry in entries)
        n_intervals += n_blocks
        sums: dict[tuple[str, str], Array] = {}  # columns: products, samples of loads, samples of motions
        for entry in entries:
            column = 1 if CHANNEL_UNITS[entry.channel][0] in LOAD_UNITS else 2
            block_sizes, weight = np.diff(_split_samples(entry, n_blocks)), 2.0 / (len(entry.trials) - 1.0)
            for pair, products in _multiply_repeats(entry, n_blocks).items():
                pair_sums = sums.setdefault(pair, np.zeros((n_blocks, 3)))
                pair_sums[:, 0] += weight * products
                pair_sums[:, column] += weight * block_sizes
        rows += sums.values()
    if n_intervals < MIN_BLOCKS:
        return None
    table = np.concatenate(rows)
    return RepeatProducts(table[:, 0], table[:, 1:])


def _multiply_repeats(entry: RepeatContrasts, n_blocks: int) -> dict[tuple[str, str], Array]:
    """Return pair of trials -> products of their residuals over the variance of the noise, (intervals,)."""
    residuals = np.sqrt(entry.correlation_time) * helmert(len(entry.contrasts), full=True).T @ entry.contrasts
    starts = _split_samples(entry, n_blocks)[:-1]
    rows = zip(entry.trials, residuals, strict=True)
    return {(i, j): np.add.reduceat(a * b, starts) for (i, a), (j, b) in itertools.combinations(rows, 2)}


def _split_samples(entry: RepeatContrasts, n_blocks: int) -> list[int]:
    """Return the first sample of each interval, and the number of samples."""
    return [entry.contrasts.shape[1] * k // n_blocks for k in range(n_blocks + 1)]


def _collect_contrasts(data: WeightedData, fit: Fit) -> list[RepeatContrasts]:
    """Return the contrasts of every channel and group of repeats that is longer than an interval.

    The fit takes a part of the noise from the sum of the repeats. The other contrasts have the same noise and lose the
    same part here, by a linear fit with the same Jacobian and priors, so that the products stay 0 on average.
    """
    factors = _factor_fit_covariance(data, fit)
    entries = []
    for channel, noise in data.noise.items():
        aligned = [_align_by_group(data, factor, channel, drops_agreeing=False) for factor in factors]
        for group, repeats in _align_by_group(data, fit.residuals, channel).items():
            n_blocks = min(_count_blocks(repeats, noise), len(repeats.time))
            if n_blocks == 0:
                continue
            n_repeats = len(repeats.trials)
            correlation_time = noise.correlation_time(repeats.sampling_interval)
            scale = 1.0 / (noise.std * np.sqrt(correlation_time))
            contrasts = helmert(n_repeats, full=True) @ repeats.residuals * scale
            means = [_average_at(repeats.time, factor[group]) for factor in aligned]
            influence = np.sqrt(n_repeats) * scale * np.reshape(means, (len(means), len(repeats.time)))
            entries.append(
                RepeatContrasts(channel, group, repeats.trials, contrasts, influence, n_blocks, correlation_time)
            )
    n_differences = max((len(entry.contrasts) for entry in entries), default=1) - 1
    for k in range(1, n_differences + 1):
        measured = [entry for entry in entries if len(entry.contrasts) > k]
        projections = sum(entry.influence @ entry.contrasts[k] for entry in measured)
        for entry in measured:
            entry.contrasts[k] -= projections @ entry.influence
    return entries


def _align_by_group(
    data: WeightedData, residuals: Residuals, channel: str, *, drops_agreeing: bool = True
) -> dict[str, AlignedRepeats]:
    aligned = align_repeats(data.experiments, residuals, channel, with_input_error=True, drops_agreeing=drops_agreeing)
    return {repeats.group: repeats for repeats in aligned}


def _average_at(time: Array, repeats: AlignedRepeats) -> Array:
    """Return the mean over ``repeats`` at ``time`` [s], which are some of their times."""
    index = np.searchsorted(repeats.time, time)
    return np.asarray(repeats.residuals[:, index].mean(axis=0))


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
