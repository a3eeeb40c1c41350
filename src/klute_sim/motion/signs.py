"""Signs, zeros and units that nobody wrote down, from what all walking has in common.

Each rule is one sentence; it decides only where the data are clear, and is told in the report. What the user says
in ``--map`` goes before all of them.
"""

from collections.abc import Sequence

import numpy as np

from klute_sim.dataset.events import Contact
from klute_sim.motion import names
from klute_sim.recording.recording import Samples

RULES = {
    "knee_angle": "the knee's largest swing away from its median is flexion",
    "hip_angle": "the hip is more flexed at heel strike than at toe-off",
    "thigh_angle": "the thigh's upper end is further back at heel strike than at toe-off",
    "shank_angle": "the shank leans further forward at toe-off than at heel strike",
    "ankle_angle": "the ankle plantarflexes from late stance to just after toe-off",
    names.MOMENT: "the ankle's mean moment in stance is the plantarflexors'",
    names.FORWARD: "the ground brakes first, then pushes forward",
}
"""Channel -> what its sign is decided by."""
CLEAR = 0.15
"""Least difference, over the channel's range, that decides a sign."""


def detected(channel: str, time: Samples, values: Samples, contacts: Sequence[Contact]) -> int | None:
    """The sign that ``values`` of ``channel`` need, None where it is not clear."""
    evidence = _evidence(channel, time, values, contacts)
    spread = float(np.nanmax(values) - np.nanmin(values)) if np.isfinite(values).any() else 0.0
    if evidence is None or spread == 0.0 or not abs(evidence) > CLEAR * spread:
        return None
    return 1 if evidence > 0.0 else -1


def _evidence(channel: str, time: Samples, values: Samples, contacts: Sequence[Contact]) -> float | None:
    """Positive where the sign is right; in the channel's unit."""
    if channel == "knee_angle":
        middle = float(np.nanmedian(values))
        return float((np.nanmax(values) - middle) - (middle - np.nanmin(values)))
    whole = [c for c in contacts if c.begun and c.ended]
    if not whole:
        return None
    if channel in ("hip_angle", "thigh_angle", "shank_angle"):
        change = _mean([_at(time, values, c.strike) - _at(time, values, c.lift) for c in whole])
        return change if channel == "hip_angle" else -change
    if channel == "ankle_angle":
        late = [_between(time, values, c, 0.6, 0.85) - _between(time, values, c, 1.0, 1.1) for c in whole]
        return _mean(late)
    if channel == names.MOMENT:
        return _mean([_between(time, values, c, 0.3, 0.9) for c in whole])
    if channel == names.FORWARD:
        return _mean([_between(time, values, c, 0.6, 1.0) - _between(time, values, c, 0.0, 0.4) for c in whole])
    return None


def _at(time: Samples, values: Samples, when: float) -> float:
    return float(np.interp(when, time, values)) if time[0] <= when <= time[-1] else float("nan")


def _between(time: Samples, values: Samples, contact: Contact, low: float, high: float) -> float:
    """Mean of ``values`` between the shares ``low`` and ``high`` of a contact's duration."""
    span = contact.lift - contact.strike
    inside = (time >= contact.strike + low * span) & (time <= contact.strike + high * span)
    return float(np.mean(values[inside])) if inside.any() else float("nan")


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else 0.0


def right_angle(values: Samples) -> float:
    """The multiple of 90 degrees that the ankle's median is nearest to: some take the angle of foot to shank."""
    return 90.0 * round(float(np.nanmedian(values)) / 90.0)


def flat_foot(time: Samples, pitch: Samples, contacts: Sequence[Contact]) -> float | None:
    """Median pitch [deg] of the foot between a quarter and a half of stance, where it is flat; None without stance."""
    found = []
    for contact in contacts:
        if contact.begun and contact.ended:
            span = contact.lift - contact.strike
            inside = (time >= contact.strike + 0.25 * span) & (time <= contact.strike + 0.5 * span)
            found.append(pitch[inside & np.isfinite(pitch)])
    known = np.concatenate(found) if found else np.empty(0)
    return float(np.median(known)) if len(known) else None


def angle_unit(values: Samples) -> str:
    """``rad`` or ``deg``: no joint moves less than 7 degrees or more than 3 radians in walking."""
    return "rad" if float(np.nanmax(values) - np.nanmin(values)) < 3.2 else "deg"


def clipped(values: Samples) -> tuple[float, float] | None:
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
