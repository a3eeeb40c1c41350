"""What the rig prescribes: the residual limb's motion and the load, from a reference.

The reference gives joint angles and ground reaction but neither the hip's height nor its speed. Both follow
from the sole: the hip is where the reference foot just touches the ground, and moves as fast as that foot
rolls without slipping.

Angles lean forward when positive: ``thigh = knee - shank`` is turned into the hinge angle of the model, about
+y; the foot's pitch is ``shank - dorsiflexion``.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from klute_sim.gait.reference import GRAVITY, Reference
from klute_sim.recording.recording import Array

PHASE_GRID = np.arange(400) / 400.0
"""Phases at which the sole's contact is worked out."""

STANCE_KNOT_PHASES = np.array(
    [0.05, 0.09, 0.13, 0.17, 0.21, 0.26, 0.31, 0.36, 0.41, 0.46, 0.50, 0.54, 0.57, 0.60, 0.63]
)
"""Phases at which the hip height is that of contact, for a reference that lifts off at :data:`KNOTS_LIFT`.

Where they end, the foot leaves the ground, whatever the ankle does: with 0.59 as the last, net moment is zero from 60 %
on, and that alone is 0.35 standard deviations from the reference."""
SWING_KNOT_PHASES = np.array([0.70, 0.80, 0.88, 0.94, 1.0])
KNOT_TOE_OFF_PHASE = 0.633
STANCE_CLEARANCE = 0.5e-3
"""Hip above contact height in stance [m]; the load presses the foot down."""
SWING_HIP_HEIGHTS = (0.898, 0.908, 0.905)
"""Hip height at the first swing knots [m] (the third is a least height), for legs of 0.43 + 0.43 m."""
SWING_CLEARANCES = (12e-3, 9e-3, 5e-3)
"""Hip above contact height at the last three knots [m]; the last one sets first contact."""
MAX_PASSIVE_DORSIFLEXION_DEG = 1.0
"""Most dorsiflexion in swing [deg] that is counted on: a passive ankle does not lift its toe, many people do."""
MIN_TOE_CLEARANCE = 4e-3
"""Of such a foot in swing [m], for legs of 0.43 + 0.43 m; below it the hip is hiked (assumed). The package's own
reference needs no hiking."""
CLEARANCE_PHASES = (0.68, 0.97)
"""Phases between which, for a reference that lifts off at :data:`KNOTS_LIFT`, it has to clear the ground."""
N_SPEED_HARMONICS = 6
"""Fourier terms kept of the hip's forward speed."""


@dataclass(frozen=True)
class LegGeometry:
    """Lengths that turn angles into positions, and the sole's contact points."""

    thigh: float
    """Hip to knee [m]."""
    shank: float
    """Knee to ankle [m]."""
    sole: Array
    """(n, 3): x, z and radius of the sole's spheres in the foot's frame [m]."""
    scale: float
    """Over the legs of 0.43 + 0.43 m [1]."""

    def compute_ankle_height(self, pitch: Array) -> Array:
        """Height [m] of the ankle axis above flat ground when a foot at ``pitch`` [rad] just touches it."""
        x, z, radius = self.sole.T
        lowest = -np.sin(pitch)[:, None] * x + np.cos(pitch)[:, None] * z - radius
        return np.asarray(-lowest.min(axis=1), dtype=np.float64)


@dataclass(frozen=True)
class HipTrajectory:
    """One stride of prescribed motion as functions of phase; multiply a derivative by 1/stride_time per order."""

    stride_time: float
    """[s]"""
    speed: float
    """Mean forward speed [m/s]."""
    height: CubicSpline
    """Hip height [m]."""
    velocity: CubicSpline
    """Hip forward speed [m/s]."""
    travel: PPoly
    """Integral of ``velocity`` over phase: hip forward position over stride time [m/s]."""

    @property
    def stride_length(self) -> float:
        """Distance the hip covers in one stride [m]."""
        return float(self.travel(1.0)) * self.stride_time


def compute_thigh_angle(reference: Reference, phase: Array, derivative: int = 0) -> Array:
    """Thigh hinge angle [rad], or its derivative by phase."""
    shank = reference("shank_forward_deg", phase, derivative)
    return np.radians(shank - reference("knee_flexion_deg", phase, derivative))


def compute_knee_angle(reference: Reference, phase: Array, derivative: int = 0) -> Array:
    """Knee hinge angle [rad], flexion positive, or its derivative by phase."""
    return np.radians(reference("knee_flexion_deg", phase, derivative))


def plan_hip_trajectory(
    reference: Reference, leg: LegGeometry, stride_time: float, speed: float | None = None, slope: float = 0.0
) -> HipTrajectory:
    """Motion of the hip that walks ``reference`` with ``leg``, in the frame of the ground.

    The reference's angles and the leg fix how far the hip travels per stride. ``stride_time`` [s] then implies
    the speed; a chosen ``speed`` [m/s] scales the stride time instead. ``reference`` is that of the ``slope`` [rad]
    already (:meth:`Reference.on_slope`). A prosthesis does not lift its toe: in swing the hip is raised to where a foot
    with the ankle as on the level clears the ground as it does there (assumed: people hike the hip), and to where one
    that is not lifted clears level ground.
    """
    thigh = compute_thigh_angle(reference, PHASE_GRID)
    shank = thigh + compute_knee_angle(reference, PHASE_GRID)
    pitch = shank - np.radians(reference("ankle_dorsiflexion_deg", PHASE_GRID))
    ankle = leg.compute_ankle_height(pitch)
    above = leg.shank * np.cos(shank) + leg.thigh * np.cos(thigh)
    contact, swinging = ankle + above, leg.compute_ankle_height(pitch + slope) + above
    level = ankle + leg.shank * np.cos(shank - slope) + leg.thigh * np.cos(thigh - slope)

    lowered = np.minimum(
        shank - pitch - slope, math.radians(MAX_PASSIVE_DORSIFLEXION_DEG)
    )  # on the level, as hiking is worked out there
    hike = _compute_hip_hike(
        reference, level, level - ankle + leg.compute_ankle_height(shank - slope - lowered), leg.scale
    )

    # Forward speed per cycle [m]: the ankle moves as the foot rolls, the hip as the leg swings over it.
    behind = -leg.thigh * np.sin(thigh) - leg.shank * np.sin(shank)
    rolling = -_differentiate_by_phase(behind) + _differentiate_by_phase(pitch) * ankle
    per_cycle = _blend_leg_speeds(reference, rolling, leg.scale)
    if speed is not None:
        stride_time = float(per_cycle.mean()) / speed
    forward = _fit_periodic_spline(per_cycle / stride_time)
    return HipTrajectory(
        stride_time=stride_time,
        speed=float(per_cycle.mean()) / stride_time,
        height=_fit_hip_height(reference, contact, swinging, swinging - level, leg.scale, hike),
        velocity=forward,
        travel=forward.antiderivative(),
    )


def _differentiate_by_phase(values: Array) -> Array:
    return np.asarray((np.roll(values, -1) - np.roll(values, 1)) * (len(values) / 2.0))


def _fit_periodic_spline(values: Array) -> CubicSpline:
    return CubicSpline(np.append(PHASE_GRID, 1.0), np.append(values, values[0]), bc_type="periodic")


def _blend_leg_speeds(reference: Reference, rolling: Array, scale: float) -> Array:
    """Hip travel per cycle [m]: each leg's rolling speed, weighted with the load it carries, smoothed."""
    low, high = 0.55 * scale, 2.2 * scale  # outside of these a foot is about to leave or meet the ground
    load = np.maximum(reference("grf_vertical_n_per_kg", PHASE_GRID), 0.0)
    speed = np.clip(rolling, low, high)
    half = len(PHASE_GRID) // 2
    other_load, other_speed = np.roll(load, half), np.roll(speed, half)
    blended = (load * speed + other_load * other_speed) / (load + other_load)
    spectrum = np.fft.rfft(blended)
    spectrum[N_SPEED_HARMONICS + 1 :] = 0.0
    return np.asarray(np.fft.irfft(spectrum, len(PHASE_GRID)))


def _scale_knots(reference: Reference, knots: Array) -> Array:
    """Phases of a reference that lifts off at :data:`KNOTS_LIFT` -> of ``reference``."""
    return np.asarray(
        np.interp(knots, [0.0, KNOT_TOE_OFF_PHASE, 1.0], [0.0, reference.find_toe_off_phase(), 1.0]), dtype=np.float64
    )


def _compute_hip_hike(reference: Reference, level_height: Array, passive_height: Array, scale: float) -> Array:
    """What the first three swing knots are raised by [m], so that a foot that is not lifted clears level ground.

    ``level`` and ``unlifted`` are the hip's heights [m] at which the reference's foot and that one touch it.
    """
    hike = np.zeros(3)
    knots = _scale_knots(reference, SWING_KNOT_PHASES[:3])
    low, high = _scale_knots(reference, np.array(CLEARANCE_PHASES))
    nearest = np.abs(np.subtract.outer(PHASE_GRID, knots)).argmin(axis=1)
    for _ in range(8):
        path = _fit_hip_height(reference, level_height, level_height, np.zeros(len(PHASE_GRID)), scale, hike)
        lacking = np.where(
            (low <= PHASE_GRID) & (high >= PHASE_GRID),
            MIN_TOE_CLEARANCE * scale - (path(PHASE_GRID) - passive_height),
            0.0,
        )
        if lacking.max() <= 1e-4:
            break
        for knot in range(3):
            hike[knot] += max(0.0, float(lacking[nearest == knot].max()))
    return hike


def _fit_hip_height(
    reference: Reference, stance_contact: Array, swing_contact: Array, slope_offset: Array, scale: float, hike: Array
) -> CubicSpline:
    """One periodic spline: contact height through stance, high enough to clear the toe in swing.

    ``contact`` is the height [m] at which the stance foot touches, ``swinging`` that of the swing foot, ``raised``
    what a slope adds to the latter, and ``hike`` what the first three swing knots are raised by.
    """

    def moved(knots: Array) -> Array:
        return _scale_knots(reference, knots)

    def at(phase: Array, cycle: Array) -> Array:
        closed = np.append(cycle, cycle[0])
        return np.asarray(np.interp(phase, np.append(PHASE_GRID, 1.0), closed), dtype=np.float64)

    stance, swing = moved(STANCE_KNOT_PHASES), moved(SWING_KNOT_PHASES)
    first, second, least = scale * np.array(SWING_HIP_HEIGHTS) + at(swing[:3], slope_offset)
    touch = at(swing[2:], swing_contact)
    late = touch + np.array(SWING_CLEARANCES)
    late[0] = max(late[0], least)
    first, second, late[0] = np.array([first, second, late[0]]) + hike
    phases = np.concatenate([[swing[-1] - 1.0], stance, swing])
    heights = np.concatenate([[late[-1]], at(stance, stance_contact) + STANCE_CLEARANCE, [first, second], late])
    return CubicSpline(phases, heights, bc_type="periodic")


def compute_vertical_feedforward(
    reference: Reference,
    trajectory: HipTrajectory,
    moving_mass: float,
    body_mass: float,
    phase: Array,
    slope: float = 0.0,
) -> Array:
    """Force on the carriage [N], normal to the ground, that leaves the reference's load on the foot.

    ``m (g cos(slope) + z'') - GRF``: ``moved`` [kg] is the rig's moving mass, ``body`` [kg] the mass whose reference
    load is applied, ``slope`` [rad] the ground's. Without ``m z''`` the first contact is a spike of 1.5 body weights.
    """
    lift = np.asarray(trajectory.height(phase, 2)) / trajectory.stride_time**2
    return moving_mass * (GRAVITY * math.cos(slope) + lift) - body_mass * reference("grf_vertical_n_per_kg", phase)


def compute_forward_feedforward(
    reference: Reference,
    trajectory: HipTrajectory,
    moving_mass: float,
    body_mass: float,
    phase: Array,
    slope: float = 0.0,
) -> Array:
    """Force on the carriage [N] that leaves the reference's fore-aft load: ``m (g sin(slope) + x'') - GRF``."""
    push = np.asarray(trajectory.velocity(phase, 1)) / trajectory.stride_time
    return moving_mass * (GRAVITY * math.sin(slope) + push) - body_mass * reference("grf_forward_n_per_kg", phase)
