"""One trial with a prosthesis, as a replay needs it: motion of the shank, load on the foot, the prosthesis' own log.

Every channel stays on the clock of its own file and nothing is filtered: whoever reads a dataset does that. Found out
are, as for a reference, whose load it is, forward and up, units and signs; cut off is what no force plate carried.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD, MEASURED_CHANNELS
from klute_sim.gait import contacts as gait_contacts
from klute_sim.gait.contacts import Contact
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import filters
from klute_sim.mocap.kinematics.prosthesis_kinematics import ProsthesisKinematics, extract_kinematics
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_lookup, channel_names, conventions
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.mocap.parsing.time_sync import Signal
from klute_sim.mocap.prosthesis_sensors import read_measurements
from klute_sim.mocap.strides import loads
from klute_sim.recording.recording import Array

MAX_SWING_TIME = 0.8
"""Longer without load [s] is a step that no plate saw (assumed; a swing takes some 0.4 s)."""
TRIM_MARGIN = 0.3
"""Kept before the first and after the last contact of a trial that is cut [s]: swing, where the load is 0 (assumed)."""
MIN_SWING_TIME = 0.1
"""Without load before a foot strike that begins a stride, at least [s] (assumed, as a diagnosis takes it)."""
MIN_FOOT_STRIKES = 2
"""Foot strikes after a swing, which a diagnosis needs to tell strides."""
PRESCRIBED_CHANNELS = (
    "shank_angle",
    "ankle_x",
    "ankle_z",
    "grf_vertical",
    "grf_forward",
    channel_names.PRESSURE_COMMAND,
)
"""What is prescribed, without the centre of pressure, which may be missing in swing."""


@dataclass(frozen=True, eq=False)
class ProsthesisTrial:
    """A trial that can be replayed."""

    name: str
    """Of its first file."""
    files: tuple[str, ...]
    channels: Mapping[str, Signal]
    """Of a gait trial in a dataset; angles in degrees, pressures in bar, the muscle's length in mm."""
    foot_strikes: Array
    """Foot strikes after a swing [s]."""

    @property
    def stride_time(self) -> float:
        """Mean [s]."""
        return float(np.mean(np.diff(self.foot_strikes)))

    def mean_command(self, phase: Array) -> Array:
        """Pressure asked for [bar] at ``phase`` (0-1), on average over the strides."""
        asked = self.channels[channel_names.PRESSURE_COMMAND]
        strides = [np.interp(a + phase * (b - a), asked.time, asked.value) for a, b in pairwise(self.foot_strikes)]
        return np.asarray(np.mean(strides, axis=0))


def extract_prosthesis_trial(
    trial: Sequence[SourceFile], side: Side, options: ImportOptions, log: ImportLog
) -> ProsthesisTrial | None:
    """The trial of the prosthesis on ``side``; None where something is missing, which is noted."""
    where = trial[0].name
    found = extract_kinematics(trial, side, options, log)
    if found is None:
        return None
    own = dict(found.channels)
    contacts = _add_ground_reaction(found, own, side, where, options, log)
    if contacts is None or not _add_cop(found, own, trial, side, where, options, log):
        return None
    if conventions.detect_sign("shank_angle", *own["shank_angle"], contacts) == -1:
        log.add_missing(
            f"{where}: the {side} shank leans back from heel strike to toe-off; leaning forward is positive (sign = -1 "
            "in a file for --map, or 'forward' under [axes])"
        )
        return None
    own |= read_measurements(trial, found, contacts, side, options, log)
    if channel_names.PRESSURE_COMMAND not in own:
        log.add_missing(
            f"{where}: no pressure was commanded: add the prosthesis' own log with a column 'pressure_command [bar]', "
            "or name that column in a file for --map, under [prosthesis]"
        )
        return None
    if not MEASURED_CHANNELS["gait"].keys() & own.keys():
        log.add_missing(f"{where}: nothing was measured; needed is one of {', '.join(MEASURED_CHANNELS['gait'])}")
        return None
    return _trim(trial, own, contacts, where, log)


def _add_ground_reaction(
    kinematics: ProsthesisKinematics,
    channels: dict[str, Signal],
    side: Side,
    trial_name: str,
    options: ImportOptions,
    log: ImportLog,
) -> list[Contact] | None:
    """Add the ground reaction; its contacts, None where there is none or its axis points backward."""
    if side not in kinematics.loads:
        log.add_missing(f"{trial_name}: no ground reaction of the {side} foot, which a replay is moved by")
        return None
    load = loads.remove_offset(kinematics.loads[side], f"the {side} foot's vertical load", trial_name, log)
    contacts = gait_contacts.find_contacts(load.time, load.vertical, options.contact_threshold)
    sign = conventions.detect_sign(channel_names.GRF_FORWARD, load.time, load.forward, contacts)
    if sign == -1 and kinematics.from_plates:
        log.add_missing(
            f"{trial_name}: the ground pushes the {side} foot before it brakes it: 'forward' points backward; say what is "
            "forward under [axes] in a file for --map"
        )
        return None
    if sign == -1:
        log.add_warning(
            f"{trial_name}: the fore-aft load of the {side} foot pushes before it brakes; it was turned round"
        )
    channels["grf_vertical"] = Signal(load.time, load.vertical)
    channels["grf_forward"] = Signal(load.time, (sign or 1) * load.forward)
    return contacts


def _add_cop(
    kinematics: ProsthesisKinematics,
    channels: dict[str, Signal],
    trial: Sequence[SourceFile],
    side: Side,
    trial_name: str,
    options: ImportOptions,
    log: ImportLog,
) -> bool:
    """Add the centre of pressure; whether it is known wherever the foot carries something."""
    load, column = kinematics.loads[side], channel_lookup.find_column(trial, "cop_x", side, options)
    if column is not None:
        place = Signal(column.time, channel_lookup.apply_given_sign(column, side, log))
    elif load.cop is not None:
        place = Signal(load.time, load.cop[:, 0])
    else:
        log.add_missing(
            f"{trial_name}: no centre of pressure of the {side} foot, which says how the load turns the ankle"
        )
        return False
    pressing = np.interp(place.time, *channels["grf_vertical"]) > CONTACT_FORCE_THRESHOLD
    known = filters.fill_gaps(np.where(pressing, place.value, np.nan), place.time)
    channels["cop_x"] = Signal(place.time, np.where(pressing, known, np.nan))
    unknown = np.isnan(known[pressing])
    if unknown.any():
        share = 100.0 * float(unknown.mean())
        log.add_missing(f"{trial_name}: the centre of pressure is not known for {share:.0f} % of the time under load")
        return False
    return True


def _trim(
    trial: Sequence[SourceFile],
    channels: Mapping[str, Signal],
    contacts: Sequence[Contact],
    trial_name: str,
    log: ImportLog,
) -> ProsthesisTrial | None:
    """The part of the trial in which all that is prescribed is known; None where that has no strides."""
    late = max(PRESCRIBED_CHANNELS, key=lambda name: channels[name].time[0])
    early = min(PRESCRIBED_CHANNELS, key=lambda name: channels[name].time[-1])
    begin, end = float(channels[late].time[0]), float(channels[early].time[-1])
    if begin >= end:
        log.add_missing(
            f"{trial_name}: '{early}' ends at {end:.6g} s and '{late}' begins at {begin:.6g} s: they share no time; say how "
            "far a file's clock is off under [clock] in a file for --map"
        )
        return None
    low, high = _find_complete_span(
        [channels[name] for name in PRESCRIBED_CHANNELS], *_find_loaded_span(contacts, begin, end)
    )
    if low > begin or high < end:
        log.add_warning(
            f"{trial_name}: cut to {low:.2f} to {high:.2f} s of {begin:.2f} to {end:.2f} s: outside of that a step was on "
            "no plate, or something prescribed is missing"
        )
    struck = [c.foot_strike for c in contacts if c.has_foot_strike and low + MIN_SWING_TIME < c.foot_strike <= high]
    if len(struck) < MIN_FOOT_STRIKES:
        log.add_missing(
            f"{trial_name}: {len(struck)} foot strike{'' if len(struck) == 1 else 's'} after a swing, one stride after the "
            f"other on plates; a replay needs {MIN_FOOT_STRIKES} or more, better 5"
        )
        return None
    inside = {name: Signal(*(v[(s.time >= low) & (s.time <= high)] for v in s)) for name, s in channels.items()}
    return ProsthesisTrial(trial_name, tuple(source.name for source in trial), inside, np.array(struck))


def _find_loaded_span(contacts: Sequence[Contact], begin: float, end: float) -> tuple[float, float]:
    """The longest time between ``begin`` and ``end`` [s] in which every step of the foot was on a plate."""
    runs: list[list[Contact]] = []
    for contact in contacts:
        if runs and contact.foot_strike - runs[-1][-1].toe_off <= MAX_SWING_TIME:
            runs[-1].append(contact)
        else:
            runs.append([contact])
    if not runs:
        return begin, end
    best = max(runs, key=lambda run: run[-1].toe_off - run[0].foot_strike)
    first, last = best[0].foot_strike, best[-1].toe_off
    return (
        begin if first - begin <= MAX_SWING_TIME else first - TRIM_MARGIN,
        end if end - last <= MAX_SWING_TIME else last + TRIM_MARGIN,
    )


def _find_complete_span(signals: Sequence[Signal], begin: float, end: float) -> tuple[float, float]:
    """The longest part of ``begin`` to ``end`` [s] without a missing sample of what is ``prescribed``."""
    missing = {float(t) for s in signals for t in s.time[np.isnan(s.value)] if begin <= t <= end}
    low, high = max(pairwise(sorted({begin, end, *missing})), key=lambda span: span[1] - span[0])
    return (
        float(np.nextafter(low, np.inf)) if low in missing else low,
        float(np.nextafter(high, -np.inf)) if high in missing else high,
    )
