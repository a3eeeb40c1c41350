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

from klute_sim.diagnose.experiment import Array, Experiment

DISCORDANT = 6.0
"""How many times more than others a group's repeats may differ before one of them is taken to be wrong."""
CERTAIN = 4.0
"""Standard errors of a misfit's square above which it is no noise."""
NOTICEABLE = 0.25
"""Of the noise, below which a misfit is not worth a name."""
SAME_RATE = 1.1
"""Ratio of sampling intervals that count as the same."""
LOCAL = 3.0
"""Correlation times over which noise counts as equally loud."""
WINDOW = 5.0
"""Lags up to so many correlation times are summed (Sokal's window)."""


class Alike(NamedTuple):
    """For how long noise stays alike, where it was sampled so often."""

    interval: float
    """Between samples [s]."""
    correlation: float
    """Samples that tell as much as one independent one would; 1 or more."""
    samples: int
    """That were compared."""


class Noise(NamedTuple):
    """Of one channel, from its repeats."""

    deviation: float
    """Standard deviation of one sample [SI], where noise is as loud as usual."""
    alike: tuple[Alike, ...]
    """One for every rate of sampling."""

    @property
    def samples(self) -> int:
        """Samples of all trials that were compared."""
        return sum(each.samples for each in self.alike)

    @property
    def independent(self) -> float:
        """Share of those samples that are as good as independent."""
        return sum(each.samples / each.correlation for each in self.alike) / self.samples

    def correlation(self, interval: float) -> float:
        """Samples that tell as much as one independent one would, if they are ``interval`` [s] apart; 1 or more."""
        nearest = min(self.alike, key=lambda each: abs(np.log(each.interval / interval)))
        return max(1.0, nearest.correlation * nearest.interval / interval)

    def weight(self, interval: float) -> float:
        """What makes residuals [SI] that are ``interval`` [s] apart count as independent ones of deviation 1."""
        return 1.0 / (self.deviation * float(np.sqrt(self.correlation(interval))))


Residuals = Sequence[Mapping[str, Array]]
"""One mapping per experiment: channel -> measured minus simulated [SI]."""


def groups(experiments: Sequence[Experiment]) -> dict[str, list[int]]:
    """Group -> which experiments repeat each other."""
    found: dict[str, list[int]] = defaultdict(list)
    for number, experiment in enumerate(experiments):
        found[experiment.group].append(number)
    return dict(found)


class Stack(NamedTuple):
    """Repeats of one channel on one clock."""

    group: str
    clock: Array
    """Since the beginning of the trial [s]."""
    rows: Array
    """(repeats, samples) residuals [SI], over how loud noise is there."""

    @property
    def interval(self) -> float:
        """Usual time between samples [s]."""
        return float(np.median(np.diff(self.clock)))

    @property
    def apart(self) -> Array:
        """(repeats, samples) what sets them apart, in the size that the noise of one of them has; of two or more."""
        many = len(self.rows)
        return np.asarray((self.rows - self.rows.mean(axis=0)) * np.sqrt(many / (many - 1.0)))


def stacks(experiments: Sequence[Experiment], residuals: Residuals, channel: str, *, least: int = 2) -> Iterator[Stack]:
    """Every group in which ``channel`` was recorded ``least`` times or more, as long as all of its repeats last."""
    for group, members in groups(experiments).items():
        having = [k for k in members if channel in experiments[k].measured and len(residuals[k][channel])]
        if len(having) < least:
            continue
        clocks = [experiments[k].clock(experiments[k].measured[channel].time - experiments[k].begin) for k in having]
        first = clocks[0]
        common = first[(first >= max(c[0] for c in clocks)) & (first <= min(c[-1] for c in clocks))]
        if len(common) > 10:
            rows = [
                np.interp(common, c, residuals[k][channel] / experiments[k].loud.get(channel, 1.0))
                for k, c in zip(having, clocks, strict=True)
            ]
            yield Stack(group, common, np.array(rows))


def measure(experiments: Sequence[Experiment], residuals: Residuals) -> dict[str, Noise]:
    """Noise of every channel that was repeated."""
    found = {}
    for channel in channels(experiments):
        squares, freedom, alike = 0.0, 0, []
        for stack in stacks(experiments, residuals, channel):
            apart = stack.rows - stack.rows.mean(axis=0)
            squares += float((apart * apart).sum())
            freedom += (len(apart) - 1) * apart.shape[1]
            alike.append(Alike(stack.interval, float(np.mean([correlation(row) for row in apart])), apart.size))
        if freedom:
            found[channel] = Noise(float(np.sqrt(squares / freedom)), _pooled(alike))
    return found


def _pooled(every: Sequence[Alike]) -> tuple[Alike, ...]:
    """One for all that were sampled at about the same rate."""
    rates: list[list[Alike]] = []
    for each in sorted(every):
        if rates and each.interval < SAME_RATE * rates[-1][0].interval:
            rates[-1].append(each)
        else:
            rates.append([each])
    found = []
    for same in rates:
        counts = [each.samples for each in same]
        means = np.average([each[:2] for each in same], axis=0, weights=counts)
        found.append(Alike(float(means[0]), max(1.0, float(means[1])), sum(counts)))
    return tuple(found)


def discordant(experiments: Sequence[Experiment], residuals: Residuals) -> dict[tuple[str, str], tuple[float, float]]:
    """(group, channel) whose repeats differ far more than those of the other groups, and how much: theirs, others'."""
    found = {}
    for channel in channels(experiments):
        apart = {
            group: float(np.sqrt(((rows - rows.mean(axis=0)) ** 2).sum() / ((len(rows) - 1) * rows.shape[1])))
            for group, _, rows in stacks(experiments, residuals, channel)
        }
        for group, own in apart.items():
            others = [value for other, value in apart.items() if other != group]
            if others and own > DISCORDANT * float(np.median(others)):
                found[group, channel] = own, float(np.median(others))
    return found


def supposed(experiments: Sequence[Experiment], residuals: Residuals) -> dict[str, Noise]:
    """Noise of every channel if all of ``residuals`` were noise: too much of it, and for too long, if a model lacks
    something. That errs towards naming nothing. A channel that is simulated to the last digit has none and is left out.
    """
    found = {}
    for channel in channels(experiments):
        rows = [each[channel] for each in residuals if channel in each and len(each[channel]) > 10]
        if any(row.any() for row in rows):
            alike = [
                Alike(experiment.measured[channel].interval, persistence(each[channel]), len(each[channel]))
                for experiment, each in zip(experiments, residuals, strict=True)
                if channel in each and len(each[channel]) > 10
            ]
            found[channel] = Noise(float(np.sqrt(np.mean(np.concatenate(rows) ** 2))), _pooled(alike))
    return found


def channels(experiments: Iterable[Experiment]) -> list[str]:
    """Every channel that was measured anywhere."""
    return list(dict.fromkeys(channel for e in experiments for channel in e.measured))


def correlation(row: Array) -> float:
    """Integrated autocorrelation time of ``row`` [samples]: 1 for independent samples.

    ``row`` is what sets a repeat apart, so its mean is noise like the rest: a gauge that was zeroed differently.
    """
    power = _autocorrelation(row)
    sums = 2.0 * np.cumsum(power) - 1.0
    inside = np.arange(len(row)) >= WINDOW * sums
    return float(max(1.0, sums[int(inside.argmax()) if inside.any() else -1]))


def persistence(row: Array) -> float:
    """Autocorrelation time of ``row`` [samples] up to where the correlation with its beginning is gone.

    A misfit swings to the other side again and again: those swings must not make it look like many samples of noise.
    """
    power = _autocorrelation(row)
    gone = power <= 0.0
    return float(max(1.0, 2.0 * power[: int(gone.argmax()) if gone.any() else None].sum() - 1.0))


def _autocorrelation(row: Array) -> Array:
    """By lag, 1 at none; of a row that is nowhere different from 0: as of independent samples."""
    size = 1 << (2 * len(row) - 1).bit_length()
    spectrum = np.fft.rfft(row, size)
    power = np.fft.irfft((spectrum * spectrum.conj()).real, size)[: len(row)]
    found: Array = power / power[0] if power[0] > 0.0 else np.eye(1, len(row))[0]
    return found


class Misfit(NamedTuple):
    """What all repeats of a channel show and the simulation does not."""

    size: float
    """Root mean square [SI]; 0 if there is none."""
    certainty: float
    """Its square over the square's standard error under noise alone."""
    floor: float
    """Root mean square residual that a perfect model would leave, because of noise [SI]."""


def significant(one: Misfit) -> bool:
    """Whether a misfit is neither noise nor negligible."""
    return one.certainty > CERTAIN and one.size > NOTICEABLE * one.floor


def misfit(experiments: Sequence[Experiment], residuals: Residuals, noise: Mapping[str, Noise]) -> dict[str, Misfit]:
    """Per channel, from products of different repeats' residuals: noise drops out of their mean.

    How far that mean is off by chance is counted with the noise that there was at the time: some states let the
    noise of the inputs through more than others, and two loud stretches soon look alike.
    """
    found = {}
    for channel, own in noise.items():
        product, variance, steady, samples = 0.0, 0.0, 0.0, 0
        for stack in stacks(experiments, residuals, channel):
            pairs = list(itertools.combinations(stack.rows, 2))
            count = stack.rows.shape[1]
            product += count * float(np.mean([np.mean(a * b) for a, b in pairs]))
            weight = count * own.correlation(stack.interval) / len(pairs)
            variance += weight * _fourth_power(stack.rows, own.correlation(stack.interval))
            steady += weight * own.deviation**4
            samples += count
        if samples:
            mean = product / samples
            error = np.sqrt(max(variance, steady)) / samples
            found[channel] = Misfit(float(np.sqrt(max(0.0, mean))), float(mean / error), own.deviation)
    return found


def _fourth_power(rows: Array, correlation: float) -> float:
    """Mean square of the noise's variance over time [SI^4], from what sets the repeats in ``rows`` apart.

    The variance at a time is that of a window of :data:`LOCAL` correlation times, with as many degrees of freedom for
    every repeat but one: by those alone its square would come out larger, and is taken back.
    """
    repeats, count = rows.shape
    width = min(count, max(1, round(LOCAL * correlation)))
    apart = ((rows - rows.mean(axis=0)) ** 2).sum(axis=0) / (repeats - 1)
    local = uniform_filter1d(apart, width, mode="nearest")
    freedom = (repeats - 1) * max(1.0, width / correlation)
    taken_back: float = 1.0 + 2.0 / freedom
    return float(np.mean(local * local)) / taken_back
