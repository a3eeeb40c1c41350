"""A learned policy on a prosthesis: it changes a base profile at the phase that is estimated, within bounds."""

import hashlib
import math
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.controllers.feedback import SensorReadings
from klute_sim.controllers.policy import Policy, load_policy
from klute_sim.controllers.pressure import PressureProfile, load_default_profile
from klute_sim.errors import InputError
from klute_sim.units import BAR

N_OBSERVATIONS = 8
"""Numbers that ``klute_sim/AnkleGait-v1`` shows a policy."""


class PolicyController:
    """A ``policy`` that was trained in ``klute_sim/AnkleGait-v1`` with action ``residual``.

    It sees what the environment showed it, as late as there, from sensors without noise.
    """

    interval = 0.01
    """Between commands [s], as in the environment."""

    def __init__(
        self, policy: Policy, base_profile: PressureProfile, max_residual: float, delay_intervals: int = 0
    ) -> None:
        """Changes of at most ``residual`` [Pa] of ``base``; sensors are ``late`` by whole intervals.

        Raises InputError for a policy of something else.
        """
        if len(policy.observation_scale) != N_OBSERVATIONS or len(policy.layers[-1][1]) != 1:
            raise InputError(
                f"the policy has {len(policy.observation_scale)} inputs and {len(policy.layers[-1][1])} outputs; allowed: "
                f"{N_OBSERVATIONS} and 1, as in klute_sim/AnkleGait-v1"
            )
        self._policy, self._base_profile, self._max_residual, self._delay_intervals = (
            policy,
            base_profile,
            max_residual,
            delay_intervals,
        )
        self._observations: deque[list[float]] = deque(maxlen=1 + delay_intervals)

    def reset(self) -> None:
        """See :class:`~klute_sim.controllers.feedback.FeedbackController`."""
        self._observations.clear()

    def command(self, readings: SensorReadings) -> float:
        """See :class:`~klute_sim.controllers.feedback.FeedbackController`."""
        self._observations.append([*readings[:5], readings.pressure / BAR])
        turn = 2.0 * math.pi * readings.phase
        action = float(self._policy([*self._observations[0], math.sin(turn), math.cos(turn)])[0])
        return max(0.0, self._base_profile.pressure_at(readings.phase) + self._max_residual * action)

    def describe(self) -> dict[str, Any]:
        """See :class:`~klute_sim.controllers.feedback.FeedbackController`."""
        numbers = [self._policy.observation_scale, *(array for layer in self._policy.layers for array in layer)]
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(each).tobytes() for each in numbers)).hexdigest()
        return {
            "kind": "policy",
            "sha256": digest,
            "base": self._base_profile.describe(),
            "residual_bar": self._max_residual / BAR,
            "late_intervals": self._delay_intervals,
            "made": dict(self._policy.metadata),
        }


def load_policy_controller(path: str | Path) -> PolicyController:
    """The policy in a file that ``klute-sim train`` wrote, with the base and bounds it was trained with.

    Raises InputError if it is none, or acts on something else than a profile.
    """
    return build_policy_controller(load_policy(path), str(path))


def build_policy_controller(policy: Policy, source: str) -> PolicyController:
    """``policy`` with the base and bounds that it was trained with; ``where`` names it in errors."""
    try:
        environment = policy.metadata["config"]["environment"]
        action = environment.get("action", "pressure")
        residual, late = float(environment.get("residual_bar", 1.0)), int(environment.get("sensor_delay", 0))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise InputError(f"policy {source} does not say how it was trained") from None
    if not (0.0 <= residual <= 20.0 and 0 <= late <= 100):  # also refuses NaN
        raise InputError(f"policy {source} changes {residual:g} bar, {late} intervals late; allowed: 0 to 20, 0 to 100")
    if action != "residual":
        raise InputError(f"policy {source} commands '{action}'; allowed: residual, a bounded change of a profile")
    return PolicyController(policy, load_default_profile(), residual * BAR, late)
