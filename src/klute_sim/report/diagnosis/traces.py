"""Simulations of the trials that a diagnosis shows, before and after effects are added."""

from collections.abc import Mapping
from typing import NamedTuple

from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.types import Array


class SimulatedTrial(NamedTuple):
    """A trial and the simulated readings of its instruments [SI] at its sample times."""

    experiment: Experiment
    before: Mapping[str, Array]
    """Channel -> readings with the refitted device and no added effect."""
    after: Mapping[str, Array]
    """Channel -> readings with the added effects; equal to :attr:`before` if there are none."""

    def get_sample_times(self, channel: str) -> Array:
        """Return the sample times of ``channel`` from the start of the trial [s]."""
        return self.experiment.measured[channel].time - self.experiment.start_time


def simulate_shown_trials(diagnosis: Diagnosis) -> list[SimulatedTrial]:
    """Simulate the trials of :attr:`Diagnosis.channel_rms`, in the order of the dataset; none if nothing was fitted."""
    base, final = diagnosis.base_fit, diagnosis.final_fit
    if base is None or final is None:
        return []
    shown = diagnosis.evaluated_experiments
    simulator = Simulator()
    try:
        before, after = simulator.simulate(
            [fit.hypothesis.build_setups(fit.x, shown) for fit in (base, final)],
            shown,
        )
    finally:
        simulator.close()
    return [SimulatedTrial(*traces) for traces in zip(shown, before, after, strict=True)]
