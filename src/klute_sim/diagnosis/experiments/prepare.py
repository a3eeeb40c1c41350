"""Preparation of all trials of a dataset for simulation on its rig."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from klute_sim.datasets.channels import RigName
from klute_sim.datasets.dataset import Dataset
from klute_sim.datasets.split import Split
from klute_sim.datasets.trial import TimeSeries, Trial, Use
from klute_sim.device.device import check_accepts_pressure
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.bench import prepare_bench_trial
from klute_sim.diagnosis.experiments.denoise import estimate_white_noise
from klute_sim.diagnosis.experiments.gait import prepare_gait_trial
from klute_sim.diagnosis.experiments.held_samples import drop_held_samples
from klute_sim.diagnosis.experiments.interpolated_samples import drop_interpolated_samples
from klute_sim.diagnosis.experiments.interpolation import changes_in_steps, shows_updates
from klute_sim.diagnosis.experiments.mains_hum import remove_mains_hum
from klute_sim.diagnosis.experiments.mechanism import prepare_mechanism_trial
from klute_sim.diagnosis.experiments.quantized_inputs import smooth_quantized_inputs
from klute_sim.effects import catalogue
from klute_sim.errors import InputError

TRIAL_PREPARERS: Mapping[RigName, Callable[[Trial, Use], Experiment]] = {
    "bench": prepare_bench_trial,
    "gait": prepare_gait_trial,
}
"""Rig -> function that prepares one trial; that of a mechanism also needs its model."""


def prepare_experiments(dataset: Dataset, split: Split, *, smooths_commands: bool = False) -> list[Experiment]:
    """Return the experiments of ``dataset`` in the order of its trials, used as ``split`` says.

    ``smooths_commands`` takes commands that were recorded in few steps to be smooth, as motions always are.

    Raises InputError for a device that is commanded by valve opening, for a trial that its rig cannot simulate, and
    for uncertain body parameters on a bench.
    """
    for key in dataset.uncertainties if dataset.rig != "gait" else ():
        section, _, name = key.partition(".")
        if section == "effects" and catalogue.get_effects()[name.partition(".")[0]].kind == "body":
            rig = "a bench" if dataset.rig == "bench" else "a mechanism"
            raise InputError(f"[uncertain] '{key}' describes the body, which {rig} does not test; remove the key")
    for trial in dataset.trials:
        for device in (trial.device, *trial.devices.values()):
            check_accepts_pressure(device, f"trial '{trial.name}'")
    uses: dict[str, Use] = dict.fromkeys(split.fit, "fit")
    uses |= dict.fromkeys(split.validation, "validation")
    uses |= dict.fromkeys(split.test, "test")
    trials = [
        smooth_quantized_inputs(trial, with_commands=smooths_commands) for trial in clean_recordings(dataset.trials)
    ]
    experiments = [_prepare_trial(trial, uses[trial.name], dataset) for trial in trials]
    return [e.with_repeats([other for other in experiments if other.group == e.group]) for e in experiments]


def clean_recordings(trials: Sequence[Trial]) -> list[Trial]:
    """Return ``trials`` without what a log adds between readings, and without the hum of the mains."""
    return [remove_mains_hum(drop_interpolated_samples(drop_held_samples(trial))) for trial in trials]


def compute_correlated_deviation(series: TimeSeries, deviation: float) -> float:
    """Return the standard deviation of the correlated part of a noise of ``deviation``, in the unit of ``series``.

    White noise shows in ``series`` itself and differs between repeats, so it is in their noise already. All else may be
    an error that they share, like that of a zero.
    """
    is_sampled = np.isfinite(series.value)  # a swing has no centre of pressure
    white = estimate_white_noise(series.time[is_sampled], series.value[is_sampled])
    return math.sqrt(max(0.0, deviation**2 - white**2))


def _prepare_trial(trial: Trial, use: Use, dataset: Dataset) -> Experiment:
    if dataset.mechanism is None:
        prepare_linear = TRIAL_PREPARERS[dataset.rig]
    else:
        prepare_linear = partial(prepare_mechanism_trial, dataset.mechanism)
    commands = [
        s for name, s in trial.prescribed.items() if name.startswith("pressure_command") and np.ptp(s.value) > 0
    ]
    shows_hold = any(map(shows_updates, commands))

    def prepare(trial: Trial, use: Use) -> Experiment:
        experiment = prepare_linear(trial, use)
        return (experiment.zero_order_hold_variant or experiment) if shows_hold else experiment

    variants = []
    for channel, deviation in trial.input_noise.items():
        series = trial.prescribed[channel]
        shift = compute_correlated_deviation(series, deviation)
        if shift > 0.0:
            shifted = {**trial.prescribed, channel: series._replace(value=series.value + shift)}
            variants.append(prepare(replace(trial, prescribed=shifted), use))
    return replace(
        prepare(trial, use),
        has_logged_updates=shows_hold,
        has_stepped_command=bool(commands) and all(map(changes_in_steps, commands)),
        noisy_variants=tuple(variants),
    )
