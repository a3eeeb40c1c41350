"""Noise of each channel from repeated trials: its standard deviation and autocorrelation.

Repeats are compared by their *residuals*, measured minus simulated with each repeat's own inputs. The model error is
the same in all repeats and cancels in their differences; the remainder is noise, including that of the recorded inputs.
Without repeats, noise and misfit cannot be separated, and the whole residual counts as noise.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.noise.autocorrelation import (
    Autocorrelation,
    estimate_correlation_time,
    estimate_persistence_time,
    pool_by_rate,
)
from klute_sim.types import Array, Mask

MAX_DEVIATION_RATIO = 6.0
"""Ratio of a group's deviations to the median of the other groups above which one of its repeats is wrong (assumed)."""
MIN_COMMON_SAMPLES = 10
"""Repeats are compared if they share more than this number of samples (assumed)."""


class Noise(NamedTuple):
    """Noise of one channel."""

    std: float
    """Standard deviation of one sample [SI], where the noise scale is 1."""
    autocorrelations: tuple[Autocorrelation, ...]
    """Autocorrelation at each sampling rate."""

    @property
    def n_samples(self) -> int:
        """Number of compared samples in all trials."""
        return sum(entry.n_samples for entry in self.autocorrelations)

    @property
    def independent_fraction(self) -> float:
        """Fraction of those samples that is effectively independent."""
        return sum(entry.n_samples / entry.correlation_time for entry in self.autocorrelations) / self.n_samples

    def correlation_time(self, sampling_interval: float) -> float:
        """Return the correlation time [samples] at ``sampling_interval`` [s]; at least 1."""
        nearest = min(self.autocorrelations, key=lambda entry: abs(np.log(entry.sampling_interval / sampling_interval)))
        return max(1.0, nearest.correlation_time * nearest.sampling_interval / sampling_interval)

    def weight(self, sampling_interval: float) -> float:
        """Return the factor [1/SI] that scales residuals to independent ones of standard deviation 1."""
        return 1.0 / (self.std * float(np.sqrt(self.correlation_time(sampling_interval))))


Residuals = Sequence[Mapping[str, Array]]
"""One mapping per experiment: channel -> measured minus simulated [SI]."""


def list_channels(experiments: Iterable[Experiment]) -> list[str]:
    """Return all channels that were measured in any of ``experiments``."""
    return list(dict.fromkeys(channel for e in experiments for channel in e.measured))


def group_repeats(experiments: Sequence[Experiment]) -> dict[str, list[int]]:
    """Return the indices of the experiments in each group of repeats."""
    groups: dict[str, list[int]] = defaultdict(list)
    for index, experiment in enumerate(experiments):
        groups[experiment.group].append(index)
    return dict(groups)


class AlignedRepeats(NamedTuple):
    """Residuals of the repeats of one channel on a common time axis."""

    group: str
    """Group of repeats."""
    time: Array
    """Aligned time since the start of the trial [s], shape (samples,)."""
    residuals: Array
    """Residuals [SI] over the scale of each repeat, shape (repeats, samples)."""
    scales: Array
    """These scales, (repeats, samples)."""
    trials: tuple[str, ...]
    """Names of the repeats."""

    @property
    def sampling_interval(self) -> float:
        """Median time between samples [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def centred_residuals(self) -> Array:
        """Residuals minus their mean over the repeats, over the scales: (repeats, samples).

        The mean is that of the unscaled residuals, weighted by the inverse squares of the scales, so it holds what the
        repeats share, whatever their scales. The squares of n repeats add up to n - 1 variances of the noise.
        """
        weights = self._relative_weights
        mean = (weights * self.residuals * self.scales).sum(axis=0)
        return np.asarray(self.residuals - mean / self.scales)

    @property
    def deviations(self) -> Array:
        """Centred residuals of two or more repeats, scaled to the noise of one repeat: (repeats, samples)."""
        return np.asarray(self.centred_residuals / np.sqrt(1.0 - self._relative_weights))

    @property
    def variance(self) -> Array:
        """Variance of the noise at each sample [SI^2], over the square of its scale: (samples,)."""
        return np.asarray((self.centred_residuals**2).sum(axis=0) / (len(self.residuals) - 1))

    @property
    def _relative_weights(self) -> Array:
        weights = self.scales**-2.0
        return np.asarray(weights / weights.sum(axis=0))


def align_repeats(
    experiments: Sequence[Experiment],
    residuals: Residuals,
    channel: str,
    *,
    min_repeats: int = 2,
    with_input_error: bool = False,
    drops_agreeing: bool = True,
) -> Iterator[AlignedRepeats]:
    """Yield each group that measured ``channel`` at least ``min_repeats`` times, over the time that all repeats cover.

    Each repeat contributes the residuals nearest to the samples of the slowest: interpolation would average neighbours,
    which takes a sixth off the variance of two repeats with any distance between their samples. ``with_input_error``
    divides them by the scale of the error that unknown inputs cause, too, which is right for a misfit and wrong for
    noise. ``drops_agreeing`` leaves out the samples beyond a sensor's limit in which all repeats agree, and a group
    without enough others.
    """
    for group, members in group_repeats(experiments).items():
        repeats = [k for k in members if channel in experiments[k].measured and len(residuals[k][channel])]
        if len(repeats) < min_repeats:
            continue
        times = [
            experiments[k].align_time(experiments[k].measured[channel].time - experiments[k].start_time)
            for k in repeats
        ]
        retained, common = _find_common_times(times, min_repeats)
        if len(common) > MIN_COMMON_SAMPLES:
            repeats, times = [repeats[i] for i in retained], [times[i] for i in retained]
            rows = []
            for k, t in zip(repeats, times, strict=True):
                scale = experiments[k].noise_scale.get(channel, 1.0)
                if with_input_error:
                    scale = scale * experiments[k].input_error_scale.get(channel, 1.0)
                scale = np.broadcast_to(scale, len(t))
                nearest = find_nearest(t, common)
                rows.append((residuals[k][channel][nearest] / scale[nearest], scale[nearest]))
            values, scales = (np.array(part) for part in zip(*rows, strict=True))
            aligned = AlignedRepeats(group, common, values, scales, tuple(experiments[k].name for k in repeats))
            if drops_agreeing and all(channel in experiments[k].limits for k in repeats):
                aligned = _drop_agreeing_samples(aligned)
            if len(aligned.time) > MIN_COMMON_SAMPLES:
                yield aligned


def _find_common_times(times: Sequence[Array], min_repeats: int) -> tuple[list[int], Array]:
    """Return the indices of the repeats with ``times`` [s] that have samples in common, and the times of these.

    A repeat that covers too little of the others, for example because its cable was off, is left out as long as at
    least ``min_repeats`` remain.
    """
    retained = list(range(len(times)))
    common = _intersect_times(times)
    while len(common) <= MIN_COMMON_SAMPLES and len(retained) > min_repeats:
        smaller = [[i for i in retained if i != left_out] for left_out in retained]
        retained = max(smaller, key=lambda indices: len(_intersect_times([times[i] for i in indices])))
        common = _intersect_times([times[i] for i in retained])
    return retained, common


def _intersect_times(times: Sequence[Array]) -> Array:
    """Return the samples of the slowest of ``times`` [s] near which all the others have one."""
    clock = max(times, key=lambda t: float(np.median(np.diff(t))) if len(t) > 1 else 0.0)
    common = clock[(clock >= max(t[0] for t in times)) & (clock <= min(t[-1] for t in times))]
    return np.asarray(common[np.all([has_sample_near(t, common) for t in times], axis=0)])


def find_nearest(time: Array, target_times: Array) -> NDArray[np.intp]:
    """Return the indices of the entries of ``time`` (n,), which increases, nearest to ``target_times`` (m,)."""
    return np.searchsorted(0.5 * (time[1:] + time[:-1]), target_times)


def has_sample_near(time: Array, target_times: Array) -> Mask:
    """Return whether ``time`` has an entry within one sampling interval of each of ``target_times`` (m,).

    Samples that are not compared leave gaps, at contact changes of a walk at other phases in each repeat.
    """
    distance = np.abs(time[find_nearest(time, target_times)] - target_times)
    return np.asarray(distance <= float(np.median(np.diff(time))))


def _drop_agreeing_samples(repeats: AlignedRepeats) -> AlignedRepeats:
    """Return ``repeats`` without samples whose residuals are all 0: beyond a sensor's limit they show no noise."""
    is_informative = np.any(repeats.residuals != 0.0, axis=0)
    return repeats._replace(
        time=repeats.time[is_informative],
        residuals=repeats.residuals[:, is_informative],
        scales=repeats.scales[:, is_informative],
    )


def estimate_noise_from_repeats(experiments: Sequence[Experiment], residuals: Residuals) -> dict[str, Noise]:
    """Return the noise of each repeated channel."""
    noise = {}
    for channel in list_channels(experiments):
        sum_of_squares, degrees_of_freedom, autocorrelations = 0.0, 0, []
        for repeats in align_repeats(experiments, residuals, channel):
            centred = repeats.centred_residuals
            sum_of_squares += float((centred * centred).sum())
            degrees_of_freedom += (len(centred) - 1) * centred.shape[1]
            correlation_time = float(np.mean([estimate_correlation_time(row) for row in centred]))
            autocorrelations.append(Autocorrelation(repeats.sampling_interval, correlation_time, centred.size))
        if degrees_of_freedom:
            noise[channel] = Noise(float(np.sqrt(sum_of_squares / degrees_of_freedom)), pool_by_rate(autocorrelations))
    return noise


def estimate_noise_from_residuals(experiments: Sequence[Experiment], residuals: Residuals) -> dict[str, Noise]:
    """Return the noise of each channel if ``residuals`` contained no misfit.

    Misfit makes this noise too large and too correlated, so fewer effects are identified. Channels with residuals of
    exactly 0 are left out.
    """
    noise = {}
    for channel in list_channels(experiments):
        rows = [row[channel] for row in residuals if channel in row and len(row[channel]) > MIN_COMMON_SAMPLES]
        if any(row.any() for row in rows):
            autocorrelations = [
                Autocorrelation(
                    experiment.measured[channel].sampling_interval,
                    estimate_persistence_time(row[channel]),
                    len(row[channel]),
                )
                for experiment, row in zip(experiments, residuals, strict=True)
                if channel in row and len(row[channel]) > MIN_COMMON_SAMPLES
            ]
            std = float(np.sqrt(np.mean(np.concatenate(rows) ** 2)))
            noise[channel] = Noise(std, pool_by_rate(autocorrelations))
    return noise


def find_inconsistent_repeats(
    experiments: Sequence[Experiment], residuals: Residuals
) -> dict[tuple[str, str], tuple[float, float]]:
    """Return (group, channel) whose repeats differ far more than those of other groups.

    The values are the group's root mean square deviation and the median of the other groups [SI].
    """
    inconsistent = {}
    for channel in list_channels(experiments):
        deviations = {
            repeats.group: float(np.sqrt(repeats.variance.mean()))
            for repeats in align_repeats(experiments, residuals, channel)
        }
        for group, deviation in deviations.items():
            # Repeats that agree to the last digit are copies and show no noise.
            others = [value for other, value in deviations.items() if other != group and value > 0.0]
            if others and deviation > MAX_DEVIATION_RATIO * float(np.median(others)):
                inconsistent[group, channel] = deviation, float(np.median(others))
    return inconsistent
