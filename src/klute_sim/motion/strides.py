"""Strides: heel strike to heel strike of one foot, each over 0 to 100 % of its own time."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from klute_sim.dataset.events import Contact
from klute_sim.motion.findings import Findings
from klute_sim.motion.limb import UNITS, Limb
from klute_sim.motion.names import Side
from klute_sim.recording.recording import Recording, Samples

PHASE = np.linspace(0.0, 1.0, 101)
SHORTEST, LONGEST = 0.6, 2.5
"""Stride times [s] of walking."""
TOE_OFF = (0.5, 0.8)
"""Phases between which a walking foot leaves the ground (running: below a half)."""
UNUSUAL = 0.15
"""Departure from the median stride time from which a stride is left out."""
BELT = 0.05
"""Departure of the belt from its median speed from which a stride is left out: it starts or stops."""
RECURRENCE = (0.8, 1.25)
"""Where the end of a stride without a second heel strike is looked for: times the stance over :data:`STANCE`."""
STANCE = 0.62
ALIKE = 8.0
"""Root mean square [deg] of all angles within which a posture is that of the last heel strike again."""
RATE = 0.1
"""Weight [s] of the angles' rates in a posture: on 42 strides of a treadmill the ends then are 0.4 (sd 9) ms off those
of the force plates; 14 (sd 27) ms without rates."""
LONGEST_SEAM = 0.06
"""Share of a stride that may be bridged where one is put together from the ends of two."""
POSTURE = ("hip_angle", "knee_angle", "ankle_angle", "shank_angle")


@dataclass(frozen=True, eq=False)
class Stride:
    """One stride of a leg."""

    trial: str
    start: float
    """[s]"""
    end: float
    toe_off: float
    """Phase (0-1)."""
    channels: dict[str, Samples]
    """Channel -> samples at :data:`PHASE`."""

    @property
    def duration(self) -> float:
        """[s]"""
        return self.end - self.start


def segment(limb: Limb, findings: Findings) -> list[Stride]:
    """The strides of ``limb`` in which all its channels are known; what is left out is noted.

    They end at the next heel strike on a plate; where no stride does, as on a short walkway, by the leg's posture; and
    where the record is too short for that, too, one is put together.
    """
    whole = [c for c in limb.contacts if c.begun and c.ended]
    ends = dict.fromkeys(whole, float("nan"))
    ends |= {
        one: two.strike for one, two in pairwise(limb.contacts) if one in ends and two.strike - one.strike <= LONGEST
    }
    cut = [_cut(limb, contact, end) for contact, end in ends.items()]
    if not any(cut):
        cut = [_cut(limb, contact, _recurrence(limb, contact)) for contact in whole]
        if any(cut):
            findings.derive(
                "End of a stride whose second heel strike is on no plate: when the leg's posture is that of the first "
                "heel strike again"
            )
        else:
            cut = [_folded(limb, findings), *cut]
    known = [stride for stride in cut if stride is not None]
    steady = [stride for stride in known if not _belt_changes(limb, stride)]
    if len(steady) < len(known):
        first = steady[0].start if steady else limb.time[-1]
        findings.leave_out(
            limb.side,
            f"{limb.trial}: the belt ramps up or changes its speed: {_strides(len(known) - len(steady))} of the "
            f"{limb.side} leg left out; the first one kept begins at {first:.2f} s",
        )
    if not whole and not known:
        findings.leave_out(
            limb.side, f"{limb.trial}: the {limb.side} foot is never seen from heel strike to toe-off on a plate"
        )
    elif len(whole) - len(known) > (1 if known else 0):  # the last one of a record hardly ever is
        begun = {stride.start for stride in known}
        why = _why(limb, next(contact for contact in whole if contact.strike not in begun))
        findings.leave_out(
            limb.side,
            f"{limb.trial}: {_strides(len(whole) - len(known))} of the {limb.side} leg not whole and left out: {why}",
        )
    return steady


def _why(limb: Limb, contact: Contact) -> str:
    """Why the stride that begins with ``contact`` is not whole."""
    after = next((c.strike for c in limb.contacts if c.strike > contact.strike), None)
    if after is None or after - contact.strike > LONGEST:
        return (
            f"the heel strike after that at {contact.strike:.2f} s is on no plate, and until the record ends at "
            f"{limb.time[-1]:.2f} s the leg is not again as it was at the first"
        )
    inside = (limb.time >= contact.strike) & (limb.time <= after)
    gap = next((name for name, samples in limb.channels.items() if not np.isfinite(samples[inside]).all()), None)
    what = f"{gap.replace('_', ' ')} has gaps" if gap else "stride time and toe-off are not those of walking"
    return f"{what} between {contact.strike:.2f} and {after:.2f} s"


def _strides(count: int) -> str:
    return f"{count} stride{'' if count == 1 else 's'}"


def _cut(limb: Limb, contact: Contact, end: float) -> Stride | None:
    """The stride from ``contact`` to ``end`` [s]; None for NaN, where it is no walking, or where channels have gaps."""
    duration = end - contact.strike
    toe_off = (contact.lift - contact.strike) / duration
    if not SHORTEST <= duration <= LONGEST or not TOE_OFF[0] <= toe_off <= TOE_OFF[1]:
        return None
    when = contact.strike + duration * PHASE
    channels = {name: np.interp(when, limb.time, s, left=np.nan, right=np.nan) for name, s in limb.channels.items()}
    if not all(np.isfinite(samples).all() for samples in channels.values()):
        return None
    return Stride(limb.trial, contact.strike, end, toe_off, channels)


def _recurrence(limb: Limb, contact: Contact) -> float:
    """When the leg is again as it was at ``contact``'s heel strike, by all its angles; NaN where it never is."""
    stance = contact.lift - contact.strike
    low, high = (contact.strike + factor * stance / STANCE for factor in RECURRENCE)
    inside = (limb.time >= low) & (limb.time <= high)
    known = [limb.channels[name] for name in POSTURE if name in limb.channels]
    if inside.sum() < 3 or not known:
        return float("nan")
    apart, moving = np.zeros(int(inside.sum())), np.zeros(int(inside.sum()))
    for samples in known:
        apart += (samples[inside] - np.interp(contact.strike, limb.time, samples)) ** 2
        rate = RATE * np.gradient(samples, limb.time)
        moving += (rate[inside] - np.interp(contact.strike, limb.time, rate)) ** 2
    if not np.isfinite(apart + moving).any():
        return float("nan")
    best = int(np.nanargmin(apart + moving))
    if best in (0, len(apart) - 1) or not np.sqrt(apart[best] / len(known)) < ALIKE:
        return float("nan")
    return float(limb.time[inside][best])


def _folded(limb: Limb, findings: Findings) -> Stride | None:
    """A stride of a record that holds the end of one and the beginning of the next; None where too much is missing."""
    strikes = [contact.strike for contact in limb.contacts if contact.begun]
    whole = [contact for contact in limb.contacts if contact.begun and contact.ended]
    known = np.isfinite(np.sum([limb.channels[name] for name in limb.channels], axis=0))
    for first, second in pairwise(strikes):
        duration = second - first
        if not SHORTEST <= duration <= LONGEST or not whole or not known.any():
            continue
        inside = known & (limb.time > limb.time[known][-1] - duration)
        phase = ((limb.time[inside] - first) / duration) % 1.0
        order = np.argsort(phase)
        gaps = np.diff(np.append(phase[order], phase[order][0] + 1.0))
        toe_off = (whole[0].lift - whole[0].strike) / duration
        if gaps.max() > LONGEST_SEAM or not TOE_OFF[0] <= toe_off <= TOE_OFF[1]:
            continue
        channels = {
            name: np.interp(PHASE, phase[order], samples[inside][order], period=1.0)
            for name, samples in limb.channels.items()
        }
        findings.suspect(
            f"{limb.trial}: no stride of the {limb.side} leg is whole; one was put together from the end of one and "
            f"the beginning of the next, with {100 * gaps.max():.1f} % of it bridged by a straight line"
        )
        return Stride(limb.trial, first, second, toe_off, channels)
    return None


def _belt_changes(limb: Limb, stride: Stride) -> bool:
    if limb.belt is None:
        return False
    usual = float(np.median(limb.belt))
    inside = (limb.time >= stride.start) & (limb.time <= stride.end)
    return bool(abs(float(np.mean(limb.belt[inside])) - usual) > BELT * abs(usual))


def usual(strides: Sequence[Stride], side: Side, findings: Findings) -> list[Stride]:
    """``strides`` without those whose time is far from the median's; these are noted."""
    if not strides:
        return []
    middle = float(np.median([stride.duration for stride in strides]))
    kept = [stride for stride in strides if abs(stride.duration - middle) <= UNUSUAL * middle]
    if len(kept) < len(strides):
        findings.leave_out(
            side,
            f"the {side} leg: {len(strides) - len(kept)} of {len(strides)} strides take over {100 * UNUSUAL:.0f} % "
            f"longer or shorter than {middle:.2f} s and were left out",
        )
    return kept


def recording(strides: Sequence[Stride], side: str) -> Recording:
    """All ``strides`` one after the other, each from 0 to 100 %: its end is its own, not the next one's beginning.

    ``time`` runs on from stride to stride, one sample after the last, whatever was between them; ``start`` is where
    each began in its own file.
    """
    before = np.cumsum([0.0, *(stride.duration * (1.0 + PHASE[1]) for stride in strides)])[:-1]
    columns = [
        ("time [s]", np.concatenate([t + PHASE * s.duration for t, s in zip(before, strides, strict=True)])),
        ("gait_phase [%]", np.tile(100.0 * PHASE, len(strides))),
        ("stride [1]", np.repeat(np.arange(1.0, len(strides) + 1.0), len(PHASE))),
        ("start [s]", np.repeat([stride.start for stride in strides], len(PHASE))),
    ]
    for name, unit in UNITS.items():
        if all(name in stride.channels for stride in strides):
            columns.append((f"{name} [{unit}]", np.concatenate([stride.channels[name] for stride in strides])))
    provenance = {"side": side, "trials": [stride.trial for stride in strides]}
    return Recording.from_columns(columns, provenance)
