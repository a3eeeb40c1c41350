"""Size of an effect in gait: its residual after refitting uncertain numbers, over the noise.

As on the bench (:mod:`sizes`), but by the replay of the package: gait measurements depend on the motion, which is not
part of the effect. The replay determines only the size of the hidden effect, never the data. An effect is scaled to a
size after a refit of the device; the registration of plate and markers takes a part of that, for some effects nearly
all, so the size that counts is measured after a refit of both.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.hidden_effects.sizes import DIFFERENCE_SIGMAS, MAX_SIGMAS
from scipy.optimize import lsq_linear

from klute_sim.datasets.dataset import load_dataset, split_dataset
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, Hypothesis
from klute_sim.effects import catalogue

Floats = np.ndarray


class GaitEffectSizer:
    """Measurement of effect sizes in gait without noise and without effects."""

    def __init__(self, folder: Path, base: Mapping[str, float], noise: Mapping[str, float]) -> None:
        """Set up the dataset ``folder`` with the true numbers ``base`` and the ``noise`` in units of recordings."""
        dataset = load_dataset(folder)
        self._experiments, self._simulator = prepare_experiments(dataset, split_dataset(dataset)), Simulator(1)
        self._noise = {channel: noise[channel] * CHANNEL_UNITS[channel][1] for channel in self._experiments[0].measured}
        uncertain, deviations = tuple(dataset.uncertainties.items()), tuple(self._noise.items())
        registration = tuple(self._experiments[0].registration_deviations.items())
        self._hypothesis = Hypothesis(dataset.device, uncertain, deviations, registration=registration)
        true_values = {**base, **{name: 0.0 for name, _ in registration}}
        self._base = np.array([u.normalize(true_values[u.name]) for u in self._hypothesis.parameters])
        self._reference = self._simulate_channels(self._hypothesis, self._base)
        self._n_device_numbers = len(uncertain)
        perturbed = [
            self._simulate_channels(self._hypothesis, self._base + DIFFERENCE_SIGMAS * unit)
            for unit in np.eye(len(self._base))
        ]
        self._columns = np.stack(
            [(channels - self._reference).ravel() / DIFFERENCE_SIGMAS for channels in perturbed], axis=1
        )

    def measure_size(self, effect: Mapping[str, Any], *, with_registration: bool = False) -> float:
        """Return the size of ``effect`` in the channel with the largest value.

        ``with_registration`` refits the numbers of the registration, too.
        """
        form = effect["form"] if not effect.get("channel") else catalogue.get_effects()[effect["name"]].forms[0].name
        hypothesis = self._hypothesis.with_term(EffectTerm(effect["name"], form, effect.get("channel")))
        added_parameters = zip(hypothesis.parameters[len(self._base) :], effect["parameters"].values(), strict=True)
        change = (
            self._simulate_channels(
                hypothesis, np.array([*self._base, *(u.normalize(value) for u, value in added_parameters)])
            )
            - self._reference
        )
        # A deviation of one standard deviation costs as much as a sample deviating by its noise.
        count = len(self._base) if with_registration else self._n_device_numbers
        base, influences = self._base[:count], self._columns[:, :count]
        columns = np.concatenate([influences, np.eye(count)])
        target = np.concatenate([change.ravel(), np.zeros(count)])
        residual = change.ravel() - influences @ lsq_linear(columns, target, (-MAX_SIGMAS - base, MAX_SIGMAS - base)).x
        return float(np.sqrt(np.mean(residual.reshape(change.shape) ** 2, axis=1)).max())

    def close(self) -> None:
        """Stop the threads."""
        self._simulator.close()

    def _simulate_channels(self, hypothesis: Hypothesis, x: Floats) -> Floats:
        """Return the channels over their noise (channels, samples), each sampled like the slowest."""
        (results,) = self._simulator.simulate([hypothesis.build_setups(x, self._experiments)], self._experiments)
        sample_counts = {channel: min(len(values[channel]) for values in results) for channel in self._noise}
        n_samples = min(sample_counts.values())
        rows = []
        for channel, noise in self._noise.items():
            values = [result[channel] for result in results]
            rows.append(np.concatenate([v[np.linspace(0, len(v) - 1, n_samples).astype(int)] for v in values]) / noise)
        return np.stack(rows)
