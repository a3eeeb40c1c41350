"""Systematic errors: errors that all repeats share, so that no difference between repeats reveals them.

A gait trial is replayed from measurements: its motion is filtered before it is differentiated twice, its load is
sampled, and the replay simplifies limb and foot. This shifts the fitted parameters alike in all repeats. Two estimates
bound the shift: the effect of another preparation or time step, and the effect of the misfit that all repeats share. A
rig that prescribes exactly what was commanded has neither error (it has no
:attr:`~klute_sim.diagnosis.experiments.base.Experiment.preparation_variants`).
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import align_repeats
from klute_sim.types import Array

CONFIDENCE_LEVEL = 0.95
"""Coverage of the confidence intervals."""
MAX_SHIFT_FRACTION = 0.25
"""Largest time shift of a misfit, as a fraction of the trial: one stride of four, or more (assumed)."""


class MisfitInfluence(NamedTuple):
    """Residuals of the fit in one group of repeats, with their influence on the parameters."""

    sensitivities: Sequence[Array]
    """For each channel: derivative of the normalized parameters by residuals common to all repeats [1/SI],
    (parameters, samples)."""
    mean_residuals: Sequence[Array]
    """For each channel: mean residual over the repeats [SI], (samples,)."""
    deviations: Sequence[Array]
    """For each channel: noise of single repeats [SI], (repeats, samples)."""


def estimate_preparation_errors(data: WeightedData, fit: Fit, pseudoinverse: Array) -> list[Array]:
    """Return bounds of the parameter changes due to the time step and to each variant of the preparation.

    Each entry holds absolute changes of the normalized parameters, (parameters,), from one linear step with the
    ``pseudoinverse`` of the fit's Jacobian. They serve as half widths (assumed: the error of a choice is not larger
    than the change to the alternative).
    """
    variants = list(zip(*(e.preparation_variants for e in data.experiments), strict=True))
    if not variants:
        return []

    def compute_change(alternative: WeightedData, *, coarse: bool = False) -> Array:
        (residuals,) = alternative.compute_residuals(fit.hypothesis, [fit.x], coarse=coarse)
        change = data.weight_residuals(residuals) - data.weight_residuals(fit.residuals)
        return np.asarray(np.abs(pseudoinverse[:, : len(change)] @ change))

    return [
        compute_change(data, coarse=True),
        *(compute_change(data.with_experiments(experiments)) for experiments in variants),
    ]


def collect_shared_misfits(data: WeightedData, fit: Fit, pseudoinverse: Array) -> list[MisfitInfluence]:
    """Return the shared misfit of each group whose trials have variants of their preparation."""
    influences: dict[tuple[str, str], list[tuple[Array, Array]]] = defaultdict(list)
    start = 0
    for experiment, weights, residual in zip(data.experiments, data.weights, fit.residuals, strict=True):
        for channel in weights:
            end = start + len(residual[channel])
            if experiment.preparation_variants:
                series = experiment.measured[channel]
                columns = pseudoinverse[:, start:end] * data.noise[channel].weight(series.sampling_interval)
                columns = columns / experiment.input_error_scale.get(channel, 1.0)
                time = experiment.align_time(series.time - experiment.start_time)
                influences[experiment.group, channel].append((time, columns))
            start = end
    parts: dict[str, list[tuple[Array, Array, Array]]] = defaultdict(list)
    for channel in data.noise:
        for repeats in align_repeats(data.experiments, fit.residuals, channel):
            total = np.zeros((len(pseudoinverse), repeats.residuals.shape[1]))
            for time, columns in influences.get((repeats.group, channel), ()):
                # Repeats may differ in start and sampling rate; they share the misfit at equal aligned times.
                is_covered = (time >= repeats.time[0]) & (time <= repeats.time[-1])
                nearest = np.rint(np.interp(time[is_covered], repeats.time, np.arange(float(len(repeats.time)))))
                index = nearest.astype(np.intp)
                total += np.array([np.bincount(index, row, len(repeats.time)) for row in columns[:, is_covered]])
            if total.any():
                parts[repeats.group].append((total, repeats.residuals.mean(axis=0), repeats.deviations))
    return [MisfitInfluence(*zip(*channels, strict=True)) for channels in parts.values()]


def estimate_misfit_error(misfits: Sequence[MisfitInfluence]) -> Array:
    """Return the half width of the normalized parameters, (parameters,), due to shared misfit.

    The misfit itself does not move the parameters: the fit has absorbed it. A misfit of equal size might have occurred
    earlier or later, by up to :data:`MAX_SHIFT_FRACTION`; the half width is the root mean square over these shifts,
    added over groups because all may move in the same sense. The part that noise leaves in the mean over repeats is
    subtracted. Without groups, returns (1,) of 0.
    """
    return float(norm.ppf(0.5 + 0.5 * CONFIDENCE_LEVEL)) * sum(
        (_rms_over_shifts(misfit) for misfit in misfits), np.zeros(1)
    )


def _rms_over_shifts(misfit: MisfitInfluence) -> Array:
    """Return the root mean square change of the normalized parameters over all time shifts, (parameters,)."""
    n_repeats = min(len(rows) for rows in misfit.deviations)
    noise = [
        _mean_square_over_shifts(misfit.sensitivities, [rows[k] for rows in misfit.deviations])
        for k in range(n_repeats)
    ]
    mean_square = _mean_square_over_shifts(misfit.sensitivities, misfit.mean_residuals)
    return np.asarray(np.sqrt(np.maximum(0.0, mean_square - np.mean(noise, axis=0) / n_repeats)))


def _mean_square_over_shifts(sensitivities: Sequence[Array], residuals: Sequence[Array]) -> Array:
    """Return the mean square change of the normalized parameters by shifted ``residuals``, (parameters,).

    Channels are shifted together. Only the part of a shifted residual that overlaps the trial counts, scaled to the
    whole: strides are periodic, and a circular shift would cancel. Spectra of twice the duration have equal
    frequencies for all sampling rates.
    """
    width = max(len(row) for row in residuals)
    spectrum = np.zeros((len(sensitivities[0]), width + 1), np.complex128)
    for columns, row in zip(sensitivities, residuals, strict=True):
        size = 2 * len(row)
        spectrum[:, : len(row) + 1] += np.fft.rfft(columns, size) * np.fft.rfft(row, size).conj() / size
    max_shift = int(MAX_SHIFT_FRACTION * width)
    shift = np.arange(-max_shift, max_shift + 1)
    change = 2.0 * width * np.fft.irfft(spectrum, 2 * width)[:, shift] * width / (width - np.abs(shift))
    return np.asarray((change**2).mean(axis=1))
