"""One trial with a prosthesis, as a replay needs it: motion of the shank, load on the foot, the prosthesis' own log.

Every channel stays on the clock of its own file and nothing is filtered: whoever reads a dataset does that. Found out
are, as for a reference, whose load it is, forward and up, units and signs; cut off is what no force plate carried.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from klute_sim.dataset import events
from klute_sim.dataset.channels import LOADED, MEASURED
from klute_sim.dataset.events import Contact
from klute_sim.motion import columns, filters, loads, names, signs
from klute_sim.motion.clocks import Series
from klute_sim.motion.findings import Findings
from klute_sim.motion.instruments import sensed
from klute_sim.motion.moving import Moving, moving
from klute_sim.motion.names import Side
from klute_sim.motion.options import ImportOptions
from klute_sim.motion.sources import Source
from klute_sim.recording.recording import Samples

LONGEST_SWING = 0.8
"""Longer without load [s] is a step that no plate saw (assumed; a swing takes some 0.4 s)."""
AROUND = 0.3
"""Kept before the first and after the last contact of a trial that is cut [s]: swing, where the load is 0 (assumed)."""
SWUNG = 0.1
"""Without load before a foot strike that begins a stride, at least [s] (assumed, as a diagnosis takes it)."""
FEWEST = 2
"""Foot strikes after a swing, which a diagnosis needs to tell strides."""
NEEDED = ("shank_angle", "ankle_x", "ankle_z", "grf_vertical", "grf_forward", names.COMMAND)
"""What is prescribed, without the centre of pressure, which may be missing in swing."""


@dataclass(frozen=True, eq=False)
class Walk:
    """A trial that can be replayed."""

    name: str
    """Of its first file."""
    files: tuple[str, ...]
    channels: Mapping[str, Series]
    """Of a gait trial in a dataset; angles in degrees, pressures in bar, the muscle's length in mm."""
    strikes: Samples
    """Foot strikes after a swing [s]."""

    @property
    def stride_time(self) -> float:
        """Mean [s]."""
        return float(np.mean(np.diff(self.strikes)))

    def command(self, phase: Samples) -> Samples:
        """Pressure asked for [bar] at ``phase`` (0-1), on average over the strides."""
        asked = self.channels[names.COMMAND]
        strides = [np.interp(a + phase * (b - a), asked.time, asked.value) for a, b in pairwise(self.strikes)]
        return np.asarray(np.mean(strides, axis=0))


def walk(trial: Sequence[Source], side: Side, options: ImportOptions, findings: Findings) -> Walk | None:
    """The trial of the prosthesis on ``side``; None where something is missing, which is noted."""
    where = trial[0].name
    found = moving(trial, side, options, findings)
    if found is None:
        return None
    own = dict(found.channels)
    contacts = _loaded(found, own, side, where, options, findings)
    if contacts is None or not _placed(found, own, trial, side, where, options, findings):
        return None
    if signs.detected("shank_angle", *own["shank_angle"], contacts) == -1:
        findings.miss(
            f"{where}: the {side} shank leans back from heel strike to toe-off; leaning forward is positive (sign = -1 "
            "in a file for --map, or 'forward' under [axes])"
        )
        return None
    own |= sensed(trial, found, contacts, side, options, findings)
    if names.COMMAND not in own:
        findings.miss(
            f"{where}: no pressure was commanded: add the prosthesis' own log with a column 'pressure_command [bar]', "
            "or name that column in a file for --map, under [prosthesis]"
        )
        return None
    if not MEASURED["gait"].keys() & own.keys():
        findings.miss(f"{where}: nothing was measured; needed is one of {', '.join(MEASURED['gait'])}")
        return None
    return _cut(trial, own, contacts, where, findings)


def _loaded(
    found: Moving, own: dict[str, Series], side: Side, where: str, options: ImportOptions, findings: Findings
) -> list[Contact] | None:
    """Add the ground reaction; its contacts, None where there is none or its axis points backward."""
    if side not in found.on:
        findings.miss(f"{where}: no ground reaction of the {side} foot, which a replay is moved by")
        return None
    load = loads.without_offset(found.on[side], f"the {side} foot's vertical load", where, findings)
    contacts = events.contacts(load.time, load.vertical, options.threshold)
    sign = signs.detected(names.FORWARD, load.time, load.forward, contacts)
    if sign == -1 and found.by_plates:
        findings.miss(
            f"{where}: the ground pushes the {side} foot before it brakes it: 'forward' points backward; say what is "
            "forward under [axes] in a file for --map"
        )
        return None
    if sign == -1:
        findings.suspect(f"{where}: the fore-aft load of the {side} foot pushes before it brakes; it was turned round")
    own["grf_vertical"] = Series(load.time, load.vertical)
    own["grf_forward"] = Series(load.time, (sign or 1) * load.forward)
    return contacts


def _placed(
    found: Moving,
    own: dict[str, Series],
    trial: Sequence[Source],
    side: Side,
    where: str,
    options: ImportOptions,
    findings: Findings,
) -> bool:
    """Add the centre of pressure; whether it is known wherever the foot carries something."""
    load, column = found.on[side], columns.find(trial, "cop_x", side, options)
    if column is not None:
        place = Series(column.time, columns.told(column, side, findings))
    elif load.point is not None:
        place = Series(load.time, load.point[:, 0])
    else:
        findings.miss(f"{where}: no centre of pressure of the {side} foot, which says how the load turns the ankle")
        return False
    pressing = np.interp(place.time, *own["grf_vertical"]) > LOADED
    known = filters.bridged(np.where(pressing, place.value, np.nan), place.time)
    own["cop_x"] = Series(place.time, np.where(pressing, known, np.nan))
    unknown = np.isnan(known[pressing])
    if unknown.any():
        share = 100.0 * float(unknown.mean())
        findings.miss(f"{where}: the centre of pressure is not known for {share:.0f} % of the time under load")
        return False
    return True


def _cut(
    trial: Sequence[Source], own: Mapping[str, Series], contacts: Sequence[Contact], where: str, findings: Findings
) -> Walk | None:
    """The part of the trial in which all that is prescribed is known; None where that has no strides."""
    late = max(NEEDED, key=lambda name: own[name].time[0])
    early = min(NEEDED, key=lambda name: own[name].time[-1])
    begin, end = float(own[late].time[0]), float(own[early].time[-1])
    if begin >= end:
        findings.miss(
            f"{where}: '{early}' ends at {end:.6g} s and '{late}' begins at {begin:.6g} s: they share no time; say how "
            "far a file's clock is off under [clock] in a file for --map"
        )
        return None
    low, high = _known([own[name] for name in NEEDED], *_carried(contacts, begin, end))
    if low > begin or high < end:
        findings.suspect(
            f"{where}: cut to {low:.2f} to {high:.2f} s of {begin:.2f} to {end:.2f} s: outside of that a step was on "
            "no plate, or something prescribed is missing"
        )
    struck = [c.strike for c in contacts if c.begun and low + SWUNG < c.strike <= high]
    if len(struck) < FEWEST:
        findings.miss(
            f"{where}: {len(struck)} foot strike{'' if len(struck) == 1 else 's'} after a swing, one stride after the "
            f"other on plates; a replay needs {FEWEST} or more, better 5"
        )
        return None
    inside = {name: Series(*(v[(s.time >= low) & (s.time <= high)] for v in s)) for name, s in own.items()}
    return Walk(where, tuple(source.name for source in trial), inside, np.array(struck))


def _carried(contacts: Sequence[Contact], begin: float, end: float) -> tuple[float, float]:
    """The longest time between ``begin`` and ``end`` [s] in which every step of the foot was on a plate."""
    runs: list[list[Contact]] = []
    for contact in contacts:
        if runs and contact.strike - runs[-1][-1].lift <= LONGEST_SWING:
            runs[-1].append(contact)
        else:
            runs.append([contact])
    if not runs:
        return begin, end
    best = max(runs, key=lambda run: run[-1].lift - run[0].strike)
    first, last = best[0].strike, best[-1].lift
    return (
        begin if first - begin <= LONGEST_SWING else first - AROUND,
        end if end - last <= LONGEST_SWING else last + AROUND,
    )


def _known(prescribed: Sequence[Series], begin: float, end: float) -> tuple[float, float]:
    """The longest part of ``begin`` to ``end`` [s] without a missing sample of what is ``prescribed``."""
    missing = {float(t) for s in prescribed for t in s.time[np.isnan(s.value)] if begin <= t <= end}
    low, high = max(pairwise(sorted({begin, end, *missing})), key=lambda span: span[1] - span[0])
    return (
        float(np.nextafter(low, np.inf)) if low in missing else low,
        float(np.nextafter(high, -np.inf)) if high in missing else high,
    )
