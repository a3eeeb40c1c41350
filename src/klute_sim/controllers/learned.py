"""Controller with a learned policy: a bounded change of a base profile at the estimated gait phase."""

import hashlib
import math
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.controllers.feedback import SensorReadings
from klute_sim.controllers.policy import Policy, load_policy
from klute_sim.controllers.pressure import PressureProfile, load_default_profile
from klute_sim.errors import InputError
from klute_sim.units import BAR

N_OBSERVATIONS = 8
"""Number of observations that ``klute_sim/AnkleGait-v2`` gives to a policy."""


class PolicyController:
    """Apply a ``policy`` that was trained in ``klute_sim/AnkleGait-v2`` with the action ``residual``.

    The observations have the delay of the training environment and no noise.
    """

    interval = 0.01
    """Time between commands [s], as in the environment."""

    def __init__(
        self, policy: Policy, base_profile: PressureProfile, max_residual: float, delay_intervals: int = 0
    ) -> None:
        """Change ``base_profile`` by at most ``max_residual`` [Pa]; sensors are late by ``delay_intervals`` intervals.

        Raises InputError when the policy has other inputs or outputs than the environment.
        """
        if len(policy.observation_scale) != N_OBSERVATIONS or len(policy.layers[-1][1]) != 1:
            raise InputError(
                f"the policy has {len(policy.observation_scale)} inputs and {len(policy.layers[-1][1])} outputs; "
                f"allowed: {N_OBSERVATIONS} and 1, as in klute_sim/AnkleGait-v2"
            )
        self._policy, self._base_profile = policy, base_profile
        self._max_residual, self._delay_intervals = max_residual, delay_intervals
        self._observations: deque[list[float]] = deque(maxlen=1 + delay_intervals)

    def reset(self) -> None:
        """Forget the delayed observations."""
        self._observations.clear()

    def command(self, readings: SensorReadings) -> float:
        """Return the commanded gauge pressure [Pa] until the next call."""
        self._observations.append([*readings[:5], readings.pressure / BAR])
        phase_angle = 2.0 * math.pi * readings.phase
        action = float(self._policy([*self._observations[0], math.sin(phase_angle), math.cos(phase_angle)])[0])
        return max(0.0, self._base_profile.pressure_at(readings.phase) + self._max_residual * action)

    @property
    def metadata(self) -> Mapping[str, Any]:
        """Training configuration, software versions and digest of the code in which the policy was trained."""
        return self._policy.metadata

    def describe(self) -> dict[str, Any]:
        """Return a description with a hash of the network (JSON types)."""
        arrays = [self._policy.observation_scale, *(array for layer in self._policy.layers for array in layer)]
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()
        return {
            "kind": "policy",
            "sha256": digest,
            "base": self._base_profile.describe(),
            "residual_bar": self._max_residual / BAR,
            "delay_intervals": self._delay_intervals,
            "metadata": dict(self._policy.metadata),
        }


def load_policy_controller(path: str | Path) -> PolicyController:
    """Return the controller of a policy file that ``klute-sim train`` wrote, with the bounds of its training.

    Raises InputError when the file is not a policy, or the policy does not command a change of a profile.
    """
    return build_policy_controller(load_policy(path), str(path))


def build_policy_controller(policy: Policy, source: str) -> PolicyController:
    """Return the controller of ``policy`` with the bounds of its training; ``source`` names the policy in errors."""
    try:
        environment = policy.metadata["config"]["environment"]
        action = environment.get("action", "pressure")
        residual_bar = float(environment.get("residual_bar", 1.0))
        delay_intervals = int(environment.get("sensor_delay", 0))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise InputError(f"policy {source} does not state its training configuration; train it again") from None
    if not (0.0 <= residual_bar <= 20.0 and 0 <= delay_intervals <= 100):  # also rejects NaN
        raise InputError(
            f"policy {source} has residual_bar = {residual_bar:g} and sensor_delay = {delay_intervals}; "
            "allowed: 0 to 20 bar, 0 to 100 intervals"
        )
    if action != "residual":
        raise InputError(f"policy {source} has the action '{action}'; allowed: residual, a bounded change of a profile")
    return PolicyController(policy, load_default_profile(), residual_bar * BAR, delay_intervals)
