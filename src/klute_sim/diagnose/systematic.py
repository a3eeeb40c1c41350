"""What is wrong in the same way in every repeat, so that no difference between repeats tells of it.

A walk is replayed from what was measured of it: its motion is smoothed before it is differentiated twice, its load is
sampled, and the replay knows less of limb and foot than they are. That moves the fitted numbers alike in all repeats.
Two things are known of it: what preparing and simulating the trials in another way would change, and what the fit
leaves that all repeats share. A rig that prescribes exactly what was commanded has neither
(:attr:`~klute_sim.diagnose.experiment.Experiment.otherwise` is empty there).
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from klute_sim.diagnose.experiment import Array
from klute_sim.diagnose.fit import Evidence, Fit
from klute_sim.diagnose.noise import stacks

LEVEL = 0.95
"""Of the intervals."""
SHIFT = 0.25
"""Of a trial, by which a misfit is shifted: a stride of four, or more (assumed)."""


class Shared(NamedTuple):
    """What the fit leaves in one group of repeats."""

    follow: Sequence[Array]
    """Per channel: (unknowns, samples) how the unknowns, in steps, follow what all repeats share [1/SI]."""
    mean: Sequence[Array]
    """Per channel: (samples) residual in the mean over the repeats [SI]."""
    apart: Sequence[Array]
    """Per channel: (repeats, samples) noise that one of them has [SI]."""


def otherwise(evidence: Evidence, found: Fit, solver: Array) -> list[Array]:
    """By how much, at most, the unknowns would be others [steps], (unknowns,) each, had something been done otherwise.

    Each is a fit of one linear step (``solver``, the pseudoinverse of the fit's Jacobian): trials simulated in long
    steps, then each way to prepare them. These are half widths of what may be wrong (assumed: what is left out is no
    more than what the other choice changes).
    """
    variants = list(zip(*(e.otherwise for e in evidence.experiments), strict=True))
    if not variants:
        return []

    def moved(other: Evidence, *, coarse: bool = False) -> Array:
        (residuals,) = other.residuals(found.hypothesis, [found.steps], coarse=coarse)
        change = evidence.weighted(residuals) - evidence.weighted(found.residuals)
        return np.asarray(np.abs(solver[:, : len(change)] @ change))

    return [moved(evidence, coarse=True), *(moved(evidence.on(experiments)) for experiments in variants)]


def shared(evidence: Evidence, found: Fit, solver: Array) -> list[Shared]:
    """Of the groups whose trials could have been prepared otherwise."""
    follow: dict[tuple[str, str], list[tuple[Array, Array]]] = defaultdict(list)
    begin = 0
    for experiment, weights, residual in zip(evidence.experiments, evidence.weights, found.residuals, strict=True):
        for channel in weights:
            end = begin + len(residual[channel])
            if experiment.otherwise:
                series = experiment.measured[channel]
                columns = solver[:, begin:end] * evidence.noise[channel].weight(series.interval)
                follow[experiment.group, channel].append((experiment.clock(series.time - experiment.begin), columns))
            begin = end
    parts: dict[str, list[tuple[Array, Array, Array]]] = defaultdict(list)
    for channel in evidence.noise:
        for stack in stacks(evidence.experiments, found.residuals, channel):
            together = np.zeros((len(solver), stack.rows.shape[1]))
            for clock, columns in follow.get((stack.group, channel), ()):
                # Repeats need not begin together, nor be sampled as often: what they share is at one place of the walk.
                inside = (clock >= stack.clock[0]) & (clock <= stack.clock[-1])
                near = np.rint(np.interp(clock[inside], stack.clock, np.arange(float(len(stack.clock)))))
                place = near.astype(np.intp)
                together += np.array([np.bincount(place, row, len(stack.clock)) for row in columns[:, inside]])
            if together.any():
                parts[stack.group].append((together, stack.rows.mean(axis=0), stack.apart))
    return [Shared(*zip(*every, strict=True)) for every in parts.values()]


def unexplained(groups: Sequence[Shared]) -> Array:
    """Half width [steps], (unknowns,), for a misfit as large as what ``groups`` share, at other times in their trials.

    In place it moves nothing: the fit has seen to that. It might have come sooner or later, by up to :data:`SHIFT`, on
    average over all of these, and in the same sense in every group. What noise alone leaves in the mean over repeats
    does not count. (1,) with 0 without groups.
    """
    return float(norm.ppf(0.5 + 0.5 * LEVEL)) * sum((_moved(group) for group in groups), np.zeros(1))


def _moved(group: Shared) -> Array:
    """Root mean square over all shifts [steps]."""
    repeats = min(len(rows) for rows in group.apart)
    noise = [_square(group.follow, [rows[k] for rows in group.apart]) for k in range(repeats)]
    return np.asarray(np.sqrt(np.maximum(0.0, _square(group.follow, group.mean) - np.mean(noise, axis=0) / repeats)))


def _square(follow: Sequence[Array], rows: Sequence[Array]) -> Array:
    """Mean over shifts of the square of what ``rows`` do to the unknowns, channels shifted together.

    Of a shifted row only what meets the trial counts, and stands for all of it: strides are periodic, and begun anew at
    the other end they would cancel. Spectra of twice the duration have the same frequencies, however often a channel
    was sampled.
    """
    width = max(len(row) for row in rows)
    total = np.zeros((len(follow[0]), width + 1), np.complex128)
    for columns, row in zip(follow, rows, strict=True):
        size = 2 * len(row)
        total[:, : len(row) + 1] += np.fft.rfft(columns, size) * np.fft.rfft(row, size).conj() / size
    most = int(SHIFT * width)
    shift = np.arange(-most, most + 1)
    moved = 2.0 * width * np.fft.irfft(total, 2 * width)[:, shift] * width / (width - np.abs(shift))
    return np.asarray((moved**2).mean(axis=1))
