"""What is wrong in the same way in every repeat, so that no difference between repeats tells of it.

A walk is replayed from what was measured of it: its motion is smoothed before it is differentiated twice, its load is
sampled, and the replay knows less of limb and foot than they are. That moves the fitted numbers alike in all repeats.
Two things are known of it: what preparing and simulating the trials in another way would change, and what the fit
leaves that all repeats share. A rig that prescribes exactly what was commanded has neither
(:attr:`~klute_sim.diagnosis.experiments.base.Experiment.otherwise` is empty there).
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from klute_sim.diagnosis.experiments.base import Array
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData
from klute_sim.diagnosis.noise.repeats import align_repeats

CONFIDENCE_LEVEL = 0.95
"""Of the intervals."""
MAX_SHIFT_FRACTION = 0.25
"""Of a trial, by which a misfit is shifted: a stride of four, or more (assumed)."""


class SharedMisfit(NamedTuple):
    """What the fit leaves in one group of repeats."""

    sensitivities: Sequence[Array]
    """Per channel: (unknowns, samples) how the unknowns, in steps, follow what all repeats share [1/SI]."""
    mean_residuals: Sequence[Array]
    """Per channel: (samples) residual in the mean over the repeats [SI]."""
    deviations: Sequence[Array]
    """Per channel: (repeats, samples) noise that one of them has [SI]."""


def estimate_preparation_errors(data: WeightedData, fit: Fit, pseudoinverse: Array) -> list[Array]:
    """By how much, at most, the unknowns would be others [steps], (unknowns,) each, had something been done otherwise.

    Each is a fit of one linear step (``solver``, the pseudoinverse of the fit's Jacobian): trials simulated in long
    steps, then each way to prepare them. These are half widths of what may be wrong (assumed: what is left out is no
    more than what the other choice changes).
    """
    variants = list(zip(*(e.preparation_variants for e in data.experiments), strict=True))
    if not variants:
        return []

    def moved(other: WeightedData, *, coarse: bool = False) -> Array:
        (residuals,) = other.compute_residuals(fit.hypothesis, [fit.x], coarse=coarse)
        change = data.weight_residuals(residuals) - data.weight_residuals(fit.residuals)
        return np.asarray(np.abs(pseudoinverse[:, : len(change)] @ change))

    return [moved(data, coarse=True), *(moved(data.with_experiments(experiments)) for experiments in variants)]


def collect_shared_misfits(data: WeightedData, fit: Fit, pseudoinverse: Array) -> list[SharedMisfit]:
    """Of the groups whose trials could have been prepared otherwise."""
    follow: dict[tuple[str, str], list[tuple[Array, Array]]] = defaultdict(list)
    begin = 0
    for experiment, weights, residual in zip(data.experiments, data.weights, fit.residuals, strict=True):
        for channel in weights:
            end = begin + len(residual[channel])
            if experiment.preparation_variants:
                series = experiment.measured[channel]
                columns = pseudoinverse[:, begin:end] * data.noise[channel].weight(series.sampling_interval)
                follow[experiment.group, channel].append(
                    (experiment.align_time(series.time - experiment.start_time), columns)
                )
            begin = end
    parts: dict[str, list[tuple[Array, Array, Array]]] = defaultdict(list)
    for channel in data.noise:
        for stack in align_repeats(data.experiments, fit.residuals, channel):
            together = np.zeros((len(pseudoinverse), stack.residuals.shape[1]))
            for clock, columns in follow.get((stack.group, channel), ()):
                # Repeats need not begin together, nor be sampled as often: what they share is at one place of the walk.
                inside = (clock >= stack.time[0]) & (clock <= stack.time[-1])
                near = np.rint(np.interp(clock[inside], stack.time, np.arange(float(len(stack.time)))))
                place = near.astype(np.intp)
                together += np.array([np.bincount(place, row, len(stack.time)) for row in columns[:, inside]])
            if together.any():
                parts[stack.group].append((together, stack.residuals.mean(axis=0), stack.deviations))
    return [SharedMisfit(*zip(*every, strict=True)) for every in parts.values()]


def estimate_misfit_error(misfits: Sequence[SharedMisfit]) -> Array:
    """Half width [steps], (unknowns,), for a misfit as large as what ``groups`` share, at other times in their trials.

    In place it moves nothing: the fit has seen to that. It might have come sooner or later, by up to :data:`SHIFT`, on
    average over all of these, and in the same sense in every group. What noise alone leaves in the mean over repeats
    does not count. (1,) with 0 without groups.
    """
    return float(norm.ppf(0.5 + 0.5 * CONFIDENCE_LEVEL)) * sum(
        (_rms_over_shifts(group) for group in misfits), np.zeros(1)
    )


def _rms_over_shifts(misfit: SharedMisfit) -> Array:
    """Root mean square over all shifts [steps]."""
    repeats = min(len(rows) for rows in misfit.deviations)
    noise = [
        _mean_square_over_shifts(misfit.sensitivities, [rows[k] for rows in misfit.deviations]) for k in range(repeats)
    ]
    return np.asarray(
        np.sqrt(
            np.maximum(
                0.0,
                _mean_square_over_shifts(misfit.sensitivities, misfit.mean_residuals)
                - np.mean(noise, axis=0) / repeats,
            )
        )
    )


def _mean_square_over_shifts(sensitivities: Sequence[Array], residuals: Sequence[Array]) -> Array:
    """Mean over shifts of the square of what ``rows`` do to the unknowns, channels shifted together.

    Of a shifted row only what meets the trial counts, and stands for all of it: strides are periodic, and begun anew at
    the other end they would cancel. Spectra of twice the duration have the same frequencies, however often a channel
    was sampled.
    """
    width = max(len(row) for row in residuals)
    total = np.zeros((len(sensitivities[0]), width + 1), np.complex128)
    for columns, row in zip(sensitivities, residuals, strict=True):
        size = 2 * len(row)
        total[:, : len(row) + 1] += np.fft.rfft(columns, size) * np.fft.rfft(row, size).conj() / size
    most = int(MAX_SHIFT_FRACTION * width)
    shift = np.arange(-most, most + 1)
    moved = 2.0 * width * np.fft.irfft(total, 2 * width)[:, shift] * width / (width - np.abs(shift))
    return np.asarray((moved**2).mean(axis=1))
