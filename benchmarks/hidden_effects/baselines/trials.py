"""Trials of a dataset by their use, and the gap on the test trials."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from klute_sim.datasets.dataset import Dataset, load_dataset, split_dataset
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.noise.repeats import Residuals, estimate_noise_from_repeats
from klute_sim.types import Array

Verdict = dict[str, Any]


class Trials(NamedTuple):
    """A dataset with its trials, ready to be simulated."""

    dataset: Dataset
    experiments: Sequence[Experiment]

    def with_use(self, use: str) -> list[Experiment]:
        """Return the trials with ``use``: ``fit``, ``validation`` or ``test``."""
        return [experiment for experiment in self.experiments if experiment.use == use]


def load_trials(folder: Path) -> Trials:
    """Return the trials of the dataset in ``folder``; raises InputError for data that cannot be read."""
    dataset = load_dataset(folder)
    return Trials(dataset, prepare_experiments(dataset, split_dataset(dataset)))


def compute_rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values * values)))


def join_channels(residuals: Residuals) -> dict[str, Array]:
    """Return the residuals [SI] of all trials by channel."""
    channels = dict.fromkeys(channel for residual in residuals for channel in residual)
    return {
        channel: np.concatenate([residual[channel] for residual in residuals if channel in residual])
        for channel in channels
    }


def compute_gap(test_experiments: Sequence[Experiment], before: Residuals, after: Residuals) -> dict[str, Any]:
    """Return the gap as in ``verdict.json`` from the residuals of the test trials, for channels with repeats."""
    old, new = join_channels(before), join_channels(after)
    gap = {}
    for channel, noise in estimate_noise_from_repeats(test_experiments, after).items():
        unit, factor = CHANNEL_UNITS[channel]
        gap[channel] = {
            "unit": unit,
            "refitted": compute_rms(old[channel]) / factor,
            "with_effects": compute_rms(new[channel]) / factor,
            "noise_floor": noise.std / factor,
        }
    return gap
