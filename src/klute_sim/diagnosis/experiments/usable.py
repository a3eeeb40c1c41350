"""What of a dataset can be used: all checks in their order, before anything is fitted."""

from collections.abc import Sequence
from typing import NamedTuple

from klute_sim.datasets.dataset import Dataset
from klute_sim.diagnosis.experiments import data_quality
from klute_sim.diagnosis.experiments.base import Experiment, Simulator
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import WeightedData

NO_USABLE_CHANNEL = "No usable channel is left. Check cables and columns."


class UsableData(NamedTuple):
    """Trials with what can be used of their channels."""

    experiments: list[Experiment]
    fit_experiments: list[Experiment]
    """Those that are fitted and have a channel left."""
    remarks: list[str]
    """What was left out, and what cannot show."""
    blocking_problems: list[str]
    """Why nothing can be said at all, with the mend; none: it can."""


def select_usable_data(dataset: Dataset, experiments: Sequence[Experiment], simulator: Simulator) -> UsableData:
    """Leave out dead channels, saturated samples, repeats that disagree, and what was never repeated.

    Trials that are kept back to show lose the channels that nothing is known of, and are not looked at otherwise.
    """
    given = [e for e in experiments if e.use == "fit"]
    dead, remarks = data_quality.find_faulty_channels(given)
    every = data_quality.remove_channels(
        data_quality.remove_saturated_samples(experiments, given),
        data_quality.pair_trials_with_channels(experiments, dead),
    )
    reasons = [f"{why}; it is not used." for why in dead.values()] + [f"{remark}." for remark in remarks]

    seen = [e for e in every if e.use != "show" and e.measured]
    if not any(e.use == "fit" for e in seen):
        return UsableData(every, [], reasons, [NO_USABLE_CHANNEL])
    plain = Hypothesis(dataset.device, (), ())
    wrong, against = data_quality.find_contradicted_channels(
        seen, WeightedData(simulator, seen, {}).compute_residuals(plain, [plain.initial_point()])[0]
    )
    every = data_quality.remove_channels(every, wrong)
    reasons += dict.fromkeys(wrong.values())

    alone = data_quality.find_unrepeated_channels([e for e in every if e.use == "fit"])
    every = data_quality.remove_channels(every, data_quality.pair_trials_with_channels(every, alone))
    reasons += [f"{why}; it is not used." for why in alone.values()]
    fitted = [e for e in every if e.use == "fit" and e.measured]
    if not fitted:
        return UsableData(every, [], reasons, [*against, NO_USABLE_CHANNEL])
    return UsableData(
        every,
        fitted,
        [*reasons, *data_quality.find_limitations(fitted)],
        [*against, *data_quality.find_blocking_problems(fitted)],
    )
