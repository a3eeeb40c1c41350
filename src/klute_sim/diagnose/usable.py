"""What of a dataset can be used: all checks in their order, before anything is fitted."""

from collections.abc import Sequence
from typing import NamedTuple

from klute_sim.dataset.dataset import Dataset
from klute_sim.diagnose import check
from klute_sim.diagnose.experiment import Experiment, Simulator
from klute_sim.diagnose.fit import WeightedData
from klute_sim.diagnose.hypothesis import Hypothesis

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
    dead, remarks = check.find_faulty_channels(given)
    every = check.remove_channels(
        check.remove_saturated_samples(experiments, given), check.pair_trials_with_channels(experiments, dead)
    )
    reasons = [f"{why}; it is not used." for why in dead.values()] + [f"{remark}." for remark in remarks]

    seen = [e for e in every if e.use != "show" and e.measured]
    if not any(e.use == "fit" for e in seen):
        return UsableData(every, [], reasons, [NO_USABLE_CHANNEL])
    plain = Hypothesis(dataset.device, (), ())
    wrong, against = check.find_contradicted_channels(
        seen, WeightedData(simulator, seen, {}).compute_residuals(plain, [plain.initial_point()])[0]
    )
    every = check.remove_channels(every, wrong)
    reasons += dict.fromkeys(wrong.values())

    alone = check.find_unrepeated_channels([e for e in every if e.use == "fit"])
    every = check.remove_channels(every, check.pair_trials_with_channels(every, alone))
    reasons += [f"{why}; it is not used." for why in alone.values()]
    fitted = [e for e in every if e.use == "fit" and e.measured]
    if not fitted:
        return UsableData(every, [], reasons, [*against, NO_USABLE_CHANNEL])
    return UsableData(
        every, fitted, [*reasons, *check.find_limitations(fitted)], [*against, *check.find_blocking_problems(fitted)]
    )
