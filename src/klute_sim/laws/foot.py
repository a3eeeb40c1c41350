"""A prosthetic foot that turns about an ankle whose own motion is prescribed, in the sagittal plane.

Newton-Euler about the moving ankle axis, with ``q`` the ankle angle (plantarflexion positive, a rotation about +y,
which lowers the toe), ``t`` the shank's lean (forward positive, about +y as well), ``c`` the foot's centre of mass seen
from the ankle and ``a`` the ankle's acceleration::

    I (t'' + q'') = T r(q) - k (q - q0) - b q' + k_b max(0, -q - q_b) + M_friction + M_stop + M_ground + M_weight
    M_weight = m (c_x (g + a_z) - c_z a_x)         c turned by t + q

with ``T r`` the device's tension times its arm. The base is prescribed, so its acceleration is an input and nothing
acts back on it. Beyond the hinge the foot may bend (:func:`bend`): it is light, so it turns by what the moment asks
for, and the hinge does not notice.

Springs, masses and sites are the MJCF's; stop and step are MuJoCo's own formulas (documentation, "Computation", solver
parameters; the integrator *implicitfast*), for the one coordinate that is free.
"""

import math
from typing import NamedTuple

GRAVITY = 9.81
"""[m/s2], as in the models."""


class Foot(NamedTuple):
    """A foot on its ankle; SI, positions from the ankle axis, x forward and z up."""

    inertia: float
    """About the ankle axis [kg m2]."""
    mass: float
    com_x: float
    com_z: float
    """Centre of mass, in the foot."""
    origin_x: float
    origin_z: float
    """Where the tendon begins, in the pylon."""
    insertion_x: float
    insertion_z: float
    """Where it ends, in the foot."""
    spring_stiffness: float
    """Of the return spring [N.m/rad]."""
    spring_rest_angle: float
    """Ankle angle at which that is slack [rad]."""
    ankle_damping: float
    """[N.m.s/rad]"""
    ankle_friction: float
    """Coulomb's, of the ankle [N.m]."""
    min_angle: float
    max_angle: float
    """Ankle angles at which the end stops begin [rad]."""
    bumper_stiffness: float
    """Stiffness of a bumper [N.m/rad]."""
    bumper_onset_angle: float
    """Dorsiflexion from which it acts [rad]."""
    stop_time_constant: float
    """Time constant of a stop [s], critically damped."""
    stop_min_impedance: float
    stop_max_impedance: float
    stop_width: float
    """Impedance of a stop where it begins, and beyond that width [rad]: MuJoCo's solimp."""
    keel_compliance: float
    """Compliance of the foot between hinge and sole [rad/(N.m)]; 0: rigid."""
    keel_time_constant: float
    """Time constant with which it bends [s]."""
    keel_friction_angle: float
    """How far friction in it holds it back [rad]."""
    socket_compliance: float
    """Compliance of the socket along the pylon [m/N]."""
    distal_mass: float
    """Mass of all below the socket [kg]."""


class FootInputs(NamedTuple):
    """What is prescribed at an instant."""

    shank_angle: float
    """Lean of the shank [rad]."""
    shank_angular_acceleration: float
    """Its second derivative [rad/s2]."""
    ankle_acceleration_x: float
    ankle_acceleration_z: float
    """Acceleration of the ankle [m/s2]."""
    ground_moment: float
    """Moment of the ground reaction about the ankle [N.m], plantarflexing positive."""


class AnkleStep(NamedTuple):
    """The ankle after a step."""

    angle: float
    rate: float
    moment: float
    """Of tendon, spring, damping, friction and stops about the ankle during the step [N.m], plantarflexor positive."""


def unit_length(foot: Foot, angle: float) -> float:
    """Length of the muscle-tendon unit [m]: the straight line between its two sites."""
    x, z = _insertion_position(foot, angle)
    return math.sqrt((foot.origin_x - x) * (foot.origin_x - x) + (foot.origin_z - z) * (foot.origin_z - z))


def moment_arm(foot: Foot, angle: float) -> float:
    """``-d(unit_length)/d(angle)`` [m]: what a tension is multiplied by to give a plantarflexing moment."""
    x, z = _insertion_position(foot, angle)
    return ((foot.origin_x - x) * z - (foot.origin_z - z) * x) / unit_length(foot, angle)


def _insertion_position(foot: Foot, angle: float) -> tuple[float, float]:
    """In the pylon."""
    cosine, sine = math.cos(angle), math.sin(angle)
    x = foot.insertion_x * cosine + foot.insertion_z * sine
    return x, foot.insertion_z * cosine - foot.insertion_x * sine


def step_keel_angle(foot: Foot, keel_angle: float, moment: float, dt: float) -> float:
    """By how much the foot is bent [rad], dorsiflexion positive, a ``step`` [s] after it was by ``before``.

    The ``moment`` [N.m], plantarflexor positive, is what crosses the hinge. A spring with a dashpot and Coulomb
    friction beside it (backward Euler): friction takes off as much as it can of the way to where the spring would be.
    """
    if foot.keel_compliance == 0.0:
        return 0.0
    way = foot.keel_compliance * moment - keel_angle
    return keel_angle + (way - min(max(way, -foot.keel_friction_angle), foot.keel_friction_angle)) / (
        1.0 + foot.keel_time_constant / dt
    )


def socket_displacement(foot: Foot, inputs: FootInputs, axial_force: float) -> float:
    """How far the limb sinks into its socket [m] under a ground reaction ``along`` the pylon [N].

    What the socket gets is that less the weight and the acceleration of all below it.
    """
    up = (GRAVITY + inputs.ankle_acceleration_z) * math.cos(
        inputs.shank_angle
    ) + inputs.ankle_acceleration_x * math.sin(inputs.shank_angle)
    return foot.socket_compliance * (axial_force - foot.distal_mass * up)


def gravity_and_inertia_moment(foot: Foot, angle: float, inputs: FootInputs) -> float:
    """Moment [N.m] of weight and of the ankle's acceleration."""
    cosine, sine = math.cos(inputs.shank_angle + angle), math.sin(inputs.shank_angle + angle)
    x = foot.com_x * cosine + foot.com_z * sine
    z = foot.com_z * cosine - foot.com_x * sine
    return foot.mass * (x * (GRAVITY + inputs.ankle_acceleration_z) - z * inputs.ankle_acceleration_x)


def end_stop_moment(foot: Foot, angle: float, rate: float, free_acceleration: float) -> float:
    """Moment [N.m] of the end stops, for the acceleration [rad/s2] that there would be ``free`` of them.

    MuJoCo's soft limit: of the acceleration into the stop the share ``d`` (solimp) is replaced by
    ``-2 v / (d1 tau) - d r / (d1 tau)^2``, where ``r`` is how deep it is in and ``d1`` the largest ``d``.
    """
    inward = 1.0 if angle < foot.min_angle else -1.0
    depth = foot.min_angle - angle if angle < foot.min_angle else angle - foot.max_angle
    if depth <= 0.0:
        return 0.0
    x = min(1.0, depth / foot.stop_width)
    share = 2.0 * x * x if x <= 0.5 else 1.0 - 2.0 * (1.0 - x) * (1.0 - x)
    impedance = foot.stop_min_impedance + share * (foot.stop_max_impedance - foot.stop_min_impedance)
    time = foot.stop_max_impedance * foot.stop_time_constant
    wanted = -2.0 / time * inward * rate + impedance / (time * time) * depth
    return inward * foot.inertia * max(0.0, impedance * (wanted - inward * free_acceleration))


def step_ankle(foot: Foot, angle: float, rate: float, tension: float, inputs: FootInputs, dt: float) -> AnkleStep:
    """The ankle a ``step`` [s] later, under ``tension`` [N].

    Damping and friction are implicit: friction takes off of the rate that there would be without it as much as it can,
    and holds the ankle where that is all of it (backward Euler of Coulomb's law), so it never drives.
    """
    own = (
        tension * moment_arm(foot, angle)
        - foot.spring_stiffness * (angle - foot.spring_rest_angle)
        - foot.ankle_damping * rate
    )
    own += foot.bumper_stiffness * max(0.0, -angle - foot.bumper_onset_angle)
    other = (
        inputs.ground_moment
        + gravity_and_inertia_moment(foot, angle, inputs)
        - foot.inertia * inputs.shank_angular_acceleration
    )
    own += end_stop_moment(foot, angle, rate, (own + other) / foot.inertia)
    heavy = foot.inertia + dt * foot.ankle_damping
    after = rate + dt * (own + other) / heavy
    most = dt * foot.ankle_friction / heavy
    taken = min(max(after, -most), most)
    return AnkleStep(angle + dt * (after - taken), after - taken, own - taken * heavy / dt)
