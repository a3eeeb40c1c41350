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

from klute_sim.diagnose.experiment import Array, Experiment

DISCORDANT = 6.0
"""How many times more than others a group's repeats may differ before one of them is taken to be wrong."""
CERTAIN = 4.0
"""Standard errors of a misfit's square above which it is no noise."""
NOTICEABLE = 0.25
"""Of the noise, below which a misfit is not worth a name."""
WINDOW = 5.0
"""Lags up to so many correlation times are summed (Sokal's window)."""


class Noise(NamedTuple):
    """Of one channel, from its repeats."""

    deviation: float
    """Standard deviation of one sample [SI]."""
    correlation: float
    """Samples that tell as much as one independent one would; 1 or more."""
    samples: int
    """Samples of all trials that were compared."""


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
    """(repeats, samples) residuals [SI]."""


def stacks(experiments: Sequence[Experiment], residuals: Residuals, channel: str, *, least: int = 2) -> Iterator[Stack]:
    """Every group in which ``channel`` was recorded ``least`` times or more, as long as all of its repeats last."""
    for group, members in groups(experiments).items():
        having = [k for k in members if channel in experiments[k].measured and len(residuals[k][channel])]
        if len(having) < least:
            continue
        clocks = [experiments[k].measured[channel].time - experiments[k].begin for k in having]
        first = clocks[0]
        common = first[(first >= max(c[0] for c in clocks)) & (first <= min(c[-1] for c in clocks))]
        if len(common) > 10:
            rows = [np.interp(common, c, residuals[k][channel]) for k, c in zip(having, clocks, strict=True)]
            yield Stack(group, common, np.array(rows))


def measure(experiments: Sequence[Experiment], residuals: Residuals) -> dict[str, Noise]:
    """Noise of every channel that was repeated."""
    found = {}
    for channel in channels(experiments):
        squares, freedom, times, weights, samples = 0.0, 0, [], [], 0
        for _, _, stack in stacks(experiments, residuals, channel):
            apart = stack - stack.mean(axis=0)
            squares += float((apart * apart).sum())
            freedom += (len(stack) - 1) * stack.shape[1]
            times.append(np.mean([correlation(row) for row in apart]))
            weights.append(stack.size)
            samples += stack.size
        if freedom:
            time = float(np.average(times, weights=weights))
            found[channel] = Noise(float(np.sqrt(squares / freedom)), max(1.0, time), samples)
    return found


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
    something. That errs towards naming nothing.
    """
    found = {}
    for channel in channels(experiments):
        rows = [each[channel] for each in residuals if channel in each and len(each[channel]) > 10]
        if rows:
            whole = np.concatenate(rows)
            time = float(np.average([persistence(row) for row in rows], weights=[len(row) for row in rows]))
            found[channel] = Noise(float(np.sqrt(np.mean(whole**2))), time, len(whole))
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
    """Per channel, from products of different repeats' residuals: noise drops out of their mean."""
    found = {}
    for channel, own in noise.items():
        product, variance, samples = 0.0, 0.0, 0
        for _, _, stack in stacks(experiments, residuals, channel):
            pairs = list(itertools.combinations(range(len(stack)), 2))
            count = stack.shape[1]
            product += count * float(np.mean([np.mean(stack[a] * stack[b]) for a, b in pairs]))
            variance += count * count * own.deviation**4 * own.correlation / (count * len(pairs))
            samples += count
        if samples:
            mean = product / samples
            error = np.sqrt(variance) / samples
            found[channel] = Misfit(float(np.sqrt(max(0.0, mean))), float(mean / error), own.deviation)
    return found
