"""How large an effect is in walks: what it leaves when the device's uncertain numbers follow, over the noise.

As for the bench (:mod:`sizes`), but as the program's own replay has it: what is measured of a walk depends on how it is
walked, and that is not the effect. The replay decides only how much is hidden, never what the data are.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear
from sizes import DIFFERENCE, FARTHEST

from klute_sim.dataset.dataset import read, split
from klute_sim.diagnose.experiment import UNITS, Bench
from klute_sim.diagnose.hypothesis import Hypothesis, Term
from klute_sim.diagnose.prepare import prepare
from klute_sim.effects import catalogue

Floats = np.ndarray


class WalkScale:
    """What sizes are measured by: walks without noise and without an effect."""

    def __init__(self, folder: Path, base: Mapping[str, float], noise: Mapping[str, float]) -> None:
        """``folder`` is their dataset; ``base`` are the device's true numbers, ``noise`` is in units of recordings."""
        dataset = read(folder)
        self._experiments, self._bench = prepare(dataset, split(dataset)), Bench(1)
        self._noise = {channel: noise[channel] * UNITS[channel][1] for channel in self._experiments[0].measured}
        uncertain, deviations = tuple(dataset.uncertain.items()), tuple(self._noise.items())
        self._plain = Hypothesis(dataset.device, uncertain, deviations)
        self._base = np.array([u.steps(base[u.key]) for u in self._plain.unknowns])
        self._without = self._shown(self._plain, self._base)
        moved = [self._shown(self._plain, self._base + DIFFERENCE * unit) for unit in np.eye(len(self._base))]
        self._columns = np.stack([(each - self._without).ravel() / DIFFERENCE for each in moved], axis=1)

    def size(self, effect: Mapping[str, Any]) -> float:
        """Of ``effect``, in the channel where it is most."""
        form = effect["form"] if not effect.get("channel") else catalogue.effects()[effect["name"]].forms[0].name
        hypothesis = self._plain.plus(Term(effect["name"], form, effect.get("channel")))
        own = zip(hypothesis.unknowns[len(self._base) :], effect["parameters"].values(), strict=True)
        change = self._shown(hypothesis, np.array([*self._base, *(u.steps(value) for u, value in own)])) - self._without
        # To be off by a standard deviation costs as much as a sample that is off by its noise.
        count = len(self._base)
        columns = np.concatenate([self._columns, np.eye(count)])
        target = np.concatenate([change.ravel(), np.zeros(count)])
        bounds = (-FARTHEST - self._base, FARTHEST - self._base)
        left = change.ravel() - self._columns @ lsq_linear(columns, target, bounds).x
        return float(np.sqrt(np.mean(left.reshape(change.shape) ** 2, axis=1)).max())

    def close(self) -> None:
        """Let the threads go."""
        self._bench.close()

    def _shown(self, hypothesis: Hypothesis, steps: Floats) -> Floats:
        """(channels, samples) over the noise, every channel as often as the slowest."""
        (found,) = self._bench.simulate([hypothesis.settings(steps, self._experiments)], self._experiments)
        fewest = {channel: min(len(each[channel]) for each in found) for channel in self._noise}
        least = min(fewest.values())
        rows = []
        for channel, noise in self._noise.items():
            each = [one[channel] for one in found]
            rows.append(np.concatenate([v[np.linspace(0, len(v) - 1, least).astype(int)] for v in each]) / noise)
        return np.stack(rows)
