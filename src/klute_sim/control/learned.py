"""A learned policy on a prosthesis: it changes a base profile at the phase that is estimated, within bounds."""

import hashlib
import math
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.control.feedback import Sensed
from klute_sim.control.policy import Policy, load_policy
from klute_sim.control.pressure import Profile, tuned
from klute_sim.errors import InputError
from klute_sim.units import BAR

OBSERVED = 8
"""Numbers that ``klute_sim/AnkleGait-v1`` shows a policy."""


class Learned:
    """A ``policy`` that was trained in ``klute_sim/AnkleGait-v1`` with action ``residual``.

    It sees what the environment showed it, as late as there, from sensors without noise.
    """

    interval = 0.01
    """Between commands [s], as in the environment."""

    def __init__(self, policy: Policy, base: Profile, residual: float, late: int = 0) -> None:
        """Changes of at most ``residual`` [Pa] of ``base``; sensors are ``late`` by whole intervals.

        Raises InputError for a policy of something else.
        """
        if len(policy.scale) != OBSERVED or len(policy.layers[-1][1]) != 1:
            raise InputError(
                f"the policy has {len(policy.scale)} inputs and {len(policy.layers[-1][1])} outputs; allowed: "
                f"{OBSERVED} and 1, as in klute_sim/AnkleGait-v1"
            )
        self._policy, self._base, self._residual, self._late = policy, base, residual, late
        self._read: deque[list[float]] = deque(maxlen=1 + late)

    def begin(self) -> None:
        """See :class:`~klute_sim.control.feedback.FeedbackController`."""
        self._read.clear()

    def command(self, sensed: Sensed) -> float:
        """See :class:`~klute_sim.control.feedback.FeedbackController`."""
        self._read.append([*sensed[:5], sensed.pressure / BAR])
        turn = 2.0 * math.pi * sensed.phase
        action = float(self._policy([*self._read[0], math.sin(turn), math.cos(turn)])[0])
        return max(0.0, self._base.pressure(sensed.phase) + self._residual * action)

    def describe(self) -> dict[str, Any]:
        """See :class:`~klute_sim.control.feedback.FeedbackController`."""
        numbers = [self._policy.scale, *(array for layer in self._policy.layers for array in layer)]
        digest = hashlib.sha256(b"".join(np.ascontiguousarray(each).tobytes() for each in numbers)).hexdigest()
        return {
            "kind": "policy",
            "sha256": digest,
            "base": self._base.describe(),
            "residual_bar": self._residual / BAR,
            "late_intervals": self._late,
            "made": dict(self._policy.made),
        }


def load(path: str | Path) -> Learned:
    """The policy in a file that ``klute-sim train`` wrote, with the base and bounds it was trained with.

    Raises InputError if it is none, or acts on something else than a profile.
    """
    return learned(load_policy(path), str(path))


def learned(policy: Policy, where: str) -> Learned:
    """``policy`` with the base and bounds that it was trained with; ``where`` names it in errors."""
    try:
        environment = policy.made["config"]["environment"]
        action = environment.get("action", "pressure")
        residual, late = float(environment.get("residual_bar", 1.0)), int(environment.get("sensor_delay", 0))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise InputError(f"policy {where} does not say how it was trained") from None
    if not (0.0 <= residual <= 20.0 and 0 <= late <= 100):  # also refuses NaN
        raise InputError(f"policy {where} changes {residual:g} bar, {late} intervals late; allowed: 0 to 20, 0 to 100")
    if action != "residual":
        raise InputError(f"policy {where} commands '{action}'; allowed: residual, a bounded change of a profile")
    return Learned(policy, tuned(), residual * BAR, late)
