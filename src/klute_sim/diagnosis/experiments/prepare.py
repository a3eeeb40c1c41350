"""The trials of a dataset made ready for simulation on its rig."""

from collections.abc import Callable, Mapping

from klute_sim.datasets.channels import Rig
from klute_sim.datasets.dataset import Dataset
from klute_sim.datasets.split import Split
from klute_sim.datasets.trial import Trial, Use
from klute_sim.device.device import check_takes_pressure
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.bench import prepare_bench_trial
from klute_sim.diagnosis.experiments.gait import prepare_gait_trial
from klute_sim.effects import catalogue
from klute_sim.errors import InputError

TRIAL_PREPARERS: Mapping[Rig, Callable[[Trial, Use], Experiment]] = {
    "bench": prepare_bench_trial,
    "gait": prepare_gait_trial,
}


def prepare_experiments(dataset: Dataset, split: Split) -> list[Experiment]:
    """The trials of ``dataset``, in its order.

    Raises InputError for devices that are commanded by openings, trials that its rig cannot simulate, or numbers of the
    body that are said to be uncertain where there is none.
    """
    for key in dataset.uncertainties if dataset.rig == "bench" else ():
        section, _, name = key.partition(".")
        if section == "effects" and catalogue.get_effects()[name.partition(".")[0]].kind == "body":
            raise InputError(f"[uncertain] '{key}' is of the body, and a bench shows nothing of that; take it out")
    for trial in dataset.trials:
        check_takes_pressure(trial.device, f"trial '{trial.name}'")
    uses: dict[str, Use] = dict.fromkeys(split.fit, "fit")
    uses |= dict.fromkeys(split.validation, "select")
    uses |= dict.fromkeys(split.test, "show")
    found = [TRIAL_PREPARERS[dataset.rig](trial, uses[trial.name]) for trial in dataset.trials]
    return [e.with_repeats([other for other in found if other.group == e.group]) for e in found]
