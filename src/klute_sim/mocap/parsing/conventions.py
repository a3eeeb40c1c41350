"""Signs, zeros and units that nobody wrote down, from what all walking has in common.

Each rule is one sentence; it decides only where the data are clear, and is told in the report. What the user says
in ``--map`` goes before all of them.
"""

from collections.abc import Sequence

import numpy as np

from klute_sim.gait.contacts import Contact
from klute_sim.mocap.parsing import channel_names
from klute_sim.recording.recording import Array

SIGN_RULES = {
    "knee_angle": "the knee's largest swing away from its median is flexion",
    "hip_angle": "the hip is more flexed at heel strike than at toe-off",
    "thigh_angle": "the thigh's upper end is further back at heel strike than at toe-off",
    "shank_angle": "the shank leans further forward at toe-off than at heel strike",
    "ankle_angle": "the ankle plantarflexes from late stance to just after toe-off",
    channel_names.ANKLE_MOMENT: "the ankle's mean moment in stance is the plantarflexors'",
    channel_names.GRF_FORWARD: "the ground brakes first, then pushes forward",
}
"""Channel -> what its sign is decided by."""
MIN_SIGN_EVIDENCE = 0.15
"""Least difference, over the channel's range, that decides a sign."""


def detect_sign(channel: str, time: Array, values: Array, contacts: Sequence[Contact]) -> int | None:
    """The sign that ``values`` of ``channel`` need, None where it is not clear."""
    evidence = _compute_sign_evidence(channel, time, values, contacts)
    spread = float(np.nanmax(values) - np.nanmin(values)) if np.isfinite(values).any() else 0.0
    if evidence is None or spread == 0.0 or not abs(evidence) > MIN_SIGN_EVIDENCE * spread:
        return None
    return 1 if evidence > 0.0 else -1


def _compute_sign_evidence(channel: str, time: Array, values: Array, contacts: Sequence[Contact]) -> float | None:
    """Positive where the sign is right; in the channel's unit."""
    if channel == "knee_angle":
        middle = float(np.nanmedian(values))
        return float((np.nanmax(values) - middle) - (middle - np.nanmin(values)))
    whole = [c for c in contacts if c.has_foot_strike and c.has_toe_off]
    if not whole:
        return None
    if channel in ("hip_angle", "thigh_angle", "shank_angle"):
        change = _average(
            [_interpolate(time, values, c.foot_strike) - _interpolate(time, values, c.toe_off) for c in whole]
        )
        return change if channel == "hip_angle" else -change
    if channel == "ankle_angle":
        late = [
            _average_between(time, values, c, 0.6, 0.85) - _average_between(time, values, c, 1.0, 1.1) for c in whole
        ]
        return _average(late)
    if channel == channel_names.ANKLE_MOMENT:
        return _average([_average_between(time, values, c, 0.3, 0.9) for c in whole])
    if channel == channel_names.GRF_FORWARD:
        return _average(
            [_average_between(time, values, c, 0.6, 1.0) - _average_between(time, values, c, 0.0, 0.4) for c in whole]
        )
    return None


def _interpolate(time: Array, values: Array, at_time: float) -> float:
    return float(np.interp(at_time, time, values)) if time[0] <= at_time <= time[-1] else float("nan")


def _average_between(time: Array, values: Array, contact: Contact, start: float, end: float) -> float:
    """Mean of ``values`` between the shares ``low`` and ``high`` of a contact's duration."""
    span = contact.toe_off - contact.foot_strike
    inside = (time >= contact.foot_strike + start * span) & (time <= contact.foot_strike + end * span)
    return float(np.mean(values[inside])) if inside.any() else float("nan")


def _average(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else 0.0


def round_to_right_angle(values: Array) -> float:
    """The multiple of 90 degrees that the ankle's median is nearest to: some take the angle of foot to shank."""
    return 90.0 * round(float(np.nanmedian(values)) / 90.0)


def estimate_flat_foot_pitch(time: Array, pitch: Array, contacts: Sequence[Contact]) -> float | None:
    """Median pitch [deg] of the foot between a quarter and a half of stance, where it is flat; None without stance."""
    found = []
    for contact in contacts:
        if contact.has_foot_strike and contact.has_toe_off:
            span = contact.toe_off - contact.foot_strike
            inside = (time >= contact.foot_strike + 0.25 * span) & (time <= contact.foot_strike + 0.5 * span)
            found.append(pitch[inside & np.isfinite(pitch)])
    known = np.concatenate(found) if found else np.empty(0)
    return float(np.median(known)) if len(known) else None


def detect_angle_unit(values: Array) -> str:
    """``rad`` or ``deg``: no joint moves less than 7 degrees or more than 3 radians in walking."""
    return "rad" if float(np.nanmax(values) - np.nanmin(values)) < 3.2 else "deg"


def detect_clipping(values: Array) -> tuple[float, float] | None:
    """(bound, share of samples at it) where an angle stands at its own extreme far longer than a swing would.

    Within 0.6 % of its range of one end a sine is for 5 % of the time; more than 12 % is no movement.
    """
    known = values[np.isfinite(values)]
    spread = float(np.ptp(known)) if len(known) else 0.0
    for bound in (float(known.min()), float(known.max())) if spread > 0.0 else ():
        share = float(np.mean(np.abs(known - bound) < 0.006 * spread))
        if share > 0.12:
            return bound, share
    return None
