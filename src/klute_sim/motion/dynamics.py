"""The ankle's net moment, by inverse dynamics of the foot in the sagittal plane.

The foot is a rigid body with the mass, centre and inertia of Winter's table (Biomechanics and Motor Control of Human
Movement, Table 4.1): 0.0145 of the body's mass, half-way from the ankle to the head of the second metatarsal, and a
radius of gyration about that centre of 0.475 of this distance.
"""

import numpy as np

from klute_sim.motion.sagittal import Leg
from klute_sim.recording.recording import Samples
from klute_sim.rigs.gait.reference import GRAVITY

FOOT_MASS = 0.0145
CENTRE = 0.5
GYRATION = 0.475


def ankle_moment(leg: Leg, forward: Samples, vertical: Samples, point: Samples, mass: float) -> Samples:
    """Net ankle moment [N.m], plantarflexor positive.

    ``forward`` and ``vertical`` are the ground reaction [N] at ``leg.time``, ``point`` (n, 2) where it acts: forward
    and up [m] (anything where there is no reaction). ``mass`` is the body's [kg].
    """
    time, ankle, toe = leg.time, leg.ankle[:, :2], leg.toe[:, :2]
    reach = toe - ankle
    centre = ankle + CENTRE * reach
    acceleration = _rate(_rate(centre, time), time)
    turning = _rate(_rate(np.radians(leg.foot_pitch), time), time)
    foot = FOOT_MASS * mass
    inertia = foot * (GYRATION * float(np.nanmean(np.hypot(*reach.T)))) ** 2
    arm = np.where((vertical != 0.0)[:, None], point - ankle, 0.0)
    ground = arm[:, 0] * vertical - arm[:, 1] * forward
    at = centre - ankle
    weight = at[:, 0] * foot * GRAVITY
    # Turning of the toe downwards is positive: that of a force (x, z) at (a, b) is b x - a z.
    inertial = inertia * turning + foot * (at[:, 1] * acceleration[:, 0] - at[:, 0] * acceleration[:, 1])
    return np.asarray(ground - weight + inertial, dtype=np.float64)


def _rate(values: Samples, time: Samples) -> Samples:
    return np.asarray(np.gradient(values, time, axis=0), dtype=np.float64)
