"""Strides of one foot from heel strike to heel strike, resampled to 0 to 100 % of their duration."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from klute_sim.gait.contacts import Contact
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics.leg import LEG_UNITS, Leg
from klute_sim.mocap.options import STRIDE_TIME_RANGE
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.recording.recording import Recording
from klute_sim.types import Array

PHASE_GRID = np.linspace(0.0, 1.0, 101)
"""Gait phases (0-1) of resampled strides."""
MIN_STRIDE_TIME, MAX_STRIDE_TIME = STRIDE_TIME_RANGE
"""Stride times [s] of walking."""
TOE_OFF_RANGE = (0.5, 0.8)
"""Gait phases of toe-off in walking; below a half in running."""
MAX_STRIDE_TIME_DEVIATION = 0.15
"""Largest relative deviation from the median stride time of a stride that counts."""
MAX_BELT_SPEED_DEVIATION = 0.05
"""Largest relative deviation from the median belt speed of a stride that counts; it excludes starts and stops."""
RECURRENCE_RANGE = (0.8, 1.25)
"""Search range for the end of a stride without a second heel strike, relative to stance time over
:data:`STANCE_FRACTION`."""
STANCE_FRACTION = 0.62
"""Typical fraction of a stride in stance."""
MAX_POSTURE_DIFFERENCE = 8.0
"""Largest rms difference of all angles [deg] between equal postures."""
RATE_WEIGHT = 0.1
"""Weight [s] of angular rates in the comparison of postures. On 42 treadmill strides the detected ends deviate from the
force plates by 0.4 ms (sd 9 ms) with rates, and by 14 ms (sd 27 ms) without."""
MAX_SEAM_FRACTION = 0.06
"""Longest interpolated gap, as a fraction of the stride, in a stride that is assembled from parts of two strides."""
POSTURE_CHANNELS = ("hip_angle", "knee_angle", "ankle_angle", "shank_angle")
"""Channels that define the posture of a leg."""


@dataclass(frozen=True, eq=False)
class Stride:
    """One stride of a leg."""

    trial: str
    """Name of the trial."""
    start: float
    """Time of heel strike [s]."""
    end: float
    """Time of the next heel strike [s]."""
    toe_off: float
    """Gait phase of toe-off (0-1)."""
    channels: dict[str, Array]
    """Channel -> samples at :data:`PHASE_GRID`."""

    @property
    def duration(self) -> float:
        """Stride time [s]."""
        return self.end - self.start


def segment_strides(leg: Leg, log: ImportLog) -> list[Stride]:
    """Return the strides of ``leg`` in which all channels are known, and log the exclusions.

    A stride ends at the next heel strike on a plate. If no stride has one, as on a short walkway, it ends when the
    posture of the first heel strike recurs. If the recording is too short for that, a stride is assembled from parts.
    """
    contacts = [c for c in leg.contacts if c.has_foot_strike and c.has_toe_off]
    ends = dict.fromkeys(contacts, float("nan"))
    ends |= {
        contact: following.foot_strike
        for contact, following in pairwise(leg.contacts)
        if contact in ends
        and following.has_foot_strike
        and following.foot_strike - contact.foot_strike <= MAX_STRIDE_TIME
    }
    candidates = [_extract_stride(leg, contact, end) for contact, end in ends.items()]
    if not any(candidates):
        candidates = [_extract_stride(leg, contact, _find_recurrence(leg, contact)) for contact in contacts]
        if any(candidates):
            log.add_derived(
                "End of a stride without a second heel strike on a plate: recurrence of the posture of the first heel "
                "strike"
            )
        else:
            candidates = [_assemble_stride(leg, log), *candidates]
    strides = [stride for stride in candidates if stride is not None]
    steady_strides = [stride for stride in strides if not _changes_belt_speed(leg, stride)]
    _log_exclusions(leg, contacts, strides, steady_strides, log)
    return steady_strides


def _log_exclusions(
    leg: Leg, contacts: Sequence[Contact], strides: Sequence[Stride], steady_strides: Sequence[Stride], log: ImportLog
) -> None:
    """Log which of the ``contacts`` did not become ``strides``, and which strides are not steady."""
    if len(steady_strides) < len(strides):
        start = steady_strides[0].start if steady_strides else leg.time[-1]
        log.add_exclusion(
            leg.side,
            f"{leg.trial}: the belt accelerates: {_format_stride_count(len(strides) - len(steady_strides))} of the "
            f"{leg.side} leg excluded; the first steady stride starts at {start:.2f} s",
        )
    if not contacts and not strides:
        log.add_exclusion(
            leg.side, f"{leg.trial}: the {leg.side} foot has no contact with both heel strike and toe-off on a plate"
        )
    elif len(contacts) - len(strides) > (1 if strides else 0):  # the last contact rarely has a complete stride
        starts = {stride.start for stride in strides}
        reason = _explain_exclusion(leg, next(c for c in contacts if c.foot_strike not in starts))
        log.add_exclusion(
            leg.side,
            f"{leg.trial}: {_format_stride_count(len(contacts) - len(strides))} of the {leg.side} leg incomplete and "
            f"excluded: {reason}",
        )


def _explain_exclusion(leg: Leg, contact: Contact) -> str:
    """Return why the stride that starts with ``contact`` is incomplete."""
    next_strike = next(
        (c.foot_strike for c in leg.contacts if c.has_foot_strike and c.foot_strike > contact.foot_strike), None
    )
    if next_strike is None or next_strike - contact.foot_strike > MAX_STRIDE_TIME:
        return (
            f"the heel strike after the one at {contact.foot_strike:.2f} s is on no plate, and the posture does not "
            f"recur before the recording ends at {leg.time[-1]:.2f} s"
        )
    inside = (leg.time >= contact.foot_strike) & (leg.time <= next_strike)
    gap = next((name for name, samples in leg.channels.items() if not np.isfinite(samples[inside]).all()), None)
    reason = f"{gap.replace('_', ' ')} has gaps" if gap else "stride time and toe-off are not those of walking"
    return f"{reason} between {contact.foot_strike:.2f} and {next_strike:.2f} s"


def _format_stride_count(count: int) -> str:
    return f"{count} stride{'' if count == 1 else 's'}"


def _extract_stride(leg: Leg, contact: Contact, end: float) -> Stride | None:
    """Return the stride from ``contact`` to ``end`` [s].

    Returns None if ``end`` is NaN, the timing is not that of walking, or a channel has gaps.
    """
    duration = end - contact.foot_strike
    toe_off = (contact.toe_off - contact.foot_strike) / duration
    if not MIN_STRIDE_TIME <= duration <= MAX_STRIDE_TIME or not TOE_OFF_RANGE[0] <= toe_off <= TOE_OFF_RANGE[1]:
        return None
    time = contact.foot_strike + duration * PHASE_GRID
    channels = {name: np.interp(time, leg.time, s, left=np.nan, right=np.nan) for name, s in leg.channels.items()}
    if not all(np.isfinite(samples).all() for samples in channels.values()):
        return None
    return Stride(leg.trial, contact.foot_strike, end, toe_off, channels)


def _find_recurrence(leg: Leg, contact: Contact) -> float:
    """Return the time [s] at which the posture of ``contact``'s heel strike recurs; NaN if it does not."""
    stance_time = contact.toe_off - contact.foot_strike
    low, high = (contact.foot_strike + factor * stance_time / STANCE_FRACTION for factor in RECURRENCE_RANGE)
    inside = (leg.time >= low) & (leg.time <= high)
    posture = [leg.channels[name] for name in POSTURE_CHANNELS if name in leg.channels]
    if inside.sum() < 3 or not posture:
        return float("nan")
    angle_error, rate_error = np.zeros(int(inside.sum())), np.zeros(int(inside.sum()))
    for samples in posture:
        angle_error += (samples[inside] - np.interp(contact.foot_strike, leg.time, samples)) ** 2
        rate = RATE_WEIGHT * np.gradient(samples, leg.time)
        rate_error += (rate[inside] - np.interp(contact.foot_strike, leg.time, rate)) ** 2
    if not np.isfinite(angle_error + rate_error).any():
        return float("nan")
    best = int(np.nanargmin(angle_error + rate_error))
    if best in (0, len(angle_error) - 1) or not np.sqrt(angle_error[best] / len(posture)) < MAX_POSTURE_DIFFERENCE:
        return float("nan")
    return float(leg.time[inside][best])


def _assemble_stride(leg: Leg, log: ImportLog) -> Stride | None:
    """Return a stride from the end of one stride and the beginning of the next; None if too much is missing."""
    foot_strikes = [contact.foot_strike for contact in leg.contacts if contact.has_foot_strike]
    contacts = [contact for contact in leg.contacts if contact.has_foot_strike and contact.has_toe_off]
    known = np.isfinite(np.sum([leg.channels[name] for name in leg.channels], axis=0))
    for first, second in pairwise(foot_strikes):
        duration = second - first
        if not MIN_STRIDE_TIME <= duration <= MAX_STRIDE_TIME or not contacts or not known.any():
            continue
        inside = known & (leg.time > leg.time[known][-1] - duration)
        phase = ((leg.time[inside] - first) / duration) % 1.0
        order = np.argsort(phase)
        gaps = np.diff(np.append(phase[order], phase[order][0] + 1.0))
        toe_off = (contacts[0].toe_off - contacts[0].foot_strike) / duration
        if gaps.max() > MAX_SEAM_FRACTION or not TOE_OFF_RANGE[0] <= toe_off <= TOE_OFF_RANGE[1]:
            continue
        channels = {
            name: np.interp(PHASE_GRID, phase[order], samples[inside][order], period=1.0)
            for name, samples in leg.channels.items()
        }
        log.add_warning(
            f"{leg.trial}: no stride of the {leg.side} leg is complete; one was assembled from the end of one stride "
            f"and the beginning of the next, with {100 * gaps.max():.1f} % of it interpolated"
        )
        return Stride(leg.trial, first, second, toe_off, channels)
    return None


def _changes_belt_speed(leg: Leg, stride: Stride) -> bool:
    if leg.belt_speed is None:
        return False
    median_speed = float(np.median(leg.belt_speed))
    inside = (leg.time >= stride.start) & (leg.time <= stride.end)
    deviation = abs(float(np.mean(leg.belt_speed[inside])) - median_speed)
    return bool(deviation > MAX_BELT_SPEED_DEVIATION * abs(median_speed))


def select_regular_strides(strides: Sequence[Stride], side: Side, log: ImportLog) -> list[Stride]:
    """Return ``strides`` without those whose duration deviates from the median, and log the exclusions."""
    if not strides:
        return []
    median = float(np.median([stride.duration for stride in strides]))
    regular = [stride for stride in strides if abs(stride.duration - median) <= MAX_STRIDE_TIME_DEVIATION * median]
    if len(regular) < len(strides):
        log.add_exclusion(
            side,
            f"the {side} leg: {len(strides) - len(regular)} of {len(strides)} strides deviate by more than "
            f"{100 * MAX_STRIDE_TIME_DEVIATION:.0f} % from the median stride time of {median:.2f} s and were excluded",
        )
    return regular


def to_recording(strides: Sequence[Stride], side: str) -> Recording:
    """Return all ``strides`` in sequence, each from 0 to 100 % including its own end.

    ``time`` continues from stride to stride without gaps; ``start`` is the start time of each stride in its file.
    """
    offsets = np.cumsum([0.0, *(stride.duration * (1.0 + PHASE_GRID[1]) for stride in strides)])[:-1]
    columns = [
        ("time [s]", np.concatenate([t + PHASE_GRID * s.duration for t, s in zip(offsets, strides, strict=True)])),
        ("gait_phase [%]", np.tile(100.0 * PHASE_GRID, len(strides))),
        ("stride [1]", np.repeat(np.arange(1.0, len(strides) + 1.0), len(PHASE_GRID))),
        ("start [s]", np.repeat([stride.start for stride in strides], len(PHASE_GRID))),
    ]
    for name, unit in LEG_UNITS.items():
        if all(name in stride.channels for stride in strides):
            columns.append((f"{name} [{unit}]", np.concatenate([stride.channels[name] for stride in strides])))
    provenance = {"side": side, "trials": [stride.trial for stride in strides]}
    return Recording.from_columns(columns, provenance)
