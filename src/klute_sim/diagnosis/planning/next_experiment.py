"""The experiment that separates an ``indistinguishable`` model from its best rival, on the rig of the dataset."""

from collections.abc import Sequence
from typing import Any

from klute_sim.datasets.dataset import Dataset
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.planning.gait_proposals import GaitProposal, propose_gait_experiment
from klute_sim.diagnosis.planning.joint_proposals import propose_joint_experiment
from klute_sim.diagnosis.planning.proposals import ExperimentProposal, propose_experiment
from klute_sim.diagnosis.selection.robustness import EquivalentModel


def propose_next_experiment(
    data: WeightedData, dataset: Dataset, final_fit: Fit, equivalent_models: Sequence[EquivalentModel]
) -> dict[str, Any] | None:
    """Return the entry of ``verdict.json`` for ``final_fit`` and its best rival.

    None where no experiment that separates them can be simulated.

    A model with some of the names of ``final_fit`` that does not reach the noise stands for an error of a law
    (:mod:`klute_sim.diagnosis.selection.law_error`), which no simulation predicts.
    """
    rivals = [
        model.fit
        for model in equivalent_models
        if model.reaches_noise or not model.fit.identities < final_fit.identities
    ]
    if not rivals:
        return None
    proposal: ExperimentProposal | GaitProposal | None
    if dataset.rig == "bench":
        proposal = propose_experiment(data, dataset.device, final_fit, rivals[0])
    elif dataset.rig == "gait":
        proposal = propose_gait_experiment(data, final_fit, rivals[0])
    else:
        proposal = propose_joint_experiment(data, dataset, final_fit, rivals[0])
    return None if proposal is None else proposal.to_dict()
