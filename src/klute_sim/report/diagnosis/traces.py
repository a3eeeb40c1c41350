"""The trials that a diagnosis shows, simulated before and after effects are added."""

from collections.abc import Mapping
from typing import NamedTuple

from klute_sim.diagnosis.experiments.base import Array, Experiment, Simulator
from klute_sim.diagnosis.workflow import Diagnosis


class SimulatedTrial(NamedTuple):
    """A trial and what its instruments would have shown [SI], at the times of its samples."""

    experiment: Experiment
    before: Mapping[str, Array]
    """Channel -> with the refitted device, without effects."""
    after: Mapping[str, Array]
    """With the effects; the same if none was found."""

    def sample_times(self, channel: str) -> Array:
        """Of the samples, from the trial's begin [s]."""
        return self.experiment.measured[channel].time - self.experiment.start_time


def simulate_shown_trials(diagnosis: Diagnosis) -> list[SimulatedTrial]:
    """The trials that :attr:`Diagnosis.gap` is of, in the dataset's order; none where nothing was fitted."""
    base, final = diagnosis.base_fit, diagnosis.final_fit
    if base is None or final is None:
        return []
    shown = [e for e in diagnosis.experiments if e.use == diagnosis.evaluated_on and e.measured]
    bench = Simulator()
    try:
        before, after = bench.simulate(
            [fit.hypothesis.build_setups(fit.x, shown) for fit in (base, final)],
            shown,
        )
    finally:
        bench.close()
    return [SimulatedTrial(*one) for one in zip(shown, before, after, strict=True)]
