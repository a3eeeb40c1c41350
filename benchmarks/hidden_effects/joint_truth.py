"""An antagonist joint of the benchmark: geometry, equation of motion and integrator, written without the package.

A lever on a pulley hangs between two muscles whose cables wrap around the pulley from the front and from behind. The
devices follow :mod:`law` with a prescribed pressure. Flexion ``q`` lifts the lever forward and is positive::

    (I + I_a) q'' = a_f T_f - a_e T_e - m g d sin(q - tilt) - b q' - M_friction

Kick, drift and kick (velocity Verlet; Swope et al. 1982) advance the joint, with friction and damping implicit in
between; the devices take one L-stable step (:mod:`truth`) along the straight change of their lengths. SI units.
"""

import math
from typing import NamedTuple

import numpy as np
from benchmarks.hidden_effects.air import AIR_STEP, AirSupply, interpolate_on_grid
from benchmarks.hidden_effects.compiled import cached_njit
from benchmarks.hidden_effects.law import N_INTERNAL_STATES, Law, set_rest_state, tendon_tension
from benchmarks.hidden_effects.truth import GAMMA, TRACE_STEP, BoundaryConditions, solve_rest_length, solve_stage

GRAVITY = 9.81
STEPS_PER_TRACE = 4  # integrator steps per sample of the trace: 0.25 ms
CHEBYSHEV_ORDERS = np.array([(2, 0), (0, 2), (1, 1), (3, 0), (2, 1), (1, 2), (0, 3)])
"""Orders in pressure and length of an error of the force, as in :mod:`imperfect`."""


class JointLaw(NamedTuple):
    """Numbers of the joint; floats only."""

    inertia: float
    """About the axis, with everything on the lever [kg m2]."""
    weight_moment: float
    """Weight times distance from the axis, of everything on the lever [N m]."""
    damping: float
    radius: float
    origin_x: float
    """Distance of both origins from the axis, to the front and to the back [m]."""
    flexor_height: float
    extensor_height: float
    flexor_end_x: float
    """Ends of the cables on the pulley at angle 0, of the extensor mirrored [m]."""
    flexor_end_z: float
    extensor_end_x: float
    extensor_end_z: float
    tilt: float = 0.0
    """Lean of the stand to the front [rad]."""
    coulomb: float = 0.0
    bristle: float = 0.0
    """Friction of the sliding bristle [N m]."""
    bristle_excess: float = 0.0
    bristle_speed: float = 1.0
    bristle_reach: float = 1.0
    eccentricity: float = 0.0
    """Distance of the axis from the middle of the pulley [m]."""
    elastic: float = 0.0
    """Moment of a bundle of cables across the joint at 1 rad, growing with the square of the angle [N m]."""


class ForceError(NamedTuple):
    """Error of the law of the muscles: gain of the specimen, and a smooth surface over pressure and length."""

    gain: float
    amplitude: float
    """Amplitude of the surface over the root of the sum of its squared coefficients [N]."""
    coefficients: np.ndarray


@cached_njit
def cable_length(joint: JointLaw, q: float, side: float) -> float:
    """Return the length of the flexor (``side`` 1) or the extensor (-1) at ``q``: straight, around, and straight."""
    height = joint.flexor_height if side > 0.0 else joint.extensor_height
    x = joint.flexor_end_x if side > 0.0 else joint.extensor_end_x
    z = joint.flexor_end_z if side > 0.0 else joint.extensor_end_z
    r = joint.radius
    distance, end_distance = math.hypot(joint.origin_x, height), math.hypot(x, z)
    touch = math.atan2(height, joint.origin_x) - math.acos(r / distance)
    leave = math.atan2(z, x) + math.acos(min(1.0, r / end_distance)) + side * q
    straight = math.sqrt(distance * distance - r * r) + math.sqrt(max(end_distance * end_distance - r * r, 0.0))
    return straight + r * (touch - leave) - joint.eccentricity * math.sin(q)


@cached_njit
def cable_arm(joint: JointLaw, q: float, side: float) -> float:
    """Return the arm of the tension for flexion (flexor) or extension (extensor) [m]."""
    return joint.radius + side * joint.eccentricity * math.cos(q)


@cached_njit
def force_with_error(force: float, pressure: float, length: float, error: ForceError) -> float:
    """Return the tension of a muscle with the error of its law; a slack tendon has none."""
    if force <= 0.0 or (error.gain == 1.0 and error.amplitude == 0.0):
        return force
    p = min(max(pressure / 2.5e5 - 1.0, -1.0), 1.0)
    x = min(max((length - 0.335) / 0.02, -1.0), 1.0)
    surface = 0.0
    for k in range(len(error.coefficients)):
        i, j = CHEBYSHEV_ORDERS[k, 0], CHEBYSHEV_ORDERS[k, 1]
        surface += error.coefficients[k] * math.cos(i * math.acos(p)) * math.cos(j * math.acos(x))
    return max(0.0, error.gain * force + error.amplitude * surface)


@cached_njit
def joint_moment(joint: JointLaw, q: float, flexor: float, extensor: float) -> float:
    """Return the moment of both tensions, weight and cables [N m]."""
    return (
        cable_arm(joint, q, 1.0) * flexor
        - cable_arm(joint, q, -1.0) * extensor
        - joint.weight_moment * math.sin(q - joint.tilt)
        - joint.elastic * q * abs(q)
    )


@cached_njit
def advance_device(
    h: float,
    L: float,
    v: float,
    units: tuple[float, float],
    pressures: tuple[float, float, float],
    state: np.ndarray,
    new: np.ndarray,
    work: np.ndarray,
    law: Law,
    air: AirSupply,
) -> tuple[float, float]:
    """Return length and velocity after one step with a unit length from ``units[0]`` to ``units[1]``.

    ``pressures`` are those at the start, at the first stage and at the end.
    """
    gh, middle, base, rate = GAMMA * h, work[0], work[1], (units[1] - units[0]) / h
    first = BoundaryConditions(units[0] + GAMMA * (units[1] - units[0]), rate, pressures[1], 0.0)
    v1 = solve_stage(v, L, first, gh, state, state, middle, law, air)
    for i in range(N_INTERNAL_STATES):
        base[i] = state[i] + (1.0 - GAMMA) / GAMMA * (middle[i] - state[i])
    start = L + (1.0 - GAMMA) * h * v1
    last = BoundaryConditions(units[1], rate, pressures[2], 0.0)
    v2 = solve_stage(v1, start, last, gh, middle, base, new, law, air)
    return start + gh * v2, v2


@cached_njit
def resting_tension(joint: JointLaw, q: float, side: float, pressure: float, law: Law) -> float:
    """Return the tension of a device at rest [N]."""
    unit, memory = cable_length(joint, q, side), np.zeros(N_INTERNAL_STATES)
    L = solve_rest_length(unit, pressure, law)
    stretch = unit - L - law.slack - law.tendon_slack
    set_rest_state(memory, L - law.resting_length, stretch, law)
    return tendon_tension(stretch, 0.0, memory, law)


@cached_njit
def solve_rest_angle(
    joint: JointLaw, pressures: tuple[float, float], laws: tuple[Law, Law], errors: tuple[ForceError, ForceError]
) -> float:
    """Return the angle at which the joint rests without friction, by bisection between the stops."""
    low, high = -30.0 * math.pi / 180.0, 100.0 * math.pi / 180.0
    for _ in range(60):
        q = 0.5 * (low + high)
        flexor = resting_tension(joint, q, 1.0, pressures[0], laws[0])
        extensor = resting_tension(joint, q, -1.0, pressures[1], laws[1])
        flexor = force_with_error(flexor, pressures[0], cable_length(joint, q, 1.0), errors[0])
        extensor = force_with_error(extensor, pressures[1], cable_length(joint, q, -1.0), errors[1])
        if joint_moment(joint, q, flexor, extensor) > 0.0:
            low = q
        else:
            high = q
    return 0.5 * (low + high)


@cached_njit
def integrate_joint(
    joint: JointLaw,
    laws: tuple[Law, Law],
    air: AirSupply,
    pressures: np.ndarray,
    errors: tuple[ForceError, ForceError],
    n_samples: int,
    steps: int,
) -> np.ndarray:
    """Return angle and both tensions (3, ``n_samples``) on the trace grid, in ``steps`` steps per sample.

    ``pressures`` (2, air grid) are gauge pressures [Pa]; the joint begins at rest.
    """
    out = np.empty((3, n_samples))
    h = TRACE_STEP / steps
    q = solve_rest_angle(joint, (pressures[0, 0], pressures[1, 0]), laws, errors)
    w, z = 0.0, 0.0
    lengths, speeds, tensions = np.empty(2), np.zeros(2), np.empty(2)
    state, new, work = (
        np.zeros((2, N_INTERNAL_STATES)),
        np.zeros(N_INTERNAL_STATES),
        np.zeros((2, N_INTERNAL_STATES)),
    )
    for k in range(2):
        unit = cable_length(joint, q, 1.0 - 2.0 * k)
        lengths[k] = solve_rest_length(unit, pressures[k, 0], laws[k])
        stretch = unit - lengths[k] - laws[k].slack - laws[k].tendon_slack
        set_rest_state(state[k], lengths[k] - laws[k].resting_length, stretch, laws[k])
        tensions[k] = tendon_tension(stretch, 0.0, state[k], laws[k])
        tensions[k] = force_with_error(tensions[k], pressures[k, 0], unit, errors[k])
    moment = joint_moment(joint, q, tensions[0], tensions[1])
    out[0, 0], out[1, 0], out[2, 0] = q, tensions[0], tensions[1]
    for sample in range(1, n_samples):
        for part in range(steps):
            t = (sample - 1) * TRACE_STEP + part * h
            w += 0.5 * h * moment / joint.inertia
            stiffness, divisor = 0.0, 1.0
            if joint.bristle > 0.0:
                ratio = w / joint.bristle_speed
                level = 1.0 + joint.bristle_excess * math.exp(-ratio * ratio)
                stiffness = joint.bristle / joint.bristle_reach
                divisor = 1.0 + h * abs(w) / (joint.bristle_reach * level)
            free = w - h * stiffness * z / (divisor * joint.inertia)
            free /= 1.0 + h * joint.damping / joint.inertia + h * h * stiffness / (divisor * joint.inertia)
            w = math.copysign(max(0.0, abs(free) - h * joint.coulomb / joint.inertia), free)
            z = (z + h * w) / divisor
            q_new = q + h * w
            for k in range(2):
                side = 1.0 - 2.0 * k
                units = cable_length(joint, q, side), cable_length(joint, q_new, side)
                p = (
                    interpolate_on_grid(t, pressures[k], AIR_STEP),
                    interpolate_on_grid(t + GAMMA * h, pressures[k], AIR_STEP),
                    interpolate_on_grid(t + h, pressures[k], AIR_STEP),
                )
                lengths[k], speeds[k] = advance_device(
                    h, lengths[k], speeds[k], units, p, state[k], new, work, laws[k], air
                )
                state[k] = new
                stretch = units[1] - lengths[k] - laws[k].slack - laws[k].tendon_slack
                tensions[k] = tendon_tension(stretch, (units[1] - units[0]) / h - speeds[k], state[k], laws[k])
                tensions[k] = force_with_error(tensions[k], p[2], units[1], errors[k])
            q = q_new
            moment = joint_moment(joint, q, tensions[0], tensions[1])
            w += 0.5 * h * moment / joint.inertia
        out[0, sample], out[1, sample], out[2, sample] = q, tensions[0], tensions[1]
    return out
