"""Confidence intervals of fitted parameters, from the deviations of repeats and from systematic errors."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2
from scipy.stats import t as student_t

from klute_sim.diagnosis.fitting.least_squares import Fit, compute_jacobian
from klute_sim.diagnosis.fitting.number_error import KEYS_WITHOUT_UPPER_LIMIT
from klute_sim.diagnosis.fitting.profile_likelihood import ResidualFunction, find_profile_limits
from klute_sim.diagnosis.fitting.secant import Point
from klute_sim.diagnosis.fitting.systematic_error import (
    CONFIDENCE_LEVEL,
    collect_shared_misfits,
    estimate_misfit_error,
    estimate_preparation_errors,
)
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import AlignedRepeats, align_repeats, find_nearest
from klute_sim.types import Array

NOISE_BLOCK_TIME = 0.5
"""Time [s] within which heteroscedastic noise may be correlated (assumed)."""

N_BISECTIONS = 8
"""Number of bisections for the lower end of a rate: it is known to 1/256 of its difference from the declared one."""


class ChannelInfluence(NamedTuple):
    """Influence of one channel of a trial on the parameters."""

    sensitivity: Array
    """Derivative of the normalized parameters by the residuals [1/SI], (parameters, samples)."""
    noise: Array
    """Realizations of the noise [SI], (repeats, samples); all but one are independent."""
    sampling_interval: float
    """Time between samples [s]."""


class VarianceComponents(NamedTuple):
    """Variance of the parameters due to the noise of a group of repeats, in independent components."""

    components: Array
    """Variance of the normalized parameters, (parameters, components)."""
    degrees_of_freedom: Array
    """Degrees of freedom of each component, (components,)."""


def compute_confidence_intervals(
    data: WeightedData, fit: Fit, profiled: Sequence[int] | None = None
) -> list[tuple[float, float]]:
    """Return the 95 % confidence interval of each parameter in its own unit.

    Noise makes the interval of a number of the device as long as the Jacobian says (:func:`compute_noise_errors`). That
    of a parameter of an effect reaches at least as far as the profile of chi squared says
    (:mod:`klute_sim.diagnosis.fitting.profile_likelihood`); both agree where residuals are linear. Its ends may have
    different distances from the fitted value, and an end may be at a bound. ``profiled`` are the indices of the
    parameters whose profile is followed (None: of all effects).

    Systematic errors (:mod:`klute_sim.diagnosis.fitting.systematic_error`) are added on both sides as independent
    errors are (JCGM 100:2008, 5.1.2).
    """
    pseudoinverse: Array = np.asarray(np.linalg.pinv(fit.jacobian), float)
    noise_errors = compute_noise_errors(data, fit, pseudoinverse)
    errors = np.stack([noise_errors, noise_errors], axis=1)
    profile_errors = np.zeros_like(errors)
    of_effects = [
        k
        for k, parameter in enumerate(fit.hypothesis.parameters)
        if parameter.term_index is not None and (profiled is None or k in profiled)
    ]
    if of_effects and not fit.has_diverged:
        profile_errors[of_effects] = find_profile_limits(
            _make_residual_function(data, fit),
            Point(fit.x, fit.weighted_residuals, fit.jacobian),
            lambda weights: float(compute_noise_errors(data, fit, weights[np.newaxis])[0]),
            of_effects,
        )
        errors = np.maximum(errors, profile_errors)
    # A parameter without influence may have any value in its bounds.
    is_idle = ~np.any(fit.jacobian, axis=0)
    to_bounds = np.abs(np.stack(fit.hypothesis.bounds(), axis=1) - fit.x[:, np.newaxis])
    errors[is_idle] = to_bounds[is_idle]
    systematic_errors = [
        *estimate_preparation_errors(data, fit, pseudoinverse),
        estimate_misfit_error(collect_shared_misfits(data, fit, pseudoinverse)),
    ]
    systematic_variances = sum((error**2 for error in systematic_errors), np.zeros(len(errors)))
    errors = np.sqrt(errors**2 + systematic_variances[:, np.newaxis])
    # The linear error of a supply that is too fast for the data is larger than its rate.
    linear_errors = np.sqrt(noise_errors**2 + systematic_variances)
    for k, distances in convert_reciprocal_errors(fit, linear_errors).items():
        if not is_idle[k]:
            errors[k] = np.maximum(distances, np.sqrt(profile_errors[k] ** 2 + systematic_variances[k]))
        elif fit.x[k] > 0.0:
            errors[k, 0] = fit.x[k] - _find_slowest_rate(_make_residual_function(data, fit), fit, k)
    lower, upper = fit.hypothesis.bounds()
    intervals = [
        (parameter.denormalize(low), parameter.denormalize(high))
        for parameter, low, high in zip(
            fit.hypothesis.parameters,
            np.clip(fit.x - errors[:, 0], lower, upper),
            np.clip(fit.x + errors[:, 1], lower, upper),
            strict=True,
        )
    ]
    return [(min(ends), max(ends)) for ends in intervals]


def convert_reciprocal_errors(fit: Fit, half_widths: Array) -> dict[int, tuple[float, float]]:
    """Return index -> distances of both ends of the interval from each fitted rate of a supply, normalized.

    The pressure depends on the duration of its changes, the reciprocal of the rate v. So an interval of half width h
    becomes one that is symmetric in 1/v: v/(1 + h/v) to v/(1 - h/v), without an upper end from h = v on. A rate without
    influence (h infinite) is left out.
    """
    distances = {}
    for k, parameter in enumerate(fit.hypothesis.parameters):
        rate = parameter.denormalize(float(fit.x[k]))
        if parameter.name in KEYS_WITHOUT_UPPER_LIMIT and rate > 0.0 and np.isfinite(half_widths[k]):
            ratio = half_widths[k] * parameter.scale / rate
            upper = half_widths[k] / (1.0 - ratio) if ratio < 1.0 else np.inf
            distances[k] = (float(half_widths[k] / (1.0 + ratio)), float(upper))
    return distances


def _find_slowest_rate(function: ResidualFunction, fit: Fit, index: int) -> float:
    """Return the lowest rate that explains the data as well as that of ``fit``, which has no influence; normalized.

    Bisection between the declared rate and that of ``fit``, for a rise of chi squared by its 95 % quantile. The other
    parameters keep their values: near the lowest rate, a slower supply is a misfit of a few steps only (assumed).
    """
    slow, fast, max_chi2 = 0.0, float(fit.x[index]), fit.chi2 + float(chi2.ppf(CONFIDENCE_LEVEL, 1))
    for _ in range(N_BISECTIONS):
        x = fit.x.copy()
        x[index] = 0.5 * (slow + fast)
        (residuals,) = function.evaluate([x])
        if residuals @ residuals <= max_chi2:
            fast = x[index]
        else:
            slow = x[index]
    return fast


def compute_noise_errors(data: WeightedData, fit: Fit, pseudoinverse: Array) -> Array:
    """Return the half width of the 95 % interval of each normalized parameter, (parameters,), due to noise.

    Noise propagates to the parameters along the ``pseudoinverse`` of the fit's Jacobian, and the deviations of repeats
    are realizations of it. They might have occurred at any other time (:func:`estimate_spectral_variances`), which
    suits slow stationary noise, or only where they occurred (:func:`estimate_block_variances`), which suits
    heteroscedastic noise; the wider interval counts. Both variances are sums of squares from few repeats, so the
    interval uses Student's t with the degrees of freedom of the sum.
    """
    groups = _group_influences(data, fit, pseudoinverse)
    n_priors = fit.hypothesis.n_prior_parameters
    prior_variances = (pseudoinverse[:, pseudoinverse.shape[1] - n_priors :] ** 2).sum(axis=1)
    half_widths = np.zeros(len(pseudoinverse))
    for estimate in (estimate_spectral_variances, estimate_block_variances):
        variances = [estimate(trials) for trials in groups]
        freedom = np.concatenate([entry.degrees_of_freedom for entry in variances])
        for k, components in enumerate(np.concatenate([entry.components for entry in variances], axis=1)):
            quantile = student_t.ppf(
                0.5 + 0.5 * CONFIDENCE_LEVEL, combine_degrees_of_freedom(components, freedom, prior_variances[k])
            )
            half_widths[k] = max(half_widths[k], quantile * np.sqrt(components.sum() + prior_variances[k]))
    return half_widths


def _make_residual_function(data: WeightedData, fit: Fit) -> ResidualFunction:
    """Return the weighted residuals as a function of the normalized parameters.

    Repeats share the changes of their residuals from those of ``fit``, as they share derivatives. Changes and
    derivatives are from coarse simulations.
    """
    hypothesis = fit.hypothesis
    start = hypothesis.build_setups(fit.x, data.experiments)

    def evaluate(points: Sequence[Array]) -> list[Array]:
        ends = [hypothesis.build_setups(x, data.experiments) for x in points]
        return [
            fit.weighted_residuals
            + np.append(data.weight_residuals(changes), (x - fit.x)[: hypothesis.n_prior_parameters])
            for x, changes in zip(points, data.compute_changes(start, ends, coarse=True), strict=True)
        ]

    def differentiate(x: Array) -> Array:
        return compute_jacobian(data, hypothesis, x, coarse=True)

    return ResidualFunction(evaluate, differentiate, *_limit_to_present_effects(fit))


def _limit_to_present_effects(fit: Fit) -> tuple[Array, Array]:
    """Return the bounds of the normalized parameters of ``fit``, without the value at which an effect is absent.

    Beyond that value the profile would be that of another effect, such as warm oil in place of cold one. Only effects
    count that have one parameter with such a value; two may compensate each other.
    """
    lower, upper = fit.hypothesis.bounds()
    sizes: dict[int, list[int]] = defaultdict(list)
    for k, parameter in enumerate(fit.hypothesis.parameters):
        if parameter.term_index is not None and not parameter.is_logarithmic:
            sizes[parameter.term_index].append(k)
    for k in (indices[0] for indices in sizes.values() if len(indices) == 1):
        if fit.x[k] > 0.0:
            lower[k] = max(lower[k], 0.0)
        elif fit.x[k] < 0.0:
            upper[k] = min(upper[k], 0.0)
    return lower, upper


def combine_degrees_of_freedom(variances: Array, degrees_of_freedom: Array, exact_variance: float = 0.0) -> float:
    """Return the degrees of freedom of the sum of estimated ``variances`` and an ``exact_variance``.

    After Welch (1947), Biometrika 34, 28-35: the square of an estimated variance is too large in the mean by
    (freedom + 2)/freedom, which adding and subtracting 2 corrects.
    """
    estimated = float((variances * variances / (degrees_of_freedom + 2.0)).sum())
    if estimated == 0.0:
        return np.inf
    return max(float(degrees_of_freedom.min()), float(variances.sum() + exact_variance) ** 2 / estimated - 2.0)


def estimate_spectral_variances(trials: Sequence[Sequence[ChannelInfluence]]) -> VarianceComponents:
    """Return the variance components by frequency, averaged over all circular time shifts of the noise.

    By Parseval's theorem the average is a product of spectra. All channels of a trial are shifted together, because
    they respond to the same disturbances.
    """

    def transform(influence: ChannelInfluence, noise: Array) -> Array:
        return np.asarray(np.fft.rfft(influence.sensitivity) * np.fft.rfft(noise).conj() / len(noise))

    def square(spectrum: Array) -> Array:
        # The one-sided spectrum counts twice, except at frequency 0. The highest frequency of an even number of samples
        # is counted twice as well, where well-sampled noise has next to nothing.
        return np.asarray(np.abs(spectrum) ** 2 * np.where(np.arange(spectrum.shape[1]) == 0, 1.0, 2.0))

    components, freedom = _combine_channels(trials, transform, square)
    return VarianceComponents(components, freedom * np.where(np.arange(components.shape[1]) == 0, 1.0, 2.0))


def estimate_block_variances(trials: Sequence[Sequence[ChannelInfluence]]) -> VarianceComponents:
    """Return the variance components by blocks of :data:`NOISE_BLOCK_TIME`, each from the noise in that block."""

    def transform(influence: ChannelInfluence, noise: Array) -> Array:
        n_blocks = max(1, round(len(noise) * influence.sampling_interval / NOISE_BLOCK_TIME))
        blocks = np.array_split(influence.sensitivity * noise, n_blocks, axis=1)
        return np.stack([block.sum(axis=1) for block in blocks], axis=1)

    components, freedom = _combine_channels(trials, transform, np.square)
    return VarianceComponents(components, np.full(components.shape[1], float(freedom)))


def _combine_channels(
    trials: Sequence[Sequence[ChannelInfluence]],
    transform: Callable[[ChannelInfluence, Array], Array],
    square: Callable[[Array], Array],
) -> tuple[Array, int]:
    """Return the variance components of a group and their degrees of freedom.

    Channels of a trial are added before squaring, because their noise is correlated. Trials of a group are added after
    squaring; they share the same realizations of the noise, so their degrees of freedom do not add.
    """
    n_repeats = min(len(influence.noise) for trial in trials for influence in trial)
    rows = [
        [_sum_padded([transform(influence, influence.noise[k]) for influence in trial]) for k in range(n_repeats)]
        for trial in trials
    ]
    components = _sum_padded([np.mean([square(row) for row in trial], axis=0) for trial in rows])
    return components, max(1, n_repeats - 1)


def _sum_padded(arrays: Sequence[Array]) -> Array:
    """Return the sum of ``arrays``, padded with 0 in the columns that a slower or shorter recording lacks."""
    total = np.zeros((arrays[0].shape[0], max(array.shape[1] for array in arrays)), arrays[0].dtype)
    for array in arrays:
        total[:, : array.shape[1]] += array
    return total


def _group_influences(data: WeightedData, fit: Fit, pseudoinverse: Array) -> list[list[list[ChannelInfluence]]]:
    """Return the influences by group, trial and channel."""
    deviations = _collect_deviations(data, fit)
    groups: dict[str, list[list[ChannelInfluence]]] = defaultdict(list)
    start = 0
    for experiment, weights, residual in zip(data.experiments, data.weights, fit.residuals, strict=True):
        trial = []
        for channel in weights:
            scaled_residual = residual[channel] / experiment.noise_scale.get(channel, 1.0)
            # A channel without repeats takes the noise of another group, or else the residual of the fit.
            of_other_groups = (rows.deviations for (_, name), rows in deviations.items() if name == channel)
            default = next(of_other_groups, scaled_residual[np.newaxis])
            series = experiment.measured[channel]
            interval, n_samples = series.sampling_interval, len(scaled_residual)
            rows_of_group = deviations.get((experiment.group, channel))
            if rows_of_group is None:
                noise = np.array([np.resize(row, n_samples) for row in default])
            else:
                noise = align_deviations(rows_of_group, experiment.align_time(series.time - experiment.start_time))
            sensitivity = pseudoinverse[:, start : start + n_samples] * data.noise[channel].weight(interval)
            sensitivity = sensitivity / experiment.input_error_scale.get(channel, 1.0)
            trial.append(ChannelInfluence(sensitivity, noise, interval))
            start += n_samples
        if trial:
            groups[experiment.group].append(trial)
    return list(groups.values())


def align_deviations(repeats: AlignedRepeats, time: Array) -> Array:
    """Return the deviations of ``repeats`` where they occurred, at the aligned ``time`` [s] of one of them.

    The result is (repeats, samples). Before and after the time that all repeats cover, noise from elsewhere stands in.
    """
    deviations = repeats.deviations
    noise = np.array([np.resize(row, len(time)) for row in deviations])
    is_covered = (time >= repeats.time[0]) & (time <= repeats.time[-1])
    noise[:, is_covered] = deviations[:, find_nearest(repeats.time, time[is_covered])]
    return noise


def _collect_deviations(data: WeightedData, fit: Fit) -> dict[tuple[str, str], AlignedRepeats]:
    """Return (group, channel) -> its repeats, whose deviations are noise [SI]."""
    return {
        (repeats.group, channel): repeats
        for channel in data.noise
        for repeats in align_repeats(data.experiments, fit.residuals, channel)
    }
