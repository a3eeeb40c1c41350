"""What of a dataset can be used: all checks in their order, before anything is fitted."""

from collections.abc import Sequence
from typing import NamedTuple

from klute_sim.dataset.dataset import Dataset
from klute_sim.diagnose import check
from klute_sim.diagnose.experiment import Bench, Experiment
from klute_sim.diagnose.fit import Evidence
from klute_sim.diagnose.hypothesis import Hypothesis

NOTHING = "No usable channel is left. Check cables and columns."


class Usable(NamedTuple):
    """Trials with what can be used of their channels."""

    every: list[Experiment]
    fitted: list[Experiment]
    """Those that are fitted and have a channel left."""
    reasons: list[str]
    """What was left out, and what cannot show."""
    against: list[str]
    """Why nothing can be said at all, with the mend; none: it can."""


def usable(dataset: Dataset, prepared: Sequence[Experiment], bench: Bench) -> Usable:
    """Leave out dead channels, saturated samples, repeats that disagree, and what was never repeated.

    Trials that are kept back to show lose the channels that nothing is known of, and are not looked at otherwise.
    """
    given = [e for e in prepared if e.use == "fit"]
    dead, remarks = check.faults(given)
    every = check.without(check.unsaturated(prepared, given), check.everywhere(prepared, dead))
    reasons = [f"{why}; it is not used." for why in dead.values()] + [f"{remark}." for remark in remarks]

    seen = [e for e in every if e.use != "show" and e.measured]
    if not any(e.use == "fit" for e in seen):
        return Usable(every, [], reasons, [NOTHING])
    plain = Hypothesis(dataset.device, (), ())
    wrong, against = check.disagreements(seen, Evidence(bench, seen, {}).residuals(plain, [plain.start()])[0])
    every = check.without(every, wrong)
    reasons += dict.fromkeys(wrong.values())

    alone = check.unrepeated([e for e in every if e.use == "fit"])
    every = check.without(every, check.everywhere(every, alone))
    reasons += [f"{why}; it is not used." for why in alone.values()]
    fitted = [e for e in every if e.use == "fit" and e.measured]
    if not fitted:
        return Usable(every, [], reasons, [*against, NOTHING])
    return Usable(every, fitted, [*reasons, *check.blind(fitted)], [*against, *check.obstacles(fitted)])
