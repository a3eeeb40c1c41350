"""A passive foot in place of the device: what most people with a below-knee prosthesis wear today."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from klute_sim.device.dynamics import DeviceParameters
from klute_sim.errors import InputError

NEVER_TAUT_SLACK_LENGTH = 10.0
"""Slack [m] that keeps the device's tendon from ever pulling."""


@dataclass(frozen=True, kw_only=True)
class SpringFoot:
    """A rotational spring about the ankle; InputError for one that no foot has.

    Feet that people wear are taken to have 3 to 15 N.m/deg (assumed). The same spring in both directions and no toe
    joint are assumed, too, and the damping is the prosthesis' own.
    """

    stiffness: float
    """[N.m/rad]"""
    rest_angle: float = 0.0
    """Dorsiflexion at which it is slack [rad]."""

    def __post_init__(self) -> None:
        """See the class."""
        per_degree = math.radians(self.stiffness)
        if not 0.5 <= per_degree <= 40.0:
            raise InputError(f"stiffness of the spring foot is {per_degree:g}; allowed: 0.5 to 40 N.m/deg")
        if not abs(self.rest_angle) <= math.radians(15.0):
            raise InputError(
                f"rest angle of the spring foot is {math.degrees(self.rest_angle):g}; allowed: -15 to 15 degrees"
            )

    def apply_to_joint(self, joint: mujoco.MjsJoint) -> None:
        """Put the spring into the ankle ``joint``, whose positive direction is plantarflexion."""
        joint.stiffness, joint.springref = (
            np.array([self.stiffness, 0.0, 0.0]),
            -self.rest_angle,
        )  # a polynomial's terms


def disable_tendon(parameters: DeviceParameters) -> DeviceParameters:
    """A device that is not on the ankle: its tendon never comes taut."""
    return parameters._replace(tendon=parameters.tendon._replace(slack_length=NEVER_TAUT_SLACK_LENGTH))
