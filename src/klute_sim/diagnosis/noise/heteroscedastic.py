"""Heteroscedastic noise: its variance follows the device's sensitivity to the noise of its inputs.

A weakly inflated muscle moves far for a small pressure change; a stiff one pulls hard for a small length change. The
variance of a channel is modelled as ``A + B s_p^2 + C s_L^2`` with nonnegative A, B and C. The sensitivities ``s_p`` to
the commanded pressure and ``s_L`` to the prescribed length (in gait: to the centre of pressure) come from two
simulations, the coefficients from the deviations of repeats. While a regulator limits the rate of the pressure, timing
matters as well: the start of a pressure change is known to within one time step, and the resulting variance is added.
Noise that the user states for a prescribed channel is white as far as the channel shows it; the rest, where repeats do
not show it, is an error that they share.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from klute_sim.diagnosis.experiments.base import Experiment, SimulationSetup
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.experiments.time_step import COARSE_STEP_FACTOR
from klute_sim.diagnosis.noise.repeats import Residuals, align_repeats, list_channels
from klute_sim.diagnosis.noise.trial_noise import describe_noisy_trials, estimate_noise_ratios
from klute_sim.types import Array

MIN_VARIANCE_FRACTION = 0.05
"""Lower limit of the variance, as a fraction of its mean (assumed)."""
INPUT_ERROR_SIGMAS = 8.0
"""Factor on the difference between two interpolations of the inputs, which then counts as noise: twice the inverse of
the smallest relevant misfit (a quarter of the noise), because the true input may differ more."""
MAX_REPEATED_RATIO = 1.5
"""Ratio of the stated variance to that between repeats above which repeats share a part of it (assumed: repeats measure
their variance to within a half)."""
MAX_INPUT_VARIANCE_FRACTION = 0.1
"""Mean variance of a channel from the inputs between their samples, over that of its noise, above which the inputs of a
trial are called too slow (assumed)."""
MAX_LOST_WEIGHT = 0.1
"""Mean weight that samples of a channel lose because of the stated noise of the inputs, above which a remark says so
(assumed)."""
N_REWEIGHTINGS = 3
"""Iterations of the weighted fit of the variance model."""


def add_noise_scales(
    experiments: Sequence[Experiment], fit_experiments: Sequence[Experiment], simulator: Simulator
) -> tuple[list[Experiment], list[str]]:
    """Return ``experiments`` with noise scales, and remarks about trials that count less.

    Before timing and noisy trials count, the mean square of the scales over the repeats of ``fit_experiments`` is 1.
    Channels without repeats keep a scale of 1, and so does a test trial whose simulation diverges. An input to which a
    channel does not respond leaves its scale.

    Raises SimulationError when the simulation of another trial diverges.
    """
    sensitivities = _compute_sensitivities(experiments, simulator)
    all_experiments, experiments = experiments, [e for e in experiments if e.name in sensitivities]
    rows = [sensitivities[e.name] for e in experiments]
    input_errors = _compute_input_errors(experiments, rows, simulator)
    stated_variances = _compute_stated_variances(experiments, rows, simulator)
    all_residuals = [
        {channel: series.value - row[channel][0] for channel, series in e.measured.items()}
        for e, row in zip(experiments, rows, strict=True)
    ]
    noise_ratios = estimate_noise_ratios(experiments, all_residuals)
    ratios = {e.name: row for e, row in zip(experiments, noise_ratios, strict=True)}
    fit_experiments = [
        replace(e, noise_scale={c: np.full(len(e.measured[c].time), ratio) for c, ratio in ratios[e.name].items()})
        for e in fit_experiments
    ]
    residuals = [
        {channel: series.value - sensitivities[e.name][channel][0] for channel, series in e.measured.items()}
        for e in fit_experiments
    ]
    models = {
        channel: _fit_variance_model(fit_experiments, residuals, sensitivities, channel)
        for channel in list_channels(fit_experiments)
    }
    scaled = {}
    slow_trials: dict[str, None] = {}
    imprecise_trials: dict[str, None] = {}
    for e, row, errors, stated in zip(experiments, rows, input_errors, stated_variances, strict=True):
        scales: dict[str, Array] = {}
        input_error_scales: dict[str, Array] = {}
        input_noise_shares: dict[str, Array] = {}
        for channel in e.measured:
            model = models.get(channel)
            if model is not None and len(e.measured[channel].time):
                variance = np.maximum(
                    MIN_VARIANCE_FRACTION, row[channel][1:3].T @ model.coefficients[1:] + model.coefficients[0]
                )
                variance_with_timing = variance + row[channel][3] / model.mean_variance
                scales[channel] = ratios[e.name][channel] * np.sqrt(variance_with_timing)
                input_noise_shares[channel] = model.coefficients[2] * row[channel][2] / variance_with_timing
                if channel in errors or channel in stated:
                    noise_variance = scales[channel] ** 2 * model.mean_variance
                    shared = np.maximum(0.0, stated.get(channel, 0.0) - MAX_REPEATED_RATIO * noise_variance)
                    between_samples, stated_noise = errors.get(channel, 0.0), INPUT_ERROR_SIGMAS**2 * shared
                    if np.isfinite(between_samples + stated_noise).all():
                        variance_ratio = (between_samples + stated_noise) / noise_variance
                        input_error_scales[channel] = np.sqrt(1.0 + variance_ratio)
                        if np.mean(between_samples / noise_variance) > MAX_INPUT_VARIANCE_FRACTION:
                            slow_trials[e.name] = None
                        if np.mean(stated_noise / (stated_noise + noise_variance)) > MAX_LOST_WEIGHT:
                            imprecise_trials[e.name] = None
        scaled[e.name] = replace(
            e, noise_scale=scales, input_error_scale=input_error_scales, input_noise_share=input_noise_shares
        )
    remarks = [
        *describe_noisy_trials(experiments, noise_ratios),
        *_describe_slow_inputs(list(slow_trials)),
        *_describe_imprecise_inputs(list(imprecise_trials)),
    ]
    return [scaled.get(e.name, e) for e in all_experiments], remarks


def _describe_slow_inputs(trials: Sequence[str]) -> list[str]:
    """Return a sentence about ``trials`` in which other interpolations of the inputs matter, if any."""
    if not trials:
        return []
    return [
        f"The inputs of {_name_trials(trials)} are sampled too slowly: samples that depend on how the inputs are "
        "interpolated count less. Record the inputs faster."
    ]


def _describe_imprecise_inputs(trials: Sequence[str]) -> list[str]:
    """Return a sentence about ``trials`` in which the stated noise of the inputs exceeds what repeats show, if any."""
    if not trials:
        return []
    return [
        f"Repeats of {_name_trials(trials)} agree better than the noise of the inputs that [noise] states allows: they "
        "share errors of the inputs, and samples that depend on these count less. Measure the inputs more precisely, "
        "or correct [noise]."
    ]


def _name_trials(trials: Sequence[str]) -> str:
    return f"'{trials[0]}'" if len(trials) == 1 else f"{len(trials)} trials"


def _compute_input_errors(
    experiments: Sequence[Experiment], rows: Sequence[Mapping[str, Array]], simulator: Simulator
) -> list[dict[str, Array]]:
    """Return for each experiment: channel -> variance [SI^2] that counts for the inputs between their samples.

    The inputs between samples are unknown. The mean square change with other valid interpolations of an input, added
    over inputs, is the same in all repeats; times :data:`INPUT_ERROR_SIGMAS` squared, it counts as noise, so that it
    cannot look like a misfit.
    """
    errors = []
    for e, row in zip(experiments, rows, strict=True):
        setup = SimulationSetup(e.device.parameters)
        variance: dict[str, Array] = {}
        for variants in e.input_variants:
            readings = [_simulate_variant(setup, variant, simulator) for variant in variants]
            for channel, values in row.items():
                squares = np.mean([(reading[channel] - values[0]) ** 2 for reading in readings], axis=0)
                variance[channel] = variance.get(channel, 0.0) + INPUT_ERROR_SIGMAS**2 * squares
        errors.append(variance)
    return errors


def _compute_stated_variances(
    experiments: Sequence[Experiment], rows: Sequence[Mapping[str, Array]], simulator: Simulator
) -> list[dict[str, Array]]:
    """Return for each experiment: channel -> variance [SI^2] from the stated noise of its inputs that is not white.

    ``rows`` hold the sensitivities. The noise of each prescribed channel is independent of that of the others.
    """
    variances = []
    for e, row in zip(experiments, rows, strict=True):
        setup = SimulationSetup(e.device.parameters)
        # The variants were prepared before samples were left out, and a shifted load changes which samples count.
        variants = [
            replace(variant, measured=e.measured, quantizers=e.quantizers, filters=e.filters, limits=e.limits)
            for variant in e.noisy_variants
        ]
        readings = [_simulate_variant(setup, variant, simulator) for variant in variants]
        variances.append(
            {
                channel: np.sum([(reading[channel] - values[0]) ** 2 for reading in readings], axis=0)
                for channel, values in row.items()
                if readings
            }
        )
    return variances


def _simulate_variant(setup: SimulationSetup, variant: Experiment, simulator: Simulator) -> dict[str, Array]:
    """Return the readings of ``variant``; infinite where the simulation of a test trial diverges."""
    return simulator.simulate([[setup]], [variant], may_diverge=variant.use == "test")[0][0]


class _VarianceModel(NamedTuple):
    """Variance of a channel's noise as a function of its sensitivities."""

    coefficients: Array
    """A, B and C over the mean variance."""
    mean_variance: float
    """Mean variance [SI^2]."""


def _compute_sensitivities(experiments: Sequence[Experiment], simulator: Simulator) -> dict[str, dict[str, Array]]:
    """Return trial -> channel -> (4, samples), without test trials whose simulation diverges.

    The rows are the simulated reading [SI] and the squares of its changes [SI^2] for a perturbed pressure, for a
    perturbed mechanical input, and for a command that is one time step late.
    """
    sensitivities = {}
    for is_test in (False, True):
        trials = [e for e in experiments if (e.use == "test") == is_test]
        perturbed = zip(*(e.perturb_inputs(_delay_command) for e in trials), strict=True)
        readings = [
            simulator.simulate([[SimulationSetup(e.device.parameters) for e in variant]], variant, may_diverge=is_test)[
                0
            ]
            for variant in (trials, *perturbed)
        ]
        for e, *rows in zip(trials, *readings, strict=True):
            if all(np.isfinite(values).all() for row in rows for values in row.values()):
                sensitivities[e.name] = _square_changes(*rows)
    return sensitivities


def _square_changes(
    nominal: Mapping[str, Array],
    pressure: Mapping[str, Array],
    mechanical: Mapping[str, Array],
    delayed: Mapping[str, Array],
) -> dict[str, Array]:
    return {
        channel: np.stack(
            [
                reading,
                (pressure[channel] - reading) ** 2,
                (mechanical[channel] - reading) ** 2,
                ((delayed[channel] - reading) / COARSE_STEP_FACTOR) ** 2,
            ]
        )
        for channel, reading in nominal.items()
    }


def _delay_command(command: Array) -> Array:
    """Return ``command`` delayed by a whole number of steps at both the normal and the coarse time step."""
    return np.concatenate([np.repeat(command[:1], COARSE_STEP_FACTOR), command[:-COARSE_STEP_FACTOR]])


def _fit_variance_model(
    fit_experiments: Sequence[Experiment],
    residuals: Residuals,
    sensitivities: Mapping[str, dict[str, Array]],
    channel: str,
) -> _VarianceModel | None:
    """Fit the variance model of ``channel`` by reweighted least squares; return None without repeats."""
    regressors, variances = [], []
    first_of_group = {e.group: e for e in reversed(fit_experiments) if channel in e.measured}
    for repeats in align_repeats(fit_experiments, residuals, channel):
        e = first_of_group[repeats.group]
        time = e.align_time(e.measured[channel].time - e.start_time)
        squared_sensitivities = sensitivities[e.name][channel][1:3]
        regressors.append(
            np.stack([np.ones(len(repeats.time)), *(np.interp(repeats.time, time, s) for s in squared_sensitivities)])
        )
        variances.append(repeats.variance)
    if not regressors:
        return None
    columns, squares = np.concatenate(regressors, axis=1).T, np.concatenate(variances)
    column_means, mean_variance = columns.mean(axis=0), float(squares.mean())
    if not mean_variance > 0.0:
        return None
    is_sensitive = column_means > 0.0
    scaled_columns = columns[:, is_sensitive] / column_means[is_sensitive]
    variance, coefficients = np.full(len(squares), mean_variance), np.zeros(3)
    for _ in range(N_REWEIGHTINGS):
        solution = nnls(scaled_columns / variance[:, np.newaxis], squares / variance)[0]
        coefficients[is_sensitive] = solution / column_means[is_sensitive]
        variance = np.maximum(columns @ coefficients, MIN_VARIANCE_FRACTION * mean_variance)
    return _VarianceModel(np.asarray(coefficients / (columns @ coefficients).mean()), mean_variance)
