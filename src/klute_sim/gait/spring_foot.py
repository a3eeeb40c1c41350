"""A passive prosthetic foot that replaces the device: the kind that most people with a below-knee amputation use."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from klute_sim.device.dynamics import DeviceParameters
from klute_sim.errors import InputError

SPRING_FOOT_ASSUMPTIONS = {
    "spring foot": "assumed: linear, with the same stiffness in both directions and without a toe joint",
    "prosthesis": "assumed: masses, inertias, joint damping, end stops (models/ankle.xml)",
}
"""Assumptions of a gait run with a spring foot."""
NEVER_TAUT_SLACK_LENGTH = 10.0
"""Slack length [m] at which the tendon of the device never becomes taut."""


@dataclass(frozen=True, kw_only=True)
class SpringFoot:
    """A rotational spring about the ankle.

    Prosthetic feet are assumed to have a stiffness of 3 to 15 N.m/deg, the same in both directions, and no toe joint.
    The damping is that of the prosthesis.
    """

    stiffness: float
    """Rotational stiffness [N.m/rad]."""
    rest_angle: float = 0.0
    """Dorsiflexion at which the spring is slack [rad]."""

    def __post_init__(self) -> None:
        """Raise InputError when the stiffness or the rest angle is out of range."""
        per_degree = math.radians(self.stiffness)
        if not 0.5 <= per_degree <= 40.0:
            raise InputError(f"stiffness of the spring foot is {per_degree:g}; allowed: 0.5 to 40 N.m/deg")
        if not abs(self.rest_angle) <= math.radians(15.0):
            raise InputError(
                f"rest angle of the spring foot is {math.degrees(self.rest_angle):g}; allowed: -15 to 15 degrees"
            )

    @property
    def name(self) -> str:
        """Name of the foot in titles and recordings, with its stiffness [N.m/deg]."""
        return f"spring foot, {math.radians(self.stiffness):g} N·m/deg"

    def apply_to_joint(self, joint: mujoco.MjsJoint) -> None:
        """Set the spring of the ankle ``joint``, whose positive direction is plantarflexion."""
        joint.stiffness = np.array([self.stiffness, 0.0, 0.0])  # coefficients of a polynomial
        joint.springref = -self.rest_angle


def disable_tendon(parameters: DeviceParameters) -> DeviceParameters:
    """Return a device whose tendon never becomes taut."""
    return parameters._replace(tendon=parameters.tendon._replace(slack_length=NEVER_TAUT_SLACK_LENGTH))
