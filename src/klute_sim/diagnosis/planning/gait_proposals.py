"""Proposal of the recording in a gait laboratory that separates two models of a walk.

As on the bench (:mod:`~klute_sim.diagnosis.planning.proposals`), with recordings that change a recorded walk
(:mod:`~klute_sim.diagnosis.planning.gait_protocols`), and other instruments.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.experiments.gait import GaitExperiment
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.planning.gait_protocols import GaitProtocol, list_gait_protocols
from klute_sim.diagnosis.planning.proposals import (
    RigChange,
    build_separation_setups,
    choose_proposal,
    compute_separation,
    describe_inseparable_models,
    simulate_channels,
    weight_predictions,
)
from klute_sim.diagnosis.selection.forward_selection import BIC_THRESHOLD
from klute_sim.errors import SimulationError

ADDED_NOISE = {"force": 5.0, "pressure": 1e3, "muscle_length": 5e-5, "ankle_angle": np.radians(0.1)}
"""Noise of instruments that are not installed yet [SI] (assumed)."""
CHECKS = {
    "force": "with the load cell checked by a known weight before and after",
    "pressure": "with a second gauge at the muscle",
    "muscle_length": "with a second sensor of the muscle's length",
    "ankle_angle": "with a second encoder in the ankle's hinge",
}
"""Channel -> change of the rig that checks its instrument."""
ADDITIONS = {
    "force": "with a load cell in the tendon",
    "pressure": "with a gauge at the muscle",
    "muscle_length": "with a sensor for the muscle's own length",
    "ankle_angle": "with an encoder in the ankle's hinge",
}
"""Channel -> change of the rig that adds it."""


class GaitProposal(NamedTuple):
    """A recording that separates two models of a walk."""

    protocol: GaitProtocol
    """Recording."""
    rig_change: RigChange
    """Change of the instruments."""
    separation_chi2: float
    """Chi squared, in the independent samples of all repeats, by which the refitted models differ."""

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``verdict.json``."""
        if self.separation_chi2 <= BIC_THRESHOLD:
            return describe_inseparable_models(self.separation_chi2)
        sentence = (
            f"Record twice, {self.rig_change.description}: {self.protocol.instruction} "
            f"('{self.protocol.name}'). The models then differ by a chi squared of about "
            f"{self.separation_chi2:.0f} ({BIC_THRESHOLD:.0f} are decisive). Assumed: {self.protocol.assumption}."
        )
        return {
            "protocol": self.protocol.name,
            "instruction": self.protocol.instruction,
            "assumption": self.protocol.assumption,
            "rig_change": None if self.rig_change.is_none else self.rig_change.description,
            "separation_chi2": round(self.separation_chi2, 1),
            "sentence": sentence,
        }


def propose_gait_experiment(data: WeightedData, best_fit: Fit, alternative: Fit) -> GaitProposal | None:
    """Return the recording and change of the instruments that separate ``best_fit`` from ``alternative`` best.

    A recording whose simulation diverges is not proposed; None if all diverge.
    """
    walks = [e for e in data.experiments if isinstance(e, GaitExperiment)]
    walk = _use_one_clock(max(walks, key=lambda e: len(e.measured)), data)
    proposals = [
        proposal
        for protocol in list_gait_protocols()
        for proposal in _evaluate_protocol(data, walk, protocol, best_fit, alternative)
    ]
    return choose_proposal(proposals) if proposals else None


def list_rig_changes(measured: Collection[str]) -> list[RigChange]:
    """Return the changes of a set-up with the ``measured`` channels that may be proposed; the first is none."""
    changes = [RigChange("with the instruments as they are", ())]
    changes += [RigChange(text, (name,)) for name, text in CHECKS.items() if name in measured]
    changes += [RigChange(text, (), (name,)) for name, text in ADDITIONS.items() if name not in measured]
    return changes


def _use_one_clock(walk: GaitExperiment, data: WeightedData) -> GaitExperiment:
    """Return ``walk`` with the samples of its slowest channel in all channels, measured or added."""
    slowest = min(walk.measured.values(), key=lambda series: len(series.time))
    channels = dict.fromkeys([*data.noise, *ADDED_NOISE])
    samples = TimeSeries(slowest.time, slowest.time)
    # The size of the noise is that of the channel, and limits of sensors belong to what was measured.
    return replace(
        walk,
        measured=dict.fromkeys(channels, samples),
        noise_scale={},
        input_error_scale={},
        input_noise_share={},
        limits={},
    )


def _evaluate_protocol(
    data: WeightedData, walk: GaitExperiment, protocol: GaitProtocol, best_fit: Fit, alternative: Fit
) -> list[GaitProposal]:
    experiment = protocol.change(walk)
    sampling_interval = next(iter(experiment.measured.values())).sampling_interval
    setups = build_separation_setups(best_fit, alternative, experiment)
    try:
        observed, true_values = (
            simulate_channels(data.simulator, setups, experiment, with_sensor_errors=is_read)
            for is_read in (True, False)
        )
    except SimulationError:
        return []
    proposals = []
    for change in list_rig_changes(data.noise):
        predictions = weight_predictions(data, sampling_interval, change, observed, true_values, ADDED_NOISE)
        proposals.append(GaitProposal(protocol, change, compute_separation(best_fit, predictions)))
    return proposals
