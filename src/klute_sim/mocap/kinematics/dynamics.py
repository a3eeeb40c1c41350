"""The ankle's net moment, by inverse dynamics of the foot in the sagittal plane.

The foot is a rigid body with the mass, centre and inertia of Winter's table (Biomechanics and Motor Control of Human
Movement, Table 4.1): 0.0145 of the body's mass, half-way from the ankle to the head of the second metatarsal, and a
radius of gyration about that centre of 0.475 of this distance.
"""

import numpy as np

from klute_sim.gait.reference import GRAVITY
from klute_sim.mocap.kinematics.from_markers import LegLandmarks
from klute_sim.recording.recording import Array

FOOT_MASS_FRACTION = 0.0145
FOOT_CENTRE_FRACTION = 0.5
GYRATION_RADIUS_FRACTION = 0.475


def compute_ankle_moment(
    landmarks: LegLandmarks, grf_forward: Array, grf_vertical: Array, cop: Array, body_mass: float
) -> Array:
    """Net ankle moment [N.m], plantarflexor positive.

    ``forward`` and ``vertical`` are the ground reaction [N] at ``leg.time``, ``point`` (n, 2) where it acts: forward
    and up [m] (anything where there is no reaction). ``mass`` is the body's [kg].
    """
    time, ankle, toe = landmarks.time, landmarks.ankle[:, :2], landmarks.toe[:, :2]
    reach = toe - ankle
    centre = ankle + FOOT_CENTRE_FRACTION * reach
    acceleration = _differentiate(_differentiate(centre, time), time)
    turning = _differentiate(_differentiate(np.radians(landmarks.foot_pitch), time), time)
    foot = FOOT_MASS_FRACTION * body_mass
    inertia = foot * (GYRATION_RADIUS_FRACTION * float(np.nanmean(np.hypot(*reach.T)))) ** 2
    arm = np.where((grf_vertical != 0.0)[:, None], cop - ankle, 0.0)
    ground = arm[:, 0] * grf_vertical - arm[:, 1] * grf_forward
    at = centre - ankle
    weight = at[:, 0] * foot * GRAVITY
    # Turning of the toe downwards is positive: that of a force (x, z) at (a, b) is b x - a z.
    inertial = inertia * turning + foot * (at[:, 1] * acceleration[:, 0] - at[:, 0] * acceleration[:, 1])
    return np.asarray(ground - weight + inertial, dtype=np.float64)


def _differentiate(values: Array, time: Array) -> Array:
    return np.asarray(np.gradient(values, time, axis=0), dtype=np.float64)
