"""Plan the motion of the residual limb and the load from a gait reference.

A reference gives joint angles and ground reaction, but neither the height nor the speed of the hip. Both follow from
the sole: the hip has the height at which the reference foot just touches the ground, and the speed at which that foot
rolls without slipping.

Positive angles lean forward: ``thigh = knee - shank`` becomes the hinge angle of the model, about +y; the pitch of the
foot is ``shank - dorsiflexion``.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from klute_sim.constants import GRAVITY
from klute_sim.errors import InputError
from klute_sim.gait.reference import Reference
from klute_sim.types import Array

PHASE_GRID = np.arange(400) / 400.0
"""Phases at which the contact of the sole is computed."""

STANCE_KNOT_PHASES = np.array(
    [0.05, 0.09, 0.13, 0.17, 0.21, 0.26, 0.31, 0.36, 0.41, 0.46, 0.50, 0.54, 0.57, 0.60, 0.63]
)
"""Phases at which the hip has contact height, for a reference with toe-off at :data:`KNOT_TOE_OFF_PHASE`.

After the last of them the foot leaves the ground, independent of the ankle. With a last phase of 0.59, the net moment
would be zero from 60 % on; this alone would deviate from the reference by 0.35 standard deviations."""
SWING_KNOT_PHASES = np.array([0.70, 0.80, 0.88, 0.94, 1.0])
"""Phases of the hip height in swing, for a reference with toe-off at :data:`KNOT_TOE_OFF_PHASE`."""
KNOT_TOE_OFF_PHASE = 0.633
"""Toe-off phase that the knot phases belong to."""
STANCE_CLEARANCE = 0.5e-3
"""Height of the hip above contact height in stance [m]; the load presses the foot down."""
SWING_HIP_HEIGHTS = (0.898, 0.908, 0.905)
"""Hip heights at the first swing knots [m] (the third is a minimum), for legs of 0.43 + 0.43 m."""
SWING_CLEARANCES = (12e-3, 9e-3, 5e-3)
"""Heights of the hip above contact height at the last three knots [m]; the last one sets first contact."""
MAX_PASSIVE_DORSIFLEXION_DEG = 1.0
"""Maximum dorsiflexion of the hinge in swing [deg] that is assumed: a passive ankle does not lift its toe."""
MIN_TOE_CLEARANCE = 14e-3
"""Minimum toe clearance of a passive ankle in swing [m], for legs of 0.43 + 0.43 m; below it the hip is hiked
(assumed: people clear the ground by 10 to 20 mm)."""
CLEARANCE_PHASES = (0.68, 0.97)
"""Phases between which the foot must clear the ground, for a reference with toe-off at :data:`KNOT_TOE_OFF_PHASE`."""
MIN_SUPPORT_BW = 0.1
"""Smallest load of both feet together [body weights] in walking (assumed; it is 0.5 or more)."""
N_SPEED_HARMONICS = 6
"""Number of Fourier terms of the forward speed of the hip."""


@dataclass(frozen=True)
class LegGeometry:
    """Lengths of the leg and contact points of the sole."""

    thigh: float
    """Distance from hip to knee [m]."""
    shank: float
    """Distance from knee to ankle [m]."""
    sole: Array
    """(n, 4) x and z of the centres, and half lengths along x and z, of the ellipsoids of the sole in the frame of the
    foot [m]."""
    scale: float
    """Leg length over 0.86 m [1]."""

    def compute_ankle_height(self, pitch: Array) -> Array:
        """Return the height [m] of the ankle axis above flat ground where a foot at ``pitch`` [rad] touches it."""
        x, z, half_length, half_height = self.sole.T
        sine, cosine = np.sin(pitch)[:, None], np.cos(pitch)[:, None]
        lowest = -sine * x + cosine * z - np.hypot(half_length * sine, half_height * cosine)
        return np.asarray(-lowest.min(axis=1), dtype=np.float64)


@dataclass(frozen=True)
class HipTrajectory:
    """Motion of the hip over one stride as functions of phase.

    A time derivative is a derivative by phase over ``stride_time``, once per order.
    """

    stride_time: float
    """Stride time [s]."""
    speed: float
    """Mean forward speed [m/s]."""
    height: CubicSpline
    """Height of the hip [m]."""
    velocity: CubicSpline
    """Forward speed of the hip [m/s]."""
    travel: PPoly
    """Integral of ``velocity`` over phase: forward position of the hip over stride time [m/s]."""

    @property
    def stride_length(self) -> float:
        """Distance that the hip covers in one stride [m]."""
        return float(self.travel(1.0)) * self.stride_time


def compute_thigh_angle(reference: Reference, phase: Array, derivative: int = 0) -> Array:
    """Return the thigh hinge angle [rad] at ``phase``, or its ``derivative``-th derivative by phase."""
    shank = reference("shank_forward_deg", phase, derivative)
    return np.radians(shank - reference("knee_flexion_deg", phase, derivative))


def compute_knee_angle(reference: Reference, phase: Array, derivative: int = 0) -> Array:
    """Return the knee angle [rad], flexion positive, at ``phase``, or its ``derivative``-th derivative by phase."""
    return np.radians(reference("knee_flexion_deg", phase, derivative))


def plan_hip_trajectory(
    reference: Reference,
    leg: LegGeometry,
    stride_time: float,
    speed: float | None = None,
    slope: float = 0.0,
    alignment: float = 0.0,
) -> HipTrajectory:
    """Return the motion of the hip for the gait ``reference`` with ``leg``, in the frame of the ground.

    The angles of the reference and the leg determine the distance per stride. ``stride_time`` [s] then determines the
    speed; a chosen ``speed`` [m/s] determines the stride time instead. ``reference`` is already that of the ``slope``
    [rad] (:meth:`klute_sim.gait.reference.Reference.tilt_to_slope`). A prosthesis does not lift its toe. In swing the
    hip is therefore raised so far that a foot with the ankle angle of level ground has the clearance of level ground
    (assumed: people hike the hip), and that a foot clears level ground whose hinge is not dorsiflexed and which has the
    ``alignment`` [rad] to the limb.

    Raises InputError for a reference of running.
    """
    thigh = compute_thigh_angle(reference, PHASE_GRID)
    shank = thigh + compute_knee_angle(reference, PHASE_GRID)
    pitch = shank - np.radians(reference("ankle_dorsiflexion_deg", PHASE_GRID))
    ankle = leg.compute_ankle_height(pitch)
    hip_above_ankle = leg.shank * np.cos(shank) + leg.thigh * np.cos(thigh)
    contact, swing_contact = ankle + hip_above_ankle, leg.compute_ankle_height(pitch + slope) + hip_above_ankle
    level_height = ankle + leg.shank * np.cos(shank - slope) + leg.thigh * np.cos(thigh - slope)

    # Hiking is computed on level ground.
    passive_dorsiflexion = np.minimum(shank - pitch - slope, alignment + math.radians(MAX_PASSIVE_DORSIFLEXION_DEG))
    passive_height = level_height - ankle + leg.compute_ankle_height(shank - slope - passive_dorsiflexion)
    hike = _compute_hip_hike(reference, level_height, passive_height, leg.scale)

    # Forward speed per cycle [m]: the foot rolls under the ankle, and the leg swings over it.
    hip_offset = -leg.thigh * np.sin(thigh) - leg.shank * np.sin(shank)
    rolling = -_differentiate_by_phase(hip_offset) + _differentiate_by_phase(pitch) * ankle
    per_cycle = _blend_leg_speeds(reference, rolling, leg.scale)
    if speed is not None:
        stride_time = float(per_cycle.mean()) / speed
    forward = _fit_periodic_spline(per_cycle / stride_time)
    return HipTrajectory(
        stride_time=stride_time,
        speed=float(per_cycle.mean()) / stride_time,
        height=_fit_hip_height(reference, contact, swing_contact, swing_contact - level_height, leg.scale, hike),
        velocity=forward,
        travel=forward.antiderivative(),
    )


def _differentiate_by_phase(values: Array) -> Array:
    return np.asarray((np.roll(values, -1) - np.roll(values, 1)) * (len(values) / 2.0))


def _fit_periodic_spline(values: Array) -> CubicSpline:
    return CubicSpline(np.append(PHASE_GRID, 1.0), np.append(values, values[0]), bc_type="periodic")


def _blend_leg_speeds(reference: Reference, rolling: Array, scale: float) -> Array:
    """Return the forward speed of the hip per cycle [m]: the rolling speeds of both legs, weighted with their loads.

    Raises InputError where neither leg has a load.
    """
    low, high = 0.55 * scale, 2.2 * scale  # outside this range a foot is about to leave or to meet the ground
    load = np.maximum(reference("grf_vertical_n_per_kg", PHASE_GRID), 0.0)
    speed = np.clip(rolling, low, high)
    half = len(PHASE_GRID) // 2
    other_load, other_speed = np.roll(load, half), np.roll(speed, half)
    in_flight = load + other_load < MIN_SUPPORT_BW * GRAVITY
    if in_flight.any():
        raise InputError(
            f"reference {reference.name}: both feet are in the air in {100.0 * in_flight.mean():.0f} % of the cycle, "
            "as in running (the other foot has the load of this one half a cycle later); the rig simulates walking, so "
            "give a reference whose foot stands for more than half of the cycle"
        )
    blended = (load * speed + other_load * other_speed) / (load + other_load)
    spectrum = np.fft.rfft(blended)
    spectrum[N_SPEED_HARMONICS + 1 :] = 0.0
    return np.asarray(np.fft.irfft(spectrum, len(PHASE_GRID)))


def _scale_knots(reference: Reference, knots: Array) -> Array:
    """Return the phases of ``reference`` for phases with toe-off at :data:`KNOT_TOE_OFF_PHASE`."""
    return np.asarray(
        np.interp(knots, [0.0, KNOT_TOE_OFF_PHASE, 1.0], [0.0, reference.find_toe_off_phase(), 1.0]), dtype=np.float64
    )


def _compute_hip_hike(reference: Reference, level_height: Array, passive_height: Array, scale: float) -> Array:
    """Return the hike [m] of the first three swing knots with which a passive ankle clears level ground.

    ``level_height`` and ``passive_height`` are the heights of the hip [m] at which the foot of the reference and the
    foot of a passive ankle touch the ground.
    """
    hike = np.zeros(3)
    knots = _scale_knots(reference, SWING_KNOT_PHASES[:3])
    low, high = _scale_knots(reference, np.array(CLEARANCE_PHASES))
    nearest = np.abs(np.subtract.outer(PHASE_GRID, knots)).argmin(axis=1)
    for _ in range(8):
        hip_height = _fit_hip_height(reference, level_height, level_height, np.zeros(len(PHASE_GRID)), scale, hike)
        shortfall = np.where(
            (low <= PHASE_GRID) & (high >= PHASE_GRID),
            MIN_TOE_CLEARANCE * scale - (hip_height(PHASE_GRID) - passive_height),
            0.0,
        )
        if shortfall.max() <= 1e-4:
            break
        for knot in range(3):
            hike[knot] += max(0.0, float(shortfall[nearest == knot].max()))
    return hike


def _fit_hip_height(
    reference: Reference, stance_contact: Array, swing_contact: Array, slope_offset: Array, scale: float, hike: Array
) -> CubicSpline:
    """Return the height of the hip as a periodic spline: contact height in stance, with toe clearance in swing.

    ``stance_contact`` and ``swing_contact`` are the heights [m] at which the foot touches the ground in stance and in
    swing. ``slope_offset`` is the change of the latter on a slope, and ``hike`` that of the first three swing knots.
    """

    def scale_knots(knots: Array) -> Array:
        return _scale_knots(reference, knots)

    def interpolate(phase: Array, cycle: Array) -> Array:
        closed = np.append(cycle, cycle[0])
        return np.asarray(np.interp(phase, np.append(PHASE_GRID, 1.0), closed), dtype=np.float64)

    stance, swing = scale_knots(STANCE_KNOT_PHASES), scale_knots(SWING_KNOT_PHASES)
    first, second, min_third = scale * np.array(SWING_HIP_HEIGHTS) + interpolate(swing[:3], slope_offset)
    contact_height = interpolate(swing[2:], swing_contact)
    late = contact_height + np.array(SWING_CLEARANCES)
    late[0] = max(late[0], min_third)
    first, second, late[0] = np.array([first, second, late[0]]) + hike
    late[1] += 0.5 * hike[2]  # halfway down to the heel strike
    phases = np.concatenate([[swing[-1] - 1.0], stance, swing])
    heights = np.concatenate(
        [[late[-1]], interpolate(stance, stance_contact) + STANCE_CLEARANCE, [first, second], late]
    )
    return CubicSpline(phases, heights, bc_type="periodic")
