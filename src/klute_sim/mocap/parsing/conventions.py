"""Detection of undocumented signs, zeros and units from properties that all walking shares.

A rule decides only where the data are clear, and the log states the rule. Entries of ``--map`` take precedence.
"""

from collections.abc import Sequence

import numpy as np

from klute_sim.gait.contacts import Contact
from klute_sim.mocap.parsing import channel_names
from klute_sim.types import Array

SIGN_RULES = {
    "knee_angle": "the knee's largest excursion from its median is flexion",
    "hip_angle": "the hip is more flexed at heel strike than at toe-off",
    "thigh_angle": "the thigh's upper end is further back at heel strike than at toe-off",
    "shank_angle": "the shank leans further forward at toe-off than at heel strike",
    "ankle_angle": "the ankle plantarflexes from late stance to just after toe-off",
    channel_names.ANKLE_MOMENT: "the ankle's mean moment in stance is plantarflexor",
    channel_names.GRF_FORWARD: "the ground brakes first, then pushes forward",
}
"""Channel -> rule that determines its sign."""
MIN_SIGN_EVIDENCE = 0.15
"""Smallest evidence, as a fraction of the channel's range, that determines a sign."""


def detect_sign(channel: str, time: Array, values: Array, contacts: Sequence[Contact]) -> int | None:
    """Return the factor (1 or -1) that gives ``values`` of ``channel`` the standard sign; None if it is unclear."""
    evidence = _compute_sign_evidence(channel, time, values, contacts)
    value_range = float(np.nanmax(values) - np.nanmin(values)) if np.isfinite(values).any() else 0.0
    if evidence is None or value_range == 0.0 or not abs(evidence) > MIN_SIGN_EVIDENCE * value_range:
        return None
    return 1 if evidence > 0.0 else -1


def _compute_sign_evidence(channel: str, time: Array, values: Array, contacts: Sequence[Contact]) -> float | None:
    """Return a measure in the channel's unit that is positive for the standard sign."""
    if channel == "knee_angle":
        median = float(np.nanmedian(values))
        return float((np.nanmax(values) - median) - (median - np.nanmin(values)))
    stances = [c for c in contacts if c.has_foot_strike and c.has_toe_off]
    if not stances:
        return None
    if channel in ("hip_angle", "thigh_angle", "shank_angle"):
        change = _average(
            [_interpolate(time, values, c.foot_strike) - _interpolate(time, values, c.toe_off) for c in stances]
        )
        return change if channel == "hip_angle" else -change
    if channel == "ankle_angle":
        return _average_difference(time, values, stances, (0.6, 0.85), (1.0, 1.1))
    if channel == channel_names.ANKLE_MOMENT:
        return _average([_average_between(time, values, c, 0.3, 0.9) for c in stances])
    if channel == channel_names.GRF_FORWARD:
        return _average_difference(time, values, stances, (0.6, 1.0), (0.0, 0.4))
    return None


def _average_difference(
    time: Array,
    values: Array,
    stances: Sequence[Contact],
    interval: tuple[float, float],
    other: tuple[float, float],
) -> float:
    """Return the mean in ``interval`` minus the mean in ``other``, both fractions of stance, averaged over stances."""
    return _average(
        [_average_between(time, values, c, *interval) - _average_between(time, values, c, *other) for c in stances]
    )


def _interpolate(time: Array, values: Array, at_time: float) -> float:
    return float(np.interp(at_time, time, values)) if time[0] <= at_time <= time[-1] else float("nan")


def _average_between(time: Array, values: Array, contact: Contact, start: float, end: float) -> float:
    """Return the mean of ``values`` between the fractions ``start`` and ``end`` of the contact's duration."""
    duration = contact.toe_off - contact.foot_strike
    inside = (time >= contact.foot_strike + start * duration) & (time <= contact.foot_strike + end * duration)
    return float(np.mean(values[inside])) if inside.any() else float("nan")


def _average(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else 0.0


def round_to_right_angle(values: Array) -> float:
    """Return the multiple of 90 degrees nearest to the median of an ankle angle ``values`` [deg].

    Some programs measure the angle between foot and shank, which is 90 degrees in standing.
    """
    return 90.0 * round(float(np.nanmedian(values)) / 90.0)


def estimate_flat_foot_pitch(time: Array, pitch: Array, contacts: Sequence[Contact]) -> float | None:
    """Return the median foot pitch [deg] from 25 to 50 % of stance, where the foot is flat; None without a stance."""
    samples = []
    for contact in contacts:
        if contact.has_foot_strike and contact.has_toe_off:
            duration = contact.toe_off - contact.foot_strike
            inside = (time >= contact.foot_strike + 0.25 * duration) & (time <= contact.foot_strike + 0.5 * duration)
            samples.append(pitch[inside & np.isfinite(pitch)])
    known = np.concatenate(samples) if samples else np.empty(0)
    return float(np.median(known)) if len(known) else None


def detect_angle_unit(joint_angles: Sequence[Array]) -> str:
    """Return ``rad`` or ``deg``, the unit of ``joint_angles``, by the one with the widest range.

    In walking every joint moves by more than 7 degrees and less than 3 radians; the pelvis may tilt by less.
    """
    return "rad" if max(float(np.nanmax(angle) - np.nanmin(angle)) for angle in joint_angles) < 3.2 else "deg"


def detect_clipping(values: Array) -> tuple[float, float] | None:
    """Return (bound, fraction of samples at it) if an angle stays at an extreme for too long to be a movement.

    A sine is within 0.6 % of its range of one extreme for 5 % of the time; the limit is 12 %.
    """
    known = values[np.isfinite(values)]
    value_range = float(np.ptp(known)) if len(known) else 0.0
    for bound in (float(known.min()), float(known.max())) if value_range > 0.0 else ():
        fraction = float(np.mean(np.abs(known - bound) < 0.006 * value_range))
        if fraction > 0.12:
            return bound, fraction
    return None
