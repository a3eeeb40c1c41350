"""Controller with a learned policy: a bounded change of a profile at the estimated phase, or of a state machine."""

import copy
import hashlib
import math
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.controllers.feedback import SensorReadings
from klute_sim.controllers.policy import Policy, load_policy
from klute_sim.controllers.pressure import PressureProfile, load_default_profile
from klute_sim.controllers.state_machine import StateMachine, load_default_state_machine
from klute_sim.errors import InputError
from klute_sim.units import BAR

N_OBSERVATIONS = 8
"""Number of observations that the environments give to a policy."""
GAIT_ENVIRONMENT, WALK_ENVIRONMENT = "klute_sim/AnkleGait", "klute_sim/AnkleWalk"
"""Beginnings of the names of the environments of a prosthesis; in the second, the base may be of any kind."""
BASES: dict[str, Callable[[], PressureProfile | StateMachine]] = {
    "machine": load_default_state_machine,
    "profile": load_default_profile,
}
"""Base controllers that a policy file can name."""


class PolicyController:
    """Apply a ``policy`` that was trained with the action ``residual``.

    The observations have the delay of the training environment and no noise.
    """

    interval = 0.01
    """Time between commands [s], as in the environment."""

    def __init__(
        self,
        policy: Policy,
        base: PressureProfile | StateMachine,
        max_residual: float,
        delay_intervals: int = 0,
    ) -> None:
        """Change the pressure of ``base`` by at most ``max_residual`` [Pa].

        Sensors are late by ``delay_intervals`` intervals, and so is the phase, which is estimated from them. Raises
        InputError when the policy has other inputs or outputs than the environment.
        """
        if len(policy.observation_scale) != N_OBSERVATIONS or len(policy.layers[-1][1]) != 1:
            raise InputError(
                f"the policy has {len(policy.observation_scale)} inputs and {len(policy.layers[-1][1])} outputs; "
                f"allowed: {N_OBSERVATIONS} and 1, as in klute_sim/AnkleGait-v2"
            )
        self._policy, self._base = policy, copy.copy(base)
        self._max_residual, self._delay_intervals = max_residual, delay_intervals
        self._readings: deque[SensorReadings] = deque(maxlen=1 + delay_intervals)

    def reset(self) -> None:
        """Forget the delayed readings, and restart the base controller."""
        self._readings.clear()
        if isinstance(self._base, StateMachine):
            self._base.reset()

    def command(self, readings: SensorReadings) -> float:
        """Return the commanded gauge pressure [Pa] until the next call."""
        self._readings.append(readings)
        sensed = self._readings[0]
        angle = 2.0 * math.pi * sensed.phase
        observation = [*sensed[:5], sensed.pressure / BAR, math.sin(angle), math.cos(angle)]
        action = float(self._policy(observation)[0])
        if isinstance(self._base, StateMachine):
            pressure = self._base.command(sensed)
        else:
            pressure = self._base.pressure_at(sensed.phase)
        return max(0.0, pressure + self._max_residual * action)

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
            "base": self._base.describe(),
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
        name = str(policy.metadata.get("environment", GAIT_ENVIRONMENT))
        is_walk = name.startswith(WALK_ENVIRONMENT)
        base = str(environment.get("base", "machine")) if is_walk else "profile"
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise InputError(f"policy {source} does not state its training configuration; train it again") from None
    if not name.startswith((GAIT_ENVIRONMENT, WALK_ENVIRONMENT)):
        raise InputError(
            f"policy {source} was trained for {name} and controls no prosthesis; train one that does with: "
            "klute-sim train --env gait"
        )
    if not (0.0 <= residual_bar <= 20.0 and 0 <= delay_intervals <= 100):  # also rejects NaN
        raise InputError(
            f"policy {source} has residual_bar = {residual_bar:g} and sensor_delay = {delay_intervals}; "
            "allowed: 0 to 20 bar, 0 to 100 intervals"
        )
    if action != "residual":
        raise InputError(
            f"policy {source} has the action '{action}'; allowed: residual, a bounded change of a base controller"
        )
    if base not in BASES:
        raise InputError(f"policy {source} changes the base '{base}'; allowed: {', '.join(BASES)}")
    return PolicyController(policy, BASES[base](), residual_bar * BAR, delay_intervals)
