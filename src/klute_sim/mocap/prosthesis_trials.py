"""Trials with a prosthesis for a replay: shank motion, foot load and the prosthesis log.

Every channel keeps the times of its file and remains unfiltered; readers of the dataset filter it. As for a reference,
the import determines the loaded foot, axes, units and signs. Parts of the trial without force plate data are removed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from klute_sim.datasets.channels import MEASURED_CHANNELS
from klute_sim.datasets.foot_load import find_loaded_samples, interpolate_load_mask
from klute_sim.datasets.trial import TimeSeries
from klute_sim.gait.contacts import MAX_SWING_TIME, Contact, find_contacts
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import filters, loads
from klute_sim.mocap.kinematics.prosthesis_kinematics import ProsthesisKinematics, extract_kinematics
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names, conventions
from klute_sim.mocap.parsing.channel_lookup import apply_given_sign, find_column
from klute_sim.mocap.parsing.channel_names import PRESSURE_COMMAND, Side
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.mocap.prosthesis_sensors import read_measurements
from klute_sim.types import Array

TRIM_MARGIN = 0.3
"""Longest time [s] before the first and after the last contact that a trimmed trial keeps, in swing without load
(assumed)."""
MIN_SWING_TIME = 0.1
"""Shortest time without load before a foot strike that starts a stride [s] (assumed, as in the diagnosis)."""
MIN_FOOT_STRIKES = 2
"""Smallest number of foot strikes after a swing, which the diagnosis needs to segment strides."""
PRESCRIBED_CHANNELS = ("shank_angle", "ankle_x", "ankle_z", "grf_vertical", "grf_forward", PRESSURE_COMMAND)
"""Prescribed channels without gaps; the centre of pressure may be missing in swing."""


@dataclass(frozen=True, eq=False)
class ProsthesisTrial:
    """Trial with a prosthesis that can be replayed."""

    name: str
    """Name of the first file."""
    files: tuple[str, ...]
    """Names of all files."""
    channels: Mapping[str, TimeSeries]
    """Channels of a gait trial in a dataset: angles [deg], positions [m], loads [N], pressures [bar], length [mm]."""
    foot_strikes: Array
    """Times of foot strikes after a swing [s]."""

    @property
    def stride_time(self) -> float:
        """Mean stride time [s]."""
        return float(np.mean(np.diff(self.foot_strikes)))

    def compute_mean_command(self, phase: Array) -> Array:
        """Return the commanded pressure [bar] at ``phase`` (0-1), averaged over strides."""
        command = self.channels[PRESSURE_COMMAND]
        strides = [np.interp(a + phase * (b - a), command.time, command.value) for a, b in pairwise(self.foot_strikes)]
        return np.asarray(np.mean(strides, axis=0))


def extract_prosthesis_trial(
    trial: Sequence[SourceFile], side: Side, options: ImportOptions, log: ImportLog
) -> ProsthesisTrial | None:
    """Return the trial of the prosthesis on ``side``; return None and log the reason if data are missing."""
    trial_name = trial[0].name
    kinematics = extract_kinematics(trial, side, options, log)
    if kinematics is None:
        return None
    channels = dict(kinematics.channels)
    contacts = _add_ground_reaction(kinematics, channels, side, trial_name, options, log)
    if contacts is None or not _add_cop(kinematics, channels, trial, side, options, log):
        return None
    if conventions.detect_sign("shank_angle", *channels["shank_angle"], contacts) == -1:
        log.add_missing(
            f"{trial_name}: the {side} shank leans backward from heel strike to toe-off; leaning forward is positive "
            "(sign = -1 in a file for --map, or 'forward' under [axes])"
        )
        return None
    channels |= read_measurements(trial, kinematics, contacts, side, options, log)
    if PRESSURE_COMMAND not in channels:
        log.add_missing(
            f"{trial_name}: no commanded pressure: add the prosthesis log with a column 'pressure_command [bar]', or "
            "name that column in a file for --map, under [prosthesis]"
        )
        return None
    if not MEASURED_CHANNELS["gait"].keys() & channels.keys():
        log.add_missing(f"{trial_name}: no measurement; needed is one of {', '.join(MEASURED_CHANNELS['gait'])}")
        return None
    return _trim(trial, channels, contacts, trial_name, log)


def _add_ground_reaction(
    kinematics: ProsthesisKinematics,
    channels: dict[str, TimeSeries],
    side: Side,
    trial_name: str,
    options: ImportOptions,
    log: ImportLog,
) -> list[Contact] | None:
    """Add the ground reaction to ``channels`` and return its contacts; None without load or with a reversed axis."""
    if side not in kinematics.loads:
        log.add_missing(f"{trial_name}: no ground reaction of the {side} foot, which the replay needs")
        return None
    load = loads.preprocess_load(kinematics.loads[side], f"the plate of the {side} foot", options, log)
    contacts = find_contacts(load.time, load.vertical, options.contact_threshold)
    sign = conventions.detect_sign(channel_names.GRF_FORWARD, load.time, load.forward, contacts)
    if sign == -1 and kinematics.from_plates:
        log.add_missing(
            f"{load.file_name}: the ground pushes the {side} foot before braking it: 'forward' points backward; set "
            "the forward axis under [axes] in a file for --map"
        )
        return None
    if sign == -1:
        log.add_warning(
            f"{load.file_name}: the fore-aft load of the {side} foot pushes before it brakes; its sign was reversed"
        )
    channels["grf_vertical"] = TimeSeries(load.time, load.vertical)
    channels["grf_forward"] = TimeSeries(load.time, (sign or 1) * load.forward)
    return contacts


def _add_cop(
    kinematics: ProsthesisKinematics,
    channels: dict[str, TimeSeries],
    trial: Sequence[SourceFile],
    side: Side,
    options: ImportOptions,
    log: ImportLog,
) -> bool:
    """Add the centre of pressure to ``channels``; return whether it is known whenever the foot is loaded."""
    load, column = kinematics.loads[side], find_column(trial, "cop_x", side, options)
    if column is not None:
        time, position = column.time, apply_given_sign(column, side, log)
    elif load.cop is not None:
        time, position = load.time, load.cop[:, 0]
    else:
        log.add_missing(
            f"{load.file_name}: no centre of pressure of the {side} foot, so the moment of the load about the ankle is "
            f"unknown: name a column of cop_x in a file for --map, under [{side}], or add the force plates (.c3d, .mot)"
        )
        return False
    cop = TimeSeries(*filters.insert_missing_samples(time, position))
    vertical = channels["grf_vertical"]
    is_loaded = interpolate_load_mask(cop.time, vertical.time, find_loaded_samples(vertical.value))
    filled = filters.fill_gaps(np.where(is_loaded, cop.value, np.nan), cop.time)
    channels["cop_x"] = TimeSeries(cop.time, np.where(is_loaded, filled, np.nan))
    is_missing = np.isnan(filled[is_loaded])
    if is_missing.any():
        percentage = 100.0 * float(is_missing.mean())
        file_name = load.file_name if column is None else column.file_name
        log.add_missing(f"{file_name}: the centre of pressure is unknown for {percentage:.0f} % of the loaded time")
        return False
    return True


def _trim(
    trial: Sequence[SourceFile],
    channels: Mapping[str, TimeSeries],
    contacts: Sequence[Contact],
    trial_name: str,
    log: ImportLog,
) -> ProsthesisTrial | None:
    """Return the part of the trial with all prescribed channels; None if it has too few strides."""
    last_start = max(PRESCRIBED_CHANNELS, key=lambda name: channels[name].time[0])
    first_end = min(PRESCRIBED_CHANNELS, key=lambda name: channels[name].time[-1])
    begin, end = float(channels[last_start].time[0]), float(channels[first_end].time[-1])
    if begin >= end:
        log.add_missing(
            f"{trial_name}: '{first_end}' ends at {end:.6g} s and '{last_start}' begins at {begin:.6g} s, so they do "
            "not overlap; set the time offset of a file under [clock] in a file for --map"
        )
        return None
    low, high = _find_complete_span(
        [channels[name] for name in PRESCRIBED_CHANNELS], *_find_loaded_span(contacts, begin, end)
    )
    if low > begin or high < end:
        log.add_warning(
            f"{trial_name}: trimmed from {begin:.2f} to {end:.2f} s to {low:.2f} to {high:.2f} s, because of steps on "
            "no plate or missing prescribed channels"
        )
    trimmed = {name: TimeSeries(*(v[(s.time >= low) & (s.time <= high)] for v in s)) for name, s in channels.items()}
    load = trimmed["grf_vertical"]
    foot_strikes = [
        c.foot_strike
        for c in find_contacts(load.time, load.value)  # a contact that the end truncates may be too short to count
        if c.has_foot_strike and c.foot_strike > low + MIN_SWING_TIME
    ]
    if len(foot_strikes) < MIN_FOOT_STRIKES:
        log.add_missing(
            f"{trial_name}: {len(foot_strikes)} foot strike{'' if len(foot_strikes) == 1 else 's'} after a swing in "
            f"consecutive strides on plates; a replay needs {MIN_FOOT_STRIKES} or more, better 5"
        )
        return None
    return ProsthesisTrial(trial_name, tuple(source.name for source in trial), trimmed, np.array(foot_strikes))


def _find_loaded_span(contacts: Sequence[Contact], begin: float, end: float) -> tuple[float, float]:
    """Return the longest part of ``begin`` to ``end`` [s] in which every step of the foot is on a plate.

    Beyond the first and the last contact, the foot is in the air for no longer than in the shortest swing between.
    """
    sequences: list[list[Contact]] = []
    for contact in contacts:
        if sequences and contact.foot_strike - sequences[-1][-1].toe_off <= MAX_SWING_TIME:
            sequences[-1].append(contact)
        else:
            sequences.append([contact])
    if not sequences:
        return begin, end
    longest = max(sequences, key=lambda sequence: sequence[-1].toe_off - sequence[0].foot_strike)
    first, last = longest[0].foot_strike, longest[-1].toe_off
    swings = [after.foot_strike - before.toe_off for before, after in pairwise(longest)]
    swing = min((time for time in swings if time > MIN_SWING_TIME), default=TRIM_MARGIN)
    margin = min(swing, TRIM_MARGIN)
    return begin if first - begin <= swing else first - margin, end if end - last <= swing else last + margin


def _find_complete_span(signals: Sequence[TimeSeries], begin: float, end: float) -> tuple[float, float]:
    """Return the longest part of ``begin`` to ``end`` [s] without missing samples of ``signals``."""
    missing = {float(t) for s in signals for t in s.time[np.isnan(s.value)] if begin <= t <= end}
    low, high = max(pairwise(sorted({begin, end, *missing})), key=lambda span: span[1] - span[0])
    return (
        float(np.nextafter(low, np.inf)) if low in missing else low,
        float(np.nextafter(high, -np.inf)) if high in missing else high,
    )
