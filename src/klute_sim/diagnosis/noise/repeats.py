"""What repeats say about noise: how large, how long it stays the same, and what is left that every repeat shows.

Where nothing is repeated, noise cannot be told from misfit, and all that a model leaves is taken for noise.

Repeats are compared by their *residuals*, measured minus simulated with each repeat's own inputs. What the model gets
wrong is the same in all of them and drops out of their differences; what is different is noise, including that of
the recorded inputs.
"""

import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from klute_sim.diagnosis.experiments.base import Array, Experiment

MAX_DEVIATION_RATIO = 6.0
"""How many times more than others a group's repeats may differ before one of them is taken to be wrong."""
SIGNIFICANCE_SIGMAS = 4.0
"""Standard errors of a misfit's square above which it is no noise."""
MIN_MISFIT_FRACTION = 0.25
"""Of the noise, below which a misfit is not worth a name."""
MAX_INTERVAL_RATIO = 1.1
"""Ratio of sampling intervals that count as the same."""
LOCAL_VARIANCE_WINDOW = 3.0
"""Correlation times over which noise counts as equally loud."""
SOKAL_WINDOW = 5.0
"""Lags up to so many correlation times are summed (Sokal's window)."""


class Autocorrelation(NamedTuple):
    """For how long noise stays alike, where it was sampled so often."""

    sampling_interval: float
    """Between samples [s]."""
    correlation_time: float
    """Samples that tell as much as one independent one would; 1 or more."""
    n_samples: int
    """That were compared."""


class Noise(NamedTuple):
    """Of one channel, from its repeats."""

    std: float
    """Standard deviation of one sample [SI], where noise is as loud as usual."""
    autocorrelations: tuple[Autocorrelation, ...]
    """One for every rate of sampling."""

    @property
    def n_samples(self) -> int:
        """Samples of all trials that were compared."""
        return sum(each.n_samples for each in self.autocorrelations)

    @property
    def independent_fraction(self) -> float:
        """Share of those samples that are as good as independent."""
        return sum(each.n_samples / each.correlation_time for each in self.autocorrelations) / self.n_samples

    def correlation_time(self, sampling_interval: float) -> float:
        """Samples that tell as much as one independent one would, if they are ``interval`` [s] apart; 1 or more."""
        nearest = min(self.autocorrelations, key=lambda each: abs(np.log(each.sampling_interval / sampling_interval)))
        return max(1.0, nearest.correlation_time * nearest.sampling_interval / sampling_interval)

    def weight(self, sampling_interval: float) -> float:
        """What makes residuals [SI] that are ``interval`` [s] apart count as independent ones of deviation 1."""
        return 1.0 / (self.std * float(np.sqrt(self.correlation_time(sampling_interval))))


Residuals = Sequence[Mapping[str, Array]]
"""One mapping per experiment: channel -> measured minus simulated [SI]."""


def group_repeats(experiments: Sequence[Experiment]) -> dict[str, list[int]]:
    """Group -> which experiments repeat each other."""
    found: dict[str, list[int]] = defaultdict(list)
    for number, experiment in enumerate(experiments):
        found[experiment.group].append(number)
    return dict(found)


class AlignedRepeats(NamedTuple):
    """Repeats of one channel on one clock."""

    group: str
    time: Array
    """Since the beginning of the trial [s]."""
    residuals: Array
    """(repeats, samples) residuals [SI], over how loud noise is there."""

    @property
    def sampling_interval(self) -> float:
        """Usual time between samples [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def deviations(self) -> Array:
        """(repeats, samples) what sets them apart, in the size that the noise of one of them has; of two or more."""
        many = len(self.residuals)
        return np.asarray((self.residuals - self.residuals.mean(axis=0)) * np.sqrt(many / (many - 1.0)))


def align_repeats(
    experiments: Sequence[Experiment], residuals: Residuals, channel: str, *, min_repeats: int = 2
) -> Iterator[AlignedRepeats]:
    """Every group in which ``channel`` was recorded ``least`` times or more, as long as all of its repeats last."""
    for group, members in group_repeats(experiments).items():
        having = [k for k in members if channel in experiments[k].measured and len(residuals[k][channel])]
        if len(having) < min_repeats:
            continue
        clocks = [
            experiments[k].align_time(experiments[k].measured[channel].time - experiments[k].start_time) for k in having
        ]
        first = clocks[0]
        common = first[(first >= max(c[0] for c in clocks)) & (first <= min(c[-1] for c in clocks))]
        if len(common) > 10:
            rows = [
                np.interp(common, c, residuals[k][channel] / experiments[k].noise_scale.get(channel, 1.0))
                for k, c in zip(having, clocks, strict=True)
            ]
            yield AlignedRepeats(group, common, np.array(rows))


def estimate_noise_from_repeats(experiments: Sequence[Experiment], residuals: Residuals) -> dict[str, Noise]:
    """Noise of every channel that was repeated."""
    found = {}
    for channel in list_channels(experiments):
        squares, freedom, alike = 0.0, 0, []
        for stack in align_repeats(experiments, residuals, channel):
            apart = stack.residuals - stack.residuals.mean(axis=0)
            squares += float((apart * apart).sum())
            freedom += (len(apart) - 1) * apart.shape[1]
            alike.append(
                Autocorrelation(
                    stack.sampling_interval,
                    float(np.mean([estimate_correlation_time(row) for row in apart])),
                    apart.size,
                )
            )
        if freedom:
            found[channel] = Noise(float(np.sqrt(squares / freedom)), _pool_by_rate(alike))
    return found


def _pool_by_rate(autocorrelations: Sequence[Autocorrelation]) -> tuple[Autocorrelation, ...]:
    """One for all that were sampled at about the same rate."""
    rates: list[list[Autocorrelation]] = []
    for each in sorted(autocorrelations):
        if rates and each.sampling_interval < MAX_INTERVAL_RATIO * rates[-1][0].sampling_interval:
            rates[-1].append(each)
        else:
            rates.append([each])
    found = []
    for same in rates:
        counts = [each.n_samples for each in same]
        means = np.average([each[:2] for each in same], axis=0, weights=counts)
        found.append(Autocorrelation(float(means[0]), max(1.0, float(means[1])), sum(counts)))
    return tuple(found)


def find_inconsistent_repeats(
    experiments: Sequence[Experiment], residuals: Residuals
) -> dict[tuple[str, str], tuple[float, float]]:
    """(group, channel) whose repeats differ far more than those of the other groups, and how much: theirs, others'."""
    found = {}
    for channel in list_channels(experiments):
        apart = {
            group: float(np.sqrt(((rows - rows.mean(axis=0)) ** 2).sum() / ((len(rows) - 1) * rows.shape[1])))
            for group, _, rows in align_repeats(experiments, residuals, channel)
        }
        for group, own in apart.items():
            others = [value for other, value in apart.items() if other != group]
            if others and own > MAX_DEVIATION_RATIO * float(np.median(others)):
                found[group, channel] = own, float(np.median(others))
    return found


def estimate_noise_from_residuals(experiments: Sequence[Experiment], residuals: Residuals) -> dict[str, Noise]:
    """Noise of every channel if all of ``residuals`` were noise: too much of it, and for too long, if a model lacks
    something. That errs towards naming nothing. A channel that is simulated to the last digit has none and is left out.
    """
    found = {}
    for channel in list_channels(experiments):
        rows = [each[channel] for each in residuals if channel in each and len(each[channel]) > 10]
        if any(row.any() for row in rows):
            alike = [
                Autocorrelation(
                    experiment.measured[channel].sampling_interval,
                    estimate_persistence_time(each[channel]),
                    len(each[channel]),
                )
                for experiment, each in zip(experiments, residuals, strict=True)
                if channel in each and len(each[channel]) > 10
            ]
            found[channel] = Noise(float(np.sqrt(np.mean(np.concatenate(rows) ** 2))), _pool_by_rate(alike))
    return found


def list_channels(experiments: Iterable[Experiment]) -> list[str]:
    """Every channel that was measured anywhere."""
    return list(dict.fromkeys(channel for e in experiments for channel in e.measured))


def estimate_correlation_time(residual: Array) -> float:
    """Integrated autocorrelation time of ``row`` [samples]: 1 for independent samples.

    ``row`` is what sets a repeat apart, so its mean is noise like the rest: a gauge that was zeroed differently.
    """
    power = _autocorrelate(residual)
    sums = 2.0 * np.cumsum(power) - 1.0
    inside = np.arange(len(residual)) >= SOKAL_WINDOW * sums
    return float(max(1.0, sums[int(inside.argmax()) if inside.any() else -1]))


def estimate_persistence_time(residual: Array) -> float:
    """Autocorrelation time of ``row`` [samples] up to where the correlation with its beginning is gone.

    A misfit swings to the other side again and again: those swings must not make it look like many samples of noise.
    """
    power = _autocorrelate(residual)
    gone = power <= 0.0
    return float(max(1.0, 2.0 * power[: int(gone.argmax()) if gone.any() else None].sum() - 1.0))


def _autocorrelate(residual: Array) -> Array:
    """By lag, 1 at none; of a row that is nowhere different from 0: as of independent samples."""
    size = 1 << (2 * len(residual) - 1).bit_length()
    spectrum = np.fft.rfft(residual, size)
    power = np.fft.irfft((spectrum * spectrum.conj()).real, size)[: len(residual)]
    found: Array = power / power[0] if power[0] > 0.0 else np.eye(1, len(residual))[0]
    return found


class Misfit(NamedTuple):
    """What all repeats of a channel show and the simulation does not."""

    rms: float
    """Root mean square [SI]; 0 if there is none."""
    significance: float
    """Its square over the square's standard error under noise alone."""
    noise_rms: float
    """Root mean square residual that a perfect model would leave, because of noise [SI]."""


def is_significant(misfit: Misfit) -> bool:
    """Whether a misfit is neither noise nor negligible."""
    return misfit.significance > SIGNIFICANCE_SIGMAS and misfit.rms > MIN_MISFIT_FRACTION * misfit.noise_rms


def estimate_misfit(
    experiments: Sequence[Experiment], residuals: Residuals, noise: Mapping[str, Noise]
) -> dict[str, Misfit]:
    """Per channel, from products of different repeats' residuals: noise drops out of their mean.

    How far that mean is off by chance is counted with the noise that there was at the time: some states let the
    noise of the inputs through more than others, and two loud stretches soon look alike.
    """
    found = {}
    for channel, own in noise.items():
        product, variance, steady, samples = 0.0, 0.0, 0.0, 0
        for stack in align_repeats(experiments, residuals, channel):
            pairs = list(itertools.combinations(stack.residuals, 2))
            count = stack.residuals.shape[1]
            product += count * float(np.mean([np.mean(a * b) for a, b in pairs]))
            weight = count * own.correlation_time(stack.sampling_interval) / len(pairs)
            variance += weight * _mean_squared_variance(stack.residuals, own.correlation_time(stack.sampling_interval))
            steady += weight * own.std**4
            samples += count
        if samples:
            mean = product / samples
            error = np.sqrt(max(variance, steady)) / samples
            found[channel] = Misfit(float(np.sqrt(max(0.0, mean))), float(mean / error), own.std)
    return found


def _mean_squared_variance(residuals: Array, correlation_time: float) -> float:
    """Mean square of the noise's variance over time [SI^4], from what sets the repeats in ``rows`` apart.

    The variance at a time is that of a window of :data:`LOCAL` correlation times, with as many degrees of freedom for
    every repeat but one: by those alone its square would come out larger, and is taken back.
    """
    repeats, count = residuals.shape
    width = min(count, max(1, round(LOCAL_VARIANCE_WINDOW * correlation_time)))
    apart = ((residuals - residuals.mean(axis=0)) ** 2).sum(axis=0) / (repeats - 1)
    local = uniform_filter1d(apart, width, mode="nearest")
    freedom = (repeats - 1) * max(1.0, width / correlation_time)
    taken_back: float = 1.0 + 2.0 / freedom
    return float(np.mean(local * local)) / taken_back
