"""What was measured of a prosthesis: its own log, its encoder, and a moment that somebody derived."""

from collections.abc import Mapping, Sequence

import numpy as np

from klute_sim.gait.contacts import Contact
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import filters
from klute_sim.mocap.kinematics.prosthesis_kinematics import ProsthesisKinematics
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_lookup, channel_names, time_sync
from klute_sim.mocap.parsing.channel_lookup import Column
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.mocap.parsing.time_sync import Signal
from klute_sim.mocap.strides.postprocess import apply_sign, apply_zero

ATMOSPHERIC_RANGE = (0.85, 1.1)
"""Pressure [bar] above what was commanded that looks like an absolute one (assumed)."""
ANKLE_ANGLE = "ankle_angle"


def read_measurements(
    trial: Sequence[SourceFile],
    kinematics: ProsthesisKinematics,
    contacts: Sequence[Contact],
    side: Side,
    options: ImportOptions,
    log: ImportLog,
) -> dict[str, Signal]:
    """What the files of ``trial`` measured, and the pressure commanded; angle [deg], pressures [bar], length [mm]."""
    where, own = trial[0].name, {}
    for name in channel_names.PROSTHESIS_CHANNELS:
        column = channel_lookup.find_column(trial, name, None, options)
        if column is not None:
            own[name] = Signal(column.time, channel_lookup.apply_given_sign(column, "prosthesis", log))
    if channel_names.PRESSURE_COMMAND in own:
        asked = own[channel_names.PRESSURE_COMMAND]
        own[channel_names.PRESSURE_COMMAND] = Signal(asked.time, filters.fill_gaps(asked.value, asked.time))
    angle = _read_ankle_angle(trial, kinematics, contacts, side, options, log)
    if angle is not None:
        own[ANKLE_ANGLE] = angle
        if options.ankle_zero == "foot-flat":
            shank = kinematics.channels["shank_angle"]
            angles = {ANKLE_ANGLE: angle.value, "shank_angle": np.interp(angle.time, *shank)}
            apply_zero(angle.time, angles, False, contacts, side, where, options, log)
            own[ANKLE_ANGLE] = Signal(angle.time, angles[ANKLE_ANGLE])
    moment = channel_lookup.find_column(trial, channel_names.ANKLE_MOMENT, side, options)
    if moment is not None:
        own[channel_names.ANKLE_MOMENT] = Signal(moment.time, apply_sign(moment, contacts, side, log))
    _warn_if_ambiguous(own, where, log)
    return own


def _read_ankle_angle(
    trial: Sequence[SourceFile],
    kinematics: ProsthesisKinematics,
    contacts: Sequence[Contact],
    side: Side,
    options: ImportOptions,
    log: ImportLog,
) -> Signal | None:
    """The ankle's angle: of the prosthesis' encoder, else of a column, else of the markers; held against the next."""
    known: list[tuple[str, Signal]] = []
    for column in _find_ankle_columns(trial, side, options):
        known.append((column.file_name, Signal(column.time, apply_sign(column, contacts, side, log))))
    if kinematics.ankle_angle is not None:
        known.append((trial[0].name if len(known) == 0 else "the markers", kinematics.ankle_angle))
    if not known:
        return None
    if known[0][1] is kinematics.ankle_angle:
        log.add_derived(
            "Ankle angle: of the line from heel to toe against the shank, by markers, for no encoder was logged"
        )
    if len(known) > 1:
        time_sync.compare_clocks("the ankle's angle", known[0], known[1], log)
    return known[0][1]


def _find_ankle_columns(trial: Sequence[SourceFile], side: Side, options: ImportOptions) -> list[Column]:
    """Columns of the ankle's angle: the one that the user names, else the log's before the others'."""
    if (side, ANKLE_ANGLE) in options.mapping.channels:
        groups = [list(trial)]
    else:
        logs = [source for source in trial if "log" in source.roles(options.mapping)]
        groups = [logs, [source for source in trial if source not in logs]]
    found = [channel_lookup.find_column(files, ANKLE_ANGLE, side, options) for files in groups if files]
    return [column for column in found if column is not None]


def _warn_if_ambiguous(channels: Mapping[str, Signal], trial_name: str, log: ImportLog) -> None:
    """Doubt what may be read otherwise than the instrument meant it."""
    if {channel_names.PRESSURE_COMMAND, channel_names.MUSCLE_PRESSURE} <= set(channels):
        asked, had = channels[channel_names.PRESSURE_COMMAND], channels[channel_names.MUSCLE_PRESSURE]
        more = float(np.nanmedian(had.value - np.interp(had.time, *asked)))
        if ATMOSPHERIC_RANGE[0] <= more <= ATMOSPHERIC_RANGE[1]:
            log.add_warning(f"{trial_name}: the pressure is {more:.2f} bar above what was commanded: is it absolute?")
    if channel_names.MUSCLE_FORCE in channels and np.nanmean(channels[channel_names.MUSCLE_FORCE].value) < 0.0:
        log.add_warning(
            f"{trial_name}: the force is mostly negative; tension is positive (sign = -1 in a file for --map)"
        )
