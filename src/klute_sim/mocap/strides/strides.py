"""Strides: heel strike to heel strike of one foot, each over 0 to 100 % of its own time."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from klute_sim.gait.contacts import Contact
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.mocap.strides.leg import LEG_UNITS, LegChannels
from klute_sim.recording.recording import Array, Recording

PHASE_GRID = np.linspace(0.0, 1.0, 101)
MIN_STRIDE_TIME, MAX_STRIDE_TIME = 0.6, 2.5
"""Stride times [s] of walking."""
TOE_OFF_RANGE = (0.5, 0.8)
"""Phases between which a walking foot leaves the ground (running: below a half)."""
MAX_STRIDE_TIME_DEVIATION = 0.15
"""Departure from the median stride time from which a stride is left out."""
MAX_BELT_SPEED_DEVIATION = 0.05
"""Departure of the belt from its median speed from which a stride is left out: it starts or stops."""
RECURRENCE_RANGE = (0.8, 1.25)
"""Where the end of a stride without a second heel strike is looked for: times the stance over :data:`STANCE`."""
STANCE_FRACTION = 0.62
MAX_POSTURE_DIFFERENCE = 8.0
"""Root mean square [deg] of all angles within which a posture is that of the last heel strike again."""
RATE_WEIGHT = 0.1
"""Weight [s] of the angles' rates in a posture: on 42 strides of a treadmill the ends then are 0.4 (sd 9) ms off those
of the force plates; 14 (sd 27) ms without rates."""
MAX_SEAM_FRACTION = 0.06
"""Share of a stride that may be bridged where one is put together from the ends of two."""
POSTURE_CHANNELS = ("hip_angle", "knee_angle", "ankle_angle", "shank_angle")


@dataclass(frozen=True, eq=False)
class Stride:
    """One stride of a leg."""

    trial: str
    start: float
    """[s]"""
    end: float
    toe_off: float
    """Phase (0-1)."""
    channels: dict[str, Array]
    """Channel -> samples at :data:`PHASE`."""

    @property
    def duration(self) -> float:
        """[s]"""
        return self.end - self.start


def segment_strides(leg: LegChannels, log: ImportLog) -> list[Stride]:
    """The strides of ``limb`` in which all its channels are known; what is left out is noted.

    They end at the next heel strike on a plate; where no stride does, as on a short walkway, by the leg's posture; and
    where the record is too short for that, too, one is put together.
    """
    whole = [c for c in leg.contacts if c.has_foot_strike and c.has_toe_off]
    ends = dict.fromkeys(whole, float("nan"))
    ends |= {
        one: two.foot_strike
        for one, two in pairwise(leg.contacts)
        if one in ends and two.foot_strike - one.foot_strike <= MAX_STRIDE_TIME
    }
    cut = [_extract_stride(leg, contact, end) for contact, end in ends.items()]
    if not any(cut):
        cut = [_extract_stride(leg, contact, _find_recurrence(leg, contact)) for contact in whole]
        if any(cut):
            log.add_derived(
                "End of a stride whose second heel strike is on no plate: when the leg's posture is that of the first "
                "heel strike again"
            )
        else:
            cut = [_assemble_stride(leg, log), *cut]
    known = [stride for stride in cut if stride is not None]
    steady = [stride for stride in known if not _changes_belt_speed(leg, stride)]
    if len(steady) < len(known):
        first = steady[0].start if steady else leg.time[-1]
        log.add_exclusion(
            leg.side,
            f"{leg.trial}: the belt ramps up or changes its speed: {_format_stride_count(len(known) - len(steady))} of the "
            f"{leg.side} leg left out; the first one kept begins at {first:.2f} s",
        )
    if not whole and not known:
        log.add_exclusion(
            leg.side, f"{leg.trial}: the {leg.side} foot is never seen from heel strike to toe-off on a plate"
        )
    elif len(whole) - len(known) > (1 if known else 0):  # the last one of a record hardly ever is
        begun = {stride.start for stride in known}
        why = _explain_exclusion(leg, next(contact for contact in whole if contact.foot_strike not in begun))
        log.add_exclusion(
            leg.side,
            f"{leg.trial}: {_format_stride_count(len(whole) - len(known))} of the {leg.side} leg not whole and left out: {why}",
        )
    return steady


def _explain_exclusion(leg: LegChannels, contact: Contact) -> str:
    """Why the stride that begins with ``contact`` is not whole."""
    after = next((c.foot_strike for c in leg.contacts if c.foot_strike > contact.foot_strike), None)
    if after is None or after - contact.foot_strike > MAX_STRIDE_TIME:
        return (
            f"the heel strike after that at {contact.foot_strike:.2f} s is on no plate, and until the record ends at "
            f"{leg.time[-1]:.2f} s the leg is not again as it was at the first"
        )
    inside = (leg.time >= contact.foot_strike) & (leg.time <= after)
    gap = next((name for name, samples in leg.channels.items() if not np.isfinite(samples[inside]).all()), None)
    what = f"{gap.replace('_', ' ')} has gaps" if gap else "stride time and toe-off are not those of walking"
    return f"{what} between {contact.foot_strike:.2f} and {after:.2f} s"


def _format_stride_count(count: int) -> str:
    return f"{count} stride{'' if count == 1 else 's'}"


def _extract_stride(leg: LegChannels, contact: Contact, end: float) -> Stride | None:
    """The stride from ``contact`` to ``end`` [s]; None for NaN, where it is no walking, or where channels have gaps."""
    duration = end - contact.foot_strike
    toe_off = (contact.toe_off - contact.foot_strike) / duration
    if not MIN_STRIDE_TIME <= duration <= MAX_STRIDE_TIME or not TOE_OFF_RANGE[0] <= toe_off <= TOE_OFF_RANGE[1]:
        return None
    when = contact.foot_strike + duration * PHASE_GRID
    channels = {name: np.interp(when, leg.time, s, left=np.nan, right=np.nan) for name, s in leg.channels.items()}
    if not all(np.isfinite(samples).all() for samples in channels.values()):
        return None
    return Stride(leg.trial, contact.foot_strike, end, toe_off, channels)


def _find_recurrence(leg: LegChannels, contact: Contact) -> float:
    """When the leg is again as it was at ``contact``'s heel strike, by all its angles; NaN where it never is."""
    stance = contact.toe_off - contact.foot_strike
    low, high = (contact.foot_strike + factor * stance / STANCE_FRACTION for factor in RECURRENCE_RANGE)
    inside = (leg.time >= low) & (leg.time <= high)
    known = [leg.channels[name] for name in POSTURE_CHANNELS if name in leg.channels]
    if inside.sum() < 3 or not known:
        return float("nan")
    apart, moving = np.zeros(int(inside.sum())), np.zeros(int(inside.sum()))
    for samples in known:
        apart += (samples[inside] - np.interp(contact.foot_strike, leg.time, samples)) ** 2
        rate = RATE_WEIGHT * np.gradient(samples, leg.time)
        moving += (rate[inside] - np.interp(contact.foot_strike, leg.time, rate)) ** 2
    if not np.isfinite(apart + moving).any():
        return float("nan")
    best = int(np.nanargmin(apart + moving))
    if best in (0, len(apart) - 1) or not np.sqrt(apart[best] / len(known)) < MAX_POSTURE_DIFFERENCE:
        return float("nan")
    return float(leg.time[inside][best])


def _assemble_stride(leg: LegChannels, log: ImportLog) -> Stride | None:
    """A stride of a record that holds the end of one and the beginning of the next; None where too much is missing."""
    strikes = [contact.foot_strike for contact in leg.contacts if contact.has_foot_strike]
    whole = [contact for contact in leg.contacts if contact.has_foot_strike and contact.has_toe_off]
    known = np.isfinite(np.sum([leg.channels[name] for name in leg.channels], axis=0))
    for first, second in pairwise(strikes):
        duration = second - first
        if not MIN_STRIDE_TIME <= duration <= MAX_STRIDE_TIME or not whole or not known.any():
            continue
        inside = known & (leg.time > leg.time[known][-1] - duration)
        phase = ((leg.time[inside] - first) / duration) % 1.0
        order = np.argsort(phase)
        gaps = np.diff(np.append(phase[order], phase[order][0] + 1.0))
        toe_off = (whole[0].toe_off - whole[0].foot_strike) / duration
        if gaps.max() > MAX_SEAM_FRACTION or not TOE_OFF_RANGE[0] <= toe_off <= TOE_OFF_RANGE[1]:
            continue
        channels = {
            name: np.interp(PHASE_GRID, phase[order], samples[inside][order], period=1.0)
            for name, samples in leg.channels.items()
        }
        log.add_warning(
            f"{leg.trial}: no stride of the {leg.side} leg is whole; one was put together from the end of one and "
            f"the beginning of the next, with {100 * gaps.max():.1f} % of it bridged by a straight line"
        )
        return Stride(leg.trial, first, second, toe_off, channels)
    return None


def _changes_belt_speed(leg: LegChannels, stride: Stride) -> bool:
    if leg.belt_speed is None:
        return False
    usual = float(np.median(leg.belt_speed))
    inside = (leg.time >= stride.start) & (leg.time <= stride.end)
    return bool(abs(float(np.mean(leg.belt_speed[inside])) - usual) > MAX_BELT_SPEED_DEVIATION * abs(usual))


def select_regular_strides(strides: Sequence[Stride], side: Side, log: ImportLog) -> list[Stride]:
    """``strides`` without those whose time is far from the median's; these are noted."""
    if not strides:
        return []
    middle = float(np.median([stride.duration for stride in strides]))
    kept = [stride for stride in strides if abs(stride.duration - middle) <= MAX_STRIDE_TIME_DEVIATION * middle]
    if len(kept) < len(strides):
        log.add_exclusion(
            side,
            f"the {side} leg: {len(strides) - len(kept)} of {len(strides)} strides take over {100 * MAX_STRIDE_TIME_DEVIATION:.0f} % "
            f"longer or shorter than {middle:.2f} s and were left out",
        )
    return kept


def to_recording(strides: Sequence[Stride], side: str) -> Recording:
    """All ``strides`` one after the other, each from 0 to 100 %: its end is its own, not the next one's beginning.

    ``time`` runs on from stride to stride, one sample after the last, whatever was between them; ``start`` is where
    each began in its own file.
    """
    before = np.cumsum([0.0, *(stride.duration * (1.0 + PHASE_GRID[1]) for stride in strides)])[:-1]
    columns = [
        ("time [s]", np.concatenate([t + PHASE_GRID * s.duration for t, s in zip(before, strides, strict=True)])),
        ("gait_phase [%]", np.tile(100.0 * PHASE_GRID, len(strides))),
        ("stride [1]", np.repeat(np.arange(1.0, len(strides) + 1.0), len(PHASE_GRID))),
        ("start [s]", np.repeat([stride.start for stride in strides], len(PHASE_GRID))),
    ]
    for name, unit in LEG_UNITS.items():
        if all(name in stride.channels for stride in strides):
            columns.append((f"{name} [{unit}]", np.concatenate([stride.channels[name] for stride in strides])))
    provenance = {"side": side, "trials": [stride.trial for stride in strides]}
    return Recording.from_columns(columns, provenance)
