"""A prosthetic foot that turns about an ankle whose own motion is prescribed, in the sagittal plane.

Newton-Euler about the moving ankle axis, with ``q`` the ankle angle (plantarflexion positive, a rotation about +y,
which lowers the toe), ``t`` the shank's lean (forward positive, about +y as well), ``c`` the foot's centre of mass
relative to the ankle and ``a`` the ankle's acceleration::

    I (t'' + q'') = T r(q) - k (q - q0) - b q' + k_b max(0, -q - q_b) + M_friction + M_stop + M_ground + M_weight
    M_weight = m (c_x (g + a_z) - c_z a_x)         c turned by t + q

with ``T r`` the device's tension times its moment arm. The base is prescribed: its acceleration is an input, and no
force acts back on it. The foot may bend beyond the hinge (:func:`step_keel_angle`). The bending part is light, so its
angle follows the moment, and it does not affect the hinge. The limb may sink into its socket
(:func:`step_socket_displacement`) and tilt in it (:func:`step_socket_tilt`); both move the ankle under the ground
reaction.

Springs, masses and sites are those of the MJCF. Stops and time step are MuJoCo's formulas (documentation,
"Computation", solver parameters; the integrator *implicitfast*) for the single free coordinate.
"""

import math
from typing import NamedTuple

from klute_sim.constants import GRAVITY

UNKNOWN_ANGLE_SCALE = math.radians(15.0)
"""Dorsiflexion that normalizes angles in a data-driven moment [rad]."""
UNKNOWN_MOMENT_SCALE = 100.0
"""Moment that normalizes that of the ground reaction there [N.m]."""
UNKNOWN_FORCE_SCALE = 1000.0
"""Force that normalizes the ground reaction there [N]."""
UNKNOWN_PRESSURE_SCALE = 5e5
"""Pressure that normalizes pressures there [Pa]."""


class Foot(NamedTuple):
    """A foot on its ankle; SI units, positions from the ankle axis, x forward and z up."""

    inertia: float
    """Moment of inertia about the ankle axis [kg m2]."""
    mass: float
    """Mass of the foot [kg]."""
    com_x: float
    """Forward position of the centre of mass in the foot [m]."""
    com_z: float
    """Upward position of the centre of mass in the foot [m]."""
    origin_x: float
    """Forward position of the tendon's origin in the pylon [m]."""
    origin_z: float
    """Upward position of the tendon's origin in the pylon [m]."""
    insertion_x: float
    """Forward position of the tendon's insertion in the foot [m]."""
    insertion_z: float
    """Upward position of the tendon's insertion in the foot [m]."""
    spring_stiffness: float
    """Stiffness of the return spring [N.m/rad]."""
    spring_rest_angle: float
    """Ankle angle at which the return spring is slack [rad]."""
    ankle_damping: float
    """Viscous damping of the ankle [N.m.s/rad]."""
    ankle_friction: float
    """Coulomb friction of the ankle [N.m]."""
    min_angle: float
    """Ankle angle at which the dorsiflexion stop begins [rad]."""
    max_angle: float
    """Ankle angle at which the plantarflexion stop begins [rad]."""
    bumper_stiffness: float
    """Stiffness of a dorsiflexion bumper [N.m/rad]."""
    bumper_onset_angle: float
    """Dorsiflexion at which the bumper begins [rad]."""
    stop_time_constant: float
    """Time constant of the end stops, critically damped [s]."""
    stop_min_impedance: float
    """Impedance where an end stop begins (MuJoCo's solimp) [1]."""
    stop_max_impedance: float
    """Impedance at and beyond ``stop_width`` (MuJoCo's solimp) [1]."""
    stop_width: float
    """Depth at which the impedance of an end stop reaches its maximum (MuJoCo's solimp) [rad]."""
    keel_compliance: float
    """Compliance of the foot between hinge and sole [rad/(N.m)]; 0: rigid."""
    keel_time_constant: float
    """Time constant of the foot's bending [s]."""
    keel_friction_angle: float
    """Lag of the bending by dry friction in the foot [rad]."""
    socket_compliance: float
    """Compliance of the socket along the pylon [m/N]."""
    socket_time_constant: float
    """Time constant of the socket along the pylon [s]: its damping times its compliance."""
    tilt_compliance: float
    """Compliance of the socket in rotation, in the sagittal plane [rad/(N.m)]."""
    tilt_time_constant: float
    """Time constant of this rotation [s]."""
    tilt_height: float
    """Height of its centre above the ankle axis, along the pylon [m]."""
    distal_mass: float
    """Mass of all parts below the socket [kg]."""
    distal_com_z: float
    """Upward position of the centre of mass of these parts, at a neutral ankle [m]."""
    unknown_offset: float
    """Data-driven moment [N.m], as all of these coefficients (:func:`unknown_moment`)."""
    unknown_angle: float
    """Coefficient of the dorsiflexion [N.m]."""
    unknown_angle_squared: float
    """Coefficient of its square [N.m]."""
    unknown_load: float
    """Coefficient of the moment of the ground reaction [N.m]."""
    unknown_load_squared: float
    """Coefficient of its square [N.m]."""
    unknown_load_angle: float
    """Coefficient of its product with the dorsiflexion [N.m]."""
    unknown_force: float
    """Coefficient of the ground reaction along the pylon [N.m]."""
    unknown_load_force: float
    """Coefficient of its product with the moment of the ground reaction [N.m]."""
    unknown_pressure: float
    """Coefficient of the pressure [N.m]."""
    unknown_pressure_angle: float
    """Coefficient of its product with the dorsiflexion [N.m]."""


class FootInputs(NamedTuple):
    """Prescribed motion and load at one instant."""

    shank_angle: float
    """Lean of the shank [rad]."""
    shank_angular_acceleration: float
    """Second derivative of the lean [rad/s2]."""
    ankle_acceleration_x: float
    """Forward acceleration of the ankle [m/s2]."""
    ankle_acceleration_z: float
    """Upward acceleration of the ankle [m/s2]."""
    ground_moment: float
    """Moment of the ground reaction about the ankle [N.m], plantarflexion positive."""


class AnkleStep(NamedTuple):
    """The ankle after a step."""

    angle: float
    """Ankle angle after the step [rad]."""
    velocity: float
    """Angular velocity after the step [rad/s]."""
    moment: float
    """Moment of tendon, spring, damping, friction and stops during the step [N.m], plantarflexion positive."""


def unit_length(foot: Foot, angle: float) -> float:
    """Return the length of the muscle-tendon unit [m]: the distance between its two sites."""
    x, z = _insertion_position(foot, angle)
    return math.sqrt((foot.origin_x - x) * (foot.origin_x - x) + (foot.origin_z - z) * (foot.origin_z - z))


def moment_arm(foot: Foot, angle: float) -> float:
    """Return ``-d(unit_length)/d(angle)`` [m]: the plantarflexion moment per tension."""
    x, z = _insertion_position(foot, angle)
    return ((foot.origin_x - x) * z - (foot.origin_z - z) * x) / unit_length(foot, angle)


def _insertion_position(foot: Foot, angle: float) -> tuple[float, float]:
    """Return the position of the insertion in the pylon's frame [m]."""
    cosine, sine = math.cos(angle), math.sin(angle)
    x = foot.insertion_x * cosine + foot.insertion_z * sine
    return x, foot.insertion_z * cosine - foot.insertion_x * sine


def step_keel_angle(foot: Foot, keel_angle: float, moment: float, dt: float) -> float:
    """Return the bending of the foot [rad], dorsiflexion positive, after ``dt`` [s] from ``keel_angle`` [rad].

    ``moment`` [N.m], plantarflexion positive, is transmitted by the hinge. The foot is a spring in parallel with a
    dashpot and Coulomb friction (backward Euler); friction reduces the distance to the spring's equilibrium as far as
    it can.
    """
    if foot.keel_compliance == 0.0:
        return 0.0
    distance = foot.keel_compliance * moment - keel_angle
    return keel_angle + (distance - min(max(distance, -foot.keel_friction_angle), foot.keel_friction_angle)) / (
        1.0 + foot.keel_time_constant / dt
    )


def step_socket_displacement(
    foot: Foot, displacement: float, inputs: FootInputs, axial_force: float, dt: float
) -> float:
    """Return the displacement of the limb into its socket [m] after ``dt`` [s] from ``displacement`` [m].

    ``axial_force`` [N] is the ground reaction along the pylon. The socket's load is this force minus weight and inertia
    of all parts below the socket. The socket is a spring in parallel with a dashpot (backward Euler).
    """
    if foot.socket_compliance == 0.0:
        return 0.0
    up = (GRAVITY + inputs.ankle_acceleration_z) * math.cos(
        inputs.shank_angle
    ) + inputs.ankle_acceleration_x * math.sin(inputs.shank_angle)
    distance = foot.socket_compliance * (axial_force - foot.distal_mass * up) - displacement
    return displacement + distance / (1.0 + foot.socket_time_constant / dt)


def step_socket_tilt(foot: Foot, tilt: float, inputs: FootInputs, shear_force: float, dt: float) -> float:
    """Return the lean of the pylon beyond that of the limb [rad], forward positive, after ``dt`` [s] from ``tilt``.

    ``shear_force`` [N] is the ground reaction across the pylon, backward positive. The moment about the centre of
    rotation, at the height ``h``, is that of the ground reaction about the ankle plus ``h shear_force``, and that of
    weight and inertia of all parts below the socket, whose mass is a point here. The socket is a spring in parallel
    with a dashpot (backward Euler).
    """
    if foot.tilt_compliance == 0.0:
        return 0.0
    across = inputs.ankle_acceleration_x * math.cos(inputs.shank_angle) - (
        GRAVITY + inputs.ankle_acceleration_z
    ) * math.sin(inputs.shank_angle)
    moment = (
        inputs.ground_moment
        + foot.tilt_height * shear_force
        + foot.distal_mass * (foot.tilt_height - foot.distal_com_z) * across
    )
    return tilt + (foot.tilt_compliance * moment - tilt) / (1.0 + foot.tilt_time_constant / dt)


def gravity_and_inertia_moment(foot: Foot, angle: float, inputs: FootInputs) -> float:
    """Return the moment [N.m] of the foot's weight and of the ankle's acceleration."""
    cosine, sine = math.cos(inputs.shank_angle + angle), math.sin(inputs.shank_angle + angle)
    x = foot.com_x * cosine + foot.com_z * sine
    z = foot.com_z * cosine - foot.com_x * sine
    return foot.mass * (x * (GRAVITY + inputs.ankle_acceleration_z) - z * inputs.ankle_acceleration_x)


def unknown_moment(foot: Foot, angle: float, ground_moment: float, axial_force: float, pressure: float) -> float:
    """Return the data-driven moment about the ankle [N.m], plantarflexion positive; 0 where all coefficients are.

    ``angle`` [rad] is plantarflexion, ``ground_moment`` [N.m] the moment of the ground reaction about the ankle,
    ``axial_force`` [N] the ground reaction along the pylon, and ``pressure`` [Pa] the gauge pressure in the muscle.
    Each is normalized and bounded.
    """
    a = min(max(-angle / UNKNOWN_ANGLE_SCALE, -2.0), 2.0)
    load = min(max(-ground_moment / UNKNOWN_MOMENT_SCALE, -2.0), 2.0)
    force = min(max(axial_force / UNKNOWN_FORCE_SCALE, 0.0), 2.0)
    p = min(max(pressure / UNKNOWN_PRESSURE_SCALE, 0.0), 2.0)
    return (
        foot.unknown_offset
        + a * (foot.unknown_angle + foot.unknown_angle_squared * a)
        + load * (foot.unknown_load + foot.unknown_load_squared * load + foot.unknown_load_angle * a)
        + force * (foot.unknown_force + foot.unknown_load_force * load)
        + p * (foot.unknown_pressure + foot.unknown_pressure_angle * a)
    )


def end_stop_moment(foot: Foot, angle: float, velocity: float, free_acceleration: float) -> float:
    """Return the moment [N.m] of the end stops; ``free_acceleration`` [rad/s2] is that without them.

    MuJoCo's soft limit replaces the fraction ``d`` (solimp) of the acceleration into the stop by
    ``-2 v / (d1 tau) - d r / (d1 tau)^2``, where ``r`` is the depth and ``d1`` the largest ``d``.
    """
    inward = 1.0 if angle < foot.min_angle else -1.0
    depth = foot.min_angle - angle if angle < foot.min_angle else angle - foot.max_angle
    if depth <= 0.0:
        return 0.0
    x = min(1.0, depth / foot.stop_width)
    fraction = 2.0 * x * x if x <= 0.5 else 1.0 - 2.0 * (1.0 - x) * (1.0 - x)
    impedance = foot.stop_min_impedance + fraction * (foot.stop_max_impedance - foot.stop_min_impedance)
    time = foot.stop_max_impedance * foot.stop_time_constant
    reference = -2.0 / time * inward * velocity + impedance / (time * time) * depth
    return inward * foot.inertia * max(0.0, impedance * (reference - inward * free_acceleration))


def step_ankle(foot: Foot, angle: float, velocity: float, tension: float, inputs: FootInputs, dt: float) -> AnkleStep:
    """Return the ankle after a step ``dt`` [s] under ``tension`` [N].

    Damping and friction are implicit. Friction reduces the velocity as far as it can and holds the ankle where it
    reaches zero (backward Euler of Coulomb's law), so it never drives the ankle.
    """
    moment = (
        tension * moment_arm(foot, angle)
        - foot.spring_stiffness * (angle - foot.spring_rest_angle)
        - foot.ankle_damping * velocity
    )
    moment += foot.bumper_stiffness * max(0.0, -angle - foot.bumper_onset_angle)
    external = (
        inputs.ground_moment
        + gravity_and_inertia_moment(foot, angle, inputs)
        - foot.inertia * inputs.shank_angular_acceleration
    )
    moment += end_stop_moment(foot, angle, velocity, (moment + external) / foot.inertia)
    effective_inertia = foot.inertia + dt * foot.ankle_damping
    after = velocity + dt * (moment + external) / effective_inertia
    max_reduction = dt * foot.ankle_friction / effective_inertia
    reduction = min(max(after, -max_reduction), max_reduction)
    return AnkleStep(angle + dt * (after - reduction), after - reduction, moment - reduction * effective_inertia / dt)
