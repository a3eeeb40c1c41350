"""Baseline of ``klute_sim/AntagonistJoint``: a PID controller of the angle that acts on the pressure difference."""

import numpy as np
from numpy.typing import NDArray

from klute_sim.envs.base.task import CONTROL_INTERVAL
from klute_sim.errors import InputError

DEFAULT_GAINS = {"proportional": 4.0, "integral": 25.0, "derivative": 0.1, "mean": 0.0}
"""Default gains per rad, per rad s and per rad/s of error, and mean action.

Assumed: tuned by hand for two klute-3-4-pair on the default joint.
"""
MAX_GAIN = 1e4
"""Largest gain."""


class PidController:
    """PID control of the angle by the difference of two actions around a mean (co-contraction).

    The flexor gets the mean plus the control, the extensor the mean minus it. The integral stops while the control is
    at its limit (conditional integration). The derivative acts on the error of the rates, which the observation holds.
    """

    def __init__(
        self,
        proportional: float = DEFAULT_GAINS["proportional"],
        integral: float = DEFAULT_GAINS["integral"],
        derivative: float = DEFAULT_GAINS["derivative"],
        mean: float = DEFAULT_GAINS["mean"],
    ) -> None:
        """Set gains per rad, per rad s and per rad/s of error, and the ``mean`` action (between -1 and 1).

        Raises InputError when a number is out of range.
        """
        for name, gain in (("proportional", proportional), ("integral", integral), ("derivative", derivative)):
            if not 0.0 <= gain <= MAX_GAIN:
                raise InputError(f"the gain {name} is {gain:g}; allowed: 0 to {MAX_GAIN:g}")
        if not -1.0 < mean < 1.0:
            raise InputError(f"the mean action is {mean:g}; allowed: above -1, below 1")
        self.proportional, self.integral, self.derivative, self.mean = proportional, integral, derivative, mean
        self._sum: NDArray[np.float64] = np.zeros(())

    def reset(self) -> None:
        """Forget the past; call it at the start of an episode."""
        self._sum = np.zeros(())

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the actions (2,) for an ``observation`` (6,), or (n, 2) for (n, 6)."""
        values = np.asarray(observation, dtype=np.float64)
        error, error_rate = values[..., 2] - values[..., 0], values[..., 3] - values[..., 1]
        total = self._sum + CONTROL_INTERVAL * error
        control = self.proportional * error + self.integral * total + self.derivative * error_rate
        limit = 1.0 - abs(self.mean)
        self._sum = np.where(np.abs(control) < limit, total, self._sum)
        control = np.clip(control, -limit, limit)
        return np.stack([self.mean + control, self.mean - control], axis=-1).astype(np.float32)
