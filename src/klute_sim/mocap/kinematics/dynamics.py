"""Net ankle moment by inverse dynamics of the foot in the sagittal plane.

The foot is a rigid body with the mass, centre of mass and inertia of Winter's table (Biomechanics and Motor Control of
Human Movement, Table 4.1): 0.0145 of the body mass, half-way from the ankle to the head of the second metatarsal, and a
radius of gyration about that centre of 0.475 of this distance.
"""

import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.mocap.kinematics.from_markers import LegLandmarks
from klute_sim.types import Array

FOOT_MASS_FRACTION = 0.0145
"""Mass of the foot over body mass [1]."""
FOOT_CENTRE_FRACTION = 0.5
"""Distance of the foot's centre of mass from the ankle over foot length [1]."""
GYRATION_RADIUS_FRACTION = 0.475
"""Radius of gyration of the foot over foot length [1]."""


def compute_ankle_moment(
    landmarks: LegLandmarks, grf_forward: Array, grf_vertical: Array, cop: Array, body_mass: float
) -> Array:
    """Return the net ankle moment (n,) [N.m], plantarflexor positive.

    ``grf_forward`` and ``grf_vertical`` (n,) are the ground reaction [N] at ``landmarks.time``; ``cop`` (n, 2) is its
    point of application, forward and up [m], with arbitrary values where there is no load. ``body_mass`` is in [kg].
    """
    time, ankle, toe = landmarks.time, landmarks.ankle[:, :2], landmarks.toe[:, :2]
    foot_vector = toe - ankle
    centre = ankle + FOOT_CENTRE_FRACTION * foot_vector
    acceleration = _differentiate(_differentiate(centre, time), time)
    angular_acceleration = _differentiate(_differentiate(np.radians(landmarks.foot_pitch), time), time)
    foot_mass = FOOT_MASS_FRACTION * body_mass
    inertia = foot_mass * (GYRATION_RADIUS_FRACTION * float(np.nanmean(np.hypot(*foot_vector.T)))) ** 2
    arm = np.where((grf_vertical != 0.0)[:, None], cop - ankle, 0.0)
    ground = arm[:, 0] * grf_vertical - arm[:, 1] * grf_forward
    offset = centre - ankle
    weight = offset[:, 0] * foot_mass * GRAVITY
    # Toe-down rotation is positive: a force (x, z) at (a, b) has the moment b x - a z.
    inertial = inertia * angular_acceleration + foot_mass * (
        offset[:, 1] * acceleration[:, 0] - offset[:, 0] * acceleration[:, 1]
    )
    return np.asarray(ground - weight + inertial, dtype=np.float64)


def _differentiate(values: Array, time: Array) -> Array:
    return np.asarray(np.gradient(values, time, axis=0), dtype=np.float64)
