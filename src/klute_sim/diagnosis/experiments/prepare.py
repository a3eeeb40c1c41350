"""Preparation of all trials of a dataset for simulation on its rig."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from klute_sim.datasets.channels import Rig
from klute_sim.datasets.dataset import Dataset
from klute_sim.datasets.split import Split
from klute_sim.datasets.trial import Trial, Use
from klute_sim.device.device import check_accepts_pressure
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.bench import prepare_bench_trial
from klute_sim.diagnosis.experiments.gait import prepare_gait_trial
from klute_sim.effects import catalogue
from klute_sim.errors import InputError

TRIAL_PREPARERS: Mapping[Rig, Callable[[Trial, Use], Experiment]] = {
    "bench": prepare_bench_trial,
    "gait": prepare_gait_trial,
}
"""Rig -> function that prepares one trial."""


def prepare_experiments(dataset: Dataset, split: Split) -> list[Experiment]:
    """Return the experiments of ``dataset`` in the order of its trials, used as ``split`` says.

    Raises InputError for a device that is commanded by valve opening, for a trial that its rig cannot simulate, and
    for uncertain body parameters on a bench.
    """
    for key in dataset.uncertainties if dataset.rig == "bench" else ():
        section, _, name = key.partition(".")
        if section == "effects" and catalogue.get_effects()[name.partition(".")[0]].kind == "body":
            raise InputError(f"[uncertain] '{key}' describes the body, which a bench does not test; remove the key")
    for trial in dataset.trials:
        check_accepts_pressure(trial.device, f"trial '{trial.name}'")
    uses: dict[str, Use] = dict.fromkeys(split.fit, "fit")
    uses |= dict.fromkeys(split.validation, "validation")
    uses |= dict.fromkeys(split.test, "test")
    experiments = [_prepare_trial(trial, uses[trial.name], dataset.rig) for trial in dataset.trials]
    return [e.with_repeats([other for other in experiments if other.group == e.group]) for e in experiments]


def _prepare_trial(trial: Trial, use: Use, rig: Rig) -> Experiment:
    prepare = TRIAL_PREPARERS[rig]
    variants = []
    for channel, deviation in trial.input_noise.items():
        series = trial.prescribed[channel]
        shifted = {**trial.prescribed, channel: series._replace(value=series.value + deviation)}
        variants.append(prepare(replace(trial, prescribed=shifted), use))
    return replace(prepare(trial, use), noisy_variants=tuple(variants))
