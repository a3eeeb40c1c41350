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

from klute_sim.recording.recording import Samples
from klute_sim.rigs.gait.reference import GRAVITY, Reference

GRID = np.arange(400) / 400.0
"""Phases at which the sole's contact is worked out."""

STANCE_KNOTS = np.array([0.05, 0.09, 0.13, 0.17, 0.21, 0.26, 0.31, 0.36, 0.41, 0.46, 0.50, 0.54, 0.57, 0.60, 0.63])
"""Phases at which the hip height is that of contact, for a reference that lifts off at :data:`KNOTS_LIFT`.

Where they end, the foot leaves the ground, whatever the ankle does: with 0.59 as the last, net moment is zero from 60 %
on, and that alone is 0.35 standard deviations from the reference."""
SWING_KNOTS = np.array([0.70, 0.80, 0.88, 0.94, 1.0])
KNOTS_LIFT = 0.633
STANCE_CLEARANCE = 0.5e-3
"""Hip above contact height in stance [m]; the load presses the foot down."""
SWING_HEIGHTS = (0.898, 0.908, 0.905)
"""Hip height at the first swing knots [m] (the third is a least height), for legs of 0.43 + 0.43 m."""
SWING_CLEARANCES = (12e-3, 9e-3, 5e-3)
"""Hip above contact height at the last three knots [m]; the last one sets first contact."""
UNLIFTED = 1.0
"""Most dorsiflexion in swing [deg] that is counted on: a passive ankle does not lift its toe, many people do."""
LEAST_CLEARANCE = 4e-3
"""Of such a foot in swing [m], for legs of 0.43 + 0.43 m; below it the hip is hiked (assumed). The package's own
reference needs no hiking."""
CLEARED = (0.68, 0.97)
"""Phases between which, for a reference that lifts off at :data:`KNOTS_LIFT`, it has to clear the ground."""
SPEED_HARMONICS = 6
"""Fourier terms kept of the hip's forward speed."""


@dataclass(frozen=True)
class Leg:
    """Lengths that turn angles into positions, and the sole's contact points."""

    thigh: float
    """Hip to knee [m]."""
    shank: float
    """Knee to ankle [m]."""
    sole: Samples
    """(n, 3): x, z and radius of the sole's spheres in the foot's frame [m]."""
    scale: float
    """Over the legs of 0.43 + 0.43 m [1]."""

    def ankle_height(self, pitch: Samples) -> Samples:
        """Height [m] of the ankle axis above flat ground when a foot at ``pitch`` [rad] just touches it."""
        x, z, radius = self.sole.T
        lowest = -np.sin(pitch)[:, None] * x + np.cos(pitch)[:, None] * z - radius
        return np.asarray(-lowest.min(axis=1), dtype=np.float64)


@dataclass(frozen=True)
class Motion:
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


def thigh_angle(reference: Reference, phase: Samples, order: int = 0) -> Samples:
    """Thigh hinge angle [rad], or its derivative by phase."""
    shank = reference("shank_forward_deg", phase, order)
    return np.radians(shank - reference("knee_flexion_deg", phase, order))


def knee_angle(reference: Reference, phase: Samples, order: int = 0) -> Samples:
    """Knee hinge angle [rad], flexion positive, or its derivative by phase."""
    return np.radians(reference("knee_flexion_deg", phase, order))


def plan(reference: Reference, leg: Leg, stride_time: float, speed: float | None = None, slope: float = 0.0) -> Motion:
    """Motion of the hip that walks ``reference`` with ``leg``, in the frame of the ground.

    The reference's angles and the leg fix how far the hip travels per stride. ``stride_time`` [s] then implies
    the speed; a chosen ``speed`` [m/s] scales the stride time instead. ``reference`` is that of the ``slope`` [rad]
    already (:meth:`Reference.on_slope`). A prosthesis does not lift its toe: in swing the hip is raised to where a foot
    with the ankle as on the level clears the ground as it does there (assumed: people hike the hip), and to where one
    that is not lifted clears level ground.
    """
    thigh = thigh_angle(reference, GRID)
    shank = thigh + knee_angle(reference, GRID)
    pitch = shank - np.radians(reference("ankle_dorsiflexion_deg", GRID))
    ankle = leg.ankle_height(pitch)
    above = leg.shank * np.cos(shank) + leg.thigh * np.cos(thigh)
    contact, swinging = ankle + above, leg.ankle_height(pitch + slope) + above
    level = ankle + leg.shank * np.cos(shank - slope) + leg.thigh * np.cos(thigh - slope)

    lowered = np.minimum(shank - pitch - slope, math.radians(UNLIFTED))  # on the level, as hiking is worked out there
    hike = _hike(reference, level, level - ankle + leg.ankle_height(shank - slope - lowered), leg.scale)

    # Forward speed per cycle [m]: the ankle moves as the foot rolls, the hip as the leg swings over it.
    behind = -leg.thigh * np.sin(thigh) - leg.shank * np.sin(shank)
    rolling = -_by_phase(behind) + _by_phase(pitch) * ankle
    per_cycle = _blend_legs(reference, rolling, leg.scale)
    if speed is not None:
        stride_time = float(per_cycle.mean()) / speed
    forward = _closed_spline(per_cycle / stride_time)
    return Motion(
        stride_time=stride_time,
        speed=float(per_cycle.mean()) / stride_time,
        height=_hip_height(reference, contact, swinging, swinging - level, leg.scale, hike),
        velocity=forward,
        travel=forward.antiderivative(),
    )


def _by_phase(values: Samples) -> Samples:
    return np.asarray((np.roll(values, -1) - np.roll(values, 1)) * (len(values) / 2.0))


def _closed_spline(values: Samples) -> CubicSpline:
    return CubicSpline(np.append(GRID, 1.0), np.append(values, values[0]), bc_type="periodic")


def _blend_legs(reference: Reference, rolling: Samples, scale: float) -> Samples:
    """Hip travel per cycle [m]: each leg's rolling speed, weighted with the load it carries, smoothed."""
    low, high = 0.55 * scale, 2.2 * scale  # outside of these a foot is about to leave or meet the ground
    load = np.maximum(reference("grf_vertical_n_per_kg", GRID), 0.0)
    speed = np.clip(rolling, low, high)
    half = len(GRID) // 2
    other_load, other_speed = np.roll(load, half), np.roll(speed, half)
    blended = (load * speed + other_load * other_speed) / (load + other_load)
    spectrum = np.fft.rfft(blended)
    spectrum[SPEED_HARMONICS + 1 :] = 0.0
    return np.asarray(np.fft.irfft(spectrum, len(GRID)))


def _moved(reference: Reference, knots: Samples) -> Samples:
    """Phases of a reference that lifts off at :data:`KNOTS_LIFT` -> of ``reference``."""
    return np.asarray(np.interp(knots, [0.0, KNOTS_LIFT, 1.0], [0.0, reference.stance_end(), 1.0]), dtype=np.float64)


def _hike(reference: Reference, level: Samples, unlifted: Samples, scale: float) -> Samples:
    """What the first three swing knots are raised by [m], so that a foot that is not lifted clears level ground.

    ``level`` and ``unlifted`` are the hip's heights [m] at which the reference's foot and that one touch it.
    """
    hike = np.zeros(3)
    knots = _moved(reference, SWING_KNOTS[:3])
    low, high = _moved(reference, np.array(CLEARED))
    nearest = np.abs(np.subtract.outer(GRID, knots)).argmin(axis=1)
    for _ in range(8):
        path = _hip_height(reference, level, level, np.zeros(len(GRID)), scale, hike)
        lacking = np.where((low <= GRID) & (high >= GRID), LEAST_CLEARANCE * scale - (path(GRID) - unlifted), 0.0)
        if lacking.max() <= 1e-4:
            break
        for knot in range(3):
            hike[knot] += max(0.0, float(lacking[nearest == knot].max()))
    return hike


def _hip_height(
    reference: Reference, contact: Samples, swinging: Samples, raised: Samples, scale: float, hike: Samples
) -> CubicSpline:
    """One periodic spline: contact height through stance, high enough to clear the toe in swing.

    ``contact`` is the height [m] at which the stance foot touches, ``swinging`` that of the swing foot, ``raised``
    what a slope adds to the latter, and ``hike`` what the first three swing knots are raised by.
    """

    def moved(knots: Samples) -> Samples:
        return _moved(reference, knots)

    def at(phase: Samples, cycle: Samples) -> Samples:
        closed = np.append(cycle, cycle[0])
        return np.asarray(np.interp(phase, np.append(GRID, 1.0), closed), dtype=np.float64)

    stance, swing = moved(STANCE_KNOTS), moved(SWING_KNOTS)
    first, second, least = scale * np.array(SWING_HEIGHTS) + at(swing[:3], raised)
    touch = at(swing[2:], swinging)
    late = touch + np.array(SWING_CLEARANCES)
    late[0] = max(late[0], least)
    first, second, late[0] = np.array([first, second, late[0]]) + hike
    phases = np.concatenate([[swing[-1] - 1.0], stance, swing])
    heights = np.concatenate([[late[-1]], at(stance, contact) + STANCE_CLEARANCE, [first, second], late])
    return CubicSpline(phases, heights, bc_type="periodic")


def vertical_feedforward(
    reference: Reference, motion: Motion, moved: float, body: float, phase: Samples, slope: float = 0.0
) -> Samples:
    """Force on the carriage [N], normal to the ground, that leaves the reference's load on the foot.

    ``m (g cos(slope) + z'') - GRF``: ``moved`` [kg] is the rig's moving mass, ``body`` [kg] the mass whose reference
    load is applied, ``slope`` [rad] the ground's. Without ``m z''`` the first contact is a spike of 1.5 body weights.
    """
    lift = np.asarray(motion.height(phase, 2)) / motion.stride_time**2
    return moved * (GRAVITY * math.cos(slope) + lift) - body * reference("grf_vertical_n_per_kg", phase)


def forward_feedforward(
    reference: Reference, motion: Motion, moved: float, body: float, phase: Samples, slope: float = 0.0
) -> Samples:
    """Force on the carriage [N] that leaves the reference's fore-aft load: ``m (g sin(slope) + x'') - GRF``."""
    push = np.asarray(motion.velocity(phase, 1)) / motion.stride_time
    return moved * (GRAVITY * math.sin(slope) + push) - body * reference("grf_forward_n_per_kg", phase)
