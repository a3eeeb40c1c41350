"""Size of an effect of a joint: what it leaves after a linear refit of the uncertain numbers, over the noise.

As on the bench (:mod:`sizes`), with the laws of the benchmark, and with one refit in linear approximation.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from benchmarks.hidden_effects.catalogue import EFFECTS, JOINT_CHANNELS
from benchmarks.hidden_effects.joints import UNCERTAINTIES, Effects, Floats, build_joint, list_forms, simulate_channels
from benchmarks.hidden_effects.sizes import DECIMATION_FACTOR, DIFFERENCE_SIGMAS, MAX_SIGMAS, scale_to_target
from scipy.optimize import lsq_linear

STEPS = 1
"""Integrator steps per trace sample; a size needs no more."""


class JointEffectSizer:
    """Measurement of effect sizes for a joint and its commands."""

    def __init__(self, base: Mapping[str, float], nominal: Mapping[str, float], commands: Sequence[Floats]) -> None:
        """Set up the joint with the true numbers ``base`` and the believed numbers ``nominal``."""
        self._base, self._commands = dict(base), commands
        sigma = {key: share * nominal[key] for key, share in UNCERTAINTIES.items()}
        self._deviation = np.array([(base[key] - nominal[key]) / sigma[key] for key in UNCERTAINTIES])
        self._reference = self._simulate(self._base, (), ())
        columns = []
        for key, deviation in sigma.items():
            moved = {**self._base, key: self._base[key] + DIFFERENCE_SIGMAS * deviation}
            columns.append((self._simulate(moved, (), ()) - self._reference).ravel() / DIFFERENCE_SIGMAS)
        # A deviation of one standard deviation costs as much as a sample deviating by its noise.
        self._columns = np.concatenate([np.stack(columns, axis=1), np.eye(len(columns))])

    def measure_size(self, effects: Effects, faults: Effects) -> float:
        """Return the size of ``effects`` and ``faults`` together, in the channel where it is largest."""
        change = self._simulate(self._base, effects, faults) - self._reference
        count = len(UNCERTAINTIES)
        bounds = (-MAX_SIGMAS - self._deviation, MAX_SIGMAS - self._deviation)
        target = np.concatenate([change.ravel(), np.zeros(count)])
        residual = change.ravel() - self._columns[: change.size] @ lsq_linear(self._columns, target, bounds).x
        return float(np.sqrt(np.mean(residual.reshape(change.shape) ** 2, axis=1)).max())

    def scale_effect(self, effect: Mapping[str, Any]) -> dict[str, Any]:
        """Return ``effect`` scaled to its required size, with the reached size."""

        def measure(scaled: Mapping[str, Any]) -> float:
            return self.measure_size(*(((), [scaled]) if "channel" in scaled else ([scaled], ())))

        return scale_to_target(effect, list_forms(effect, EFFECTS), measure)

    def _simulate(self, numbers: Mapping[str, float], effects: Effects, faults: Effects) -> Floats:
        """Return the channels over their noise (channels, samples)."""
        joint = build_joint(numbers, effects)
        trials = [simulate_channels(joint, commands, 0.0, faults, steps=STEPS) for commands in self._commands]
        rows = [
            np.concatenate([channels[name][::DECIMATION_FACTOR] for channels in trials]) / channel.noise
            for name, channel in JOINT_CHANNELS.items()
        ]
        return np.stack(rows)
