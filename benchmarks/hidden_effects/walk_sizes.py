"""How large an effect is in walks: what it leaves when the device's uncertain numbers follow, over the noise.

As for the bench (:mod:`sizes`), but as the program's own replay has it: what is measured of a walk depends on how it is
walked, and that is not the effect. The replay decides only how much is hidden, never what the data are.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.hidden_effects.sizes import DIFFERENCE_SIGMAS, MAX_SIGMAS
from scipy.optimize import lsq_linear

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Simulator
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.effects import catalogue

Floats = np.ndarray


class GaitEffectSizer:
    """What sizes are measured by: walks without noise and without an effect."""

    def __init__(self, folder: Path, base: Mapping[str, float], noise: Mapping[str, float]) -> None:
        """``folder`` is their dataset; ``base`` are the device's true numbers, ``noise`` is in units of recordings."""
        dataset = load_dataset(folder)
        self._experiments, self._simulator = prepare_experiments(dataset, split_dataset(dataset)), Simulator(1)
        self._noise = {channel: noise[channel] * CHANNEL_UNITS[channel][1] for channel in self._experiments[0].measured}
        uncertain, deviations = tuple(dataset.uncertainties.items()), tuple(self._noise.items())
        self._hypothesis = Hypothesis(dataset.device, uncertain, deviations)
        self._base = np.array([u.normalize(base[u.key]) for u in self._hypothesis.parameters])
        self._reference = self._simulate_channels(self._hypothesis, self._base)
        moved = [
            self._simulate_channels(self._hypothesis, self._base + DIFFERENCE_SIGMAS * unit)
            for unit in np.eye(len(self._base))
        ]
        self._columns = np.stack([(each - self._reference).ravel() / DIFFERENCE_SIGMAS for each in moved], axis=1)

    def measure_size(self, effect: Mapping[str, Any]) -> float:
        """Of ``effect``, in the channel where it is most."""
        form = effect["form"] if not effect.get("channel") else catalogue.get_effects()[effect["name"]].forms[0].name
        hypothesis = self._hypothesis.with_term(EffectTerm(effect["name"], form, effect.get("channel")))
        own = zip(hypothesis.parameters[len(self._base) :], effect["parameters"].values(), strict=True)
        change = (
            self._simulate_channels(hypothesis, np.array([*self._base, *(u.normalize(value) for u, value in own)]))
            - self._reference
        )
        # To be off by a standard deviation costs as much as a sample that is off by its noise.
        count = len(self._base)
        columns = np.concatenate([self._columns, np.eye(count)])
        target = np.concatenate([change.ravel(), np.zeros(count)])
        bounds = (-MAX_SIGMAS - self._base, MAX_SIGMAS - self._base)
        left = change.ravel() - self._columns @ lsq_linear(columns, target, bounds).x
        return float(np.sqrt(np.mean(left.reshape(change.shape) ** 2, axis=1)).max())

    def close(self) -> None:
        """Let the threads go."""
        self._simulator.close()

    def _simulate_channels(self, hypothesis: Hypothesis, x: Floats) -> Floats:
        """(channels, samples) over the noise, every channel as often as the slowest."""
        (found,) = self._simulator.simulate([hypothesis.build_setups(x, self._experiments)], self._experiments)
        fewest = {channel: min(len(each[channel]) for each in found) for channel in self._noise}
        least = min(fewest.values())
        rows = []
        for channel, noise in self._noise.items():
            each = [one[channel] for one in found]
            rows.append(np.concatenate([v[np.linspace(0, len(v) - 1, least).astype(int)] for v in each]) / noise)
        return np.stack(rows)
