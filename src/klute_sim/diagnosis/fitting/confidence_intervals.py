"""How sure the fitted numbers are: from what sets repeats apart, and from what all of them have in common."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from klute_sim.diagnosis.experiments.base import Array
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData
from klute_sim.diagnosis.noise.repeats import align_repeats
from klute_sim.diagnosis.noise.systematic_error import (
    CONFIDENCE_LEVEL,
    collect_shared_misfits,
    estimate_misfit_error,
    estimate_preparation_errors,
)

NOISE_BLOCK_TIME = 0.5
"""Time [s] within which noise that is loud in places may be correlated (assumed)."""


class ChannelInfluence(NamedTuple):
    """A channel of a trial."""

    sensitivity: Array
    """(unknowns, samples) how the unknowns, in steps, follow its residuals [1/SI]."""
    noise: Array
    """(repeats, samples) noise that it might have had [SI], of which all but one are independent."""
    sampling_interval: float
    """Between samples [s]."""


class VarianceComponents(NamedTuple):
    """What the noise of a group of repeats does to the unknowns, in parts that are independent of each other."""

    components: Array
    """(unknowns, parts) [steps^2]"""
    degrees_of_freedom: Array
    """(parts) degrees of freedom with which each is known."""


def compute_confidence_intervals(data: WeightedData, fit: Fit) -> list[tuple[float, float]]:
    """95 % interval of every unknown in its own unit, the wider one of two.

    The unknowns follow noise along the fit's derivatives, and noise is what sets repeats apart. It might have come at
    another time (:func:`shifted`), which is right for slow noise that is as loud everywhere; or it is loud just where
    it was seen (:func:`in_place`). Either is a sum of squares that few repeats tell, so an interval is as wide as
    Student's t asks for, with the degrees of freedom of that sum.

    What a rig leaves out of its trials (:mod:`klute_sim.diagnosis.noise.systematic_error`) comes on top, as independent errors do
    (JCGM 100:2008, 5.1.2).
    """
    solver: Array = np.asarray(np.linalg.pinv(fit.jacobian), float)
    groups = _group_influences(data, fit, solver)
    priors = (solver[:, solver.shape[1] - fit.hypothesis.n_device_parameters :] ** 2).sum(axis=1)
    reach = np.zeros(len(solver))
    for view in (estimate_spectral_variances, estimate_block_variances):
        squares = [view(trials) for trials in groups]
        freedom = np.concatenate([each.degrees_of_freedom for each in squares])
        for k, own in enumerate(np.concatenate([each.components for each in squares], axis=1)):
            wide = student.ppf(
                0.5 + 0.5 * CONFIDENCE_LEVEL, combine_degrees_of_freedom(own, freedom, priors[k])
            ) * np.sqrt(own.sum() + priors[k])
            reach[k] = max(reach[k], wide)
    left_out = [
        *estimate_preparation_errors(data, fit, solver),
        estimate_misfit_error(collect_shared_misfits(data, fit, solver)),
    ]
    reach = np.sqrt(reach**2 + sum((each**2 for each in left_out), np.zeros(len(solver))))
    ends = [
        (unknown.denormalize(step - own), unknown.denormalize(step + own))
        for unknown, step, own in zip(fit.hypothesis.parameters, fit.x, reach, strict=True)
    ]
    return [(min(each), max(each)) for each in ends]


def combine_degrees_of_freedom(variances: Array, degrees_of_freedom: Array, exact_variance: float = 0.0) -> float:
    """Degrees of freedom of a sum of ``squares``, each known with its own ``freedom``, and one that is ``exact``.

    After Welch (1947), Biometrika 34, 28-35: an estimated square, squared, is too large in the mean by
    (freedom + 2)/freedom, which the two that are added and taken off again make good.
    """
    estimated = float((variances * variances / (degrees_of_freedom + 2.0)).sum())
    if estimated == 0.0:
        return np.inf
    return max(float(degrees_of_freedom.min()), float(variances.sum() + exact_variance) ** 2 / estimated - 2.0)


def estimate_spectral_variances(trials: Sequence[Sequence[ChannelInfluence]]) -> VarianceComponents:
    """Squares by frequency, in the mean over all times at which the noise might have begun, around the trial.

    By Parseval's theorem that is a product of spectra. All channels of a trial are shifted together: they see the
    same disturbances.
    """

    def spectra(part: ChannelInfluence, row: Array) -> Array:
        return np.asarray(np.fft.rfft(part.sensitivity) * np.fft.rfft(row).conj() / len(row))

    def squares(spectrum: Array) -> Array:
        # One side of the spectrum stands for both, but for the mean. (And for the highest frequency of an even number
        # of samples, where noise that is sampled often enough has next to nothing: it is counted double.)
        return np.asarray(np.abs(spectrum) ** 2 * np.where(np.arange(spectrum.shape[1]) == 0, 1.0, 2.0))

    of, repeats = _combine_channels(trials, spectra, squares)
    return VarianceComponents(of, repeats * np.where(np.arange(of.shape[1]) == 0, 1.0, 2.0))


def estimate_block_variances(trials: Sequence[Sequence[ChannelInfluence]]) -> VarianceComponents:
    """Squares by blocks of :data:`BLOCK`, each of which is known from what was seen in that very block."""

    def blocks(part: ChannelInfluence, row: Array) -> Array:
        count = max(1, round(len(row) * part.sampling_interval / NOISE_BLOCK_TIME))
        return np.stack([each.sum(axis=1) for each in np.array_split(part.sensitivity * row, count, axis=1)], axis=1)

    of, repeats = _combine_channels(trials, blocks, np.square)
    return VarianceComponents(of, np.full(of.shape[1], float(repeats)))


def _combine_channels(
    trials: Sequence[Sequence[ChannelInfluence]],
    transform: Callable[[ChannelInfluence, Array], Array],
    square: Callable[[Array], Array],
) -> tuple[Array, int]:
    """Squares of a group, and how many rows of noise they are known from.

    Channels of a trial add up before they are squared. Trials of a group add up after it: they were given the same
    noise, so what it does to them is known together.
    """
    repeats = min(len(part.noise) for trial in trials for part in trial)
    rows = [
        [_sum_padded([transform(part, part.noise[k]) for part in trial]) for k in range(repeats)] for trial in trials
    ]
    return _sum_padded([np.mean([square(row) for row in trial], axis=0) for trial in rows]), max(1, repeats - 1)


def _sum_padded(arrays: Sequence[Array]) -> Array:
    """What was sampled less often, or for less long, has nothing in the last columns."""
    total = np.zeros((arrays[0].shape[0], max(each.shape[1] for each in arrays)), arrays[0].dtype)
    for each in arrays:
        total[:, : each.shape[1]] += each
    return total


def _group_influences(data: WeightedData, fit: Fit, pseudoinverse: Array) -> list[list[list[ChannelInfluence]]]:
    """Groups of trials of channels."""
    apart = _collect_deviations(data, fit)
    groups: dict[str, list[list[ChannelInfluence]]] = defaultdict(list)
    begin = 0
    for experiment, weights, residual in zip(data.experiments, data.weights, fit.residuals, strict=True):
        trial = []
        for channel in weights:
            left = residual[channel] / experiment.noise_scale.get(channel, 1.0)
            # What was not repeated itself borrows from another group, or else takes what the fit leaves.
            others = (own for (_, of), own in apart.items() if of == channel)
            pool = apart.get((experiment.group, channel), next(others, left[np.newaxis]))
            interval = experiment.measured[channel].sampling_interval
            columns = pseudoinverse[:, begin : begin + len(left)] * data.noise[channel].weight(interval)
            trial.append(ChannelInfluence(columns, np.array([np.resize(row, len(left)) for row in pool]), interval))
            begin += len(left)
        if trial:
            groups[experiment.group].append(trial)
    return list(groups.values())


def _collect_deviations(data: WeightedData, fit: Fit) -> dict[tuple[str, str], Array]:
    """(group, channel) -> what sets its repeats apart, in the size that the noise of one of them has."""
    return {
        (stack.group, channel): stack.deviations
        for channel in data.noise
        for stack in align_repeats(data.experiments, fit.residuals, channel)
    }
