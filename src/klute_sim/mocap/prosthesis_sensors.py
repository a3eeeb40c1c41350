"""Measurements on a prosthesis: its log, its ankle encoder, and an ankle moment of another program."""

from collections.abc import Mapping, Sequence

import numpy as np

from klute_sim.datasets.trial import TimeSeries
from klute_sim.gait.contacts import Contact
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import filters
from klute_sim.mocap.kinematics.postprocess import apply_sign, apply_zero
from klute_sim.mocap.kinematics.prosthesis_kinematics import ProsthesisKinematics
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names, time_sync
from klute_sim.mocap.parsing.channel_lookup import Column, apply_given_sign, find_column
from klute_sim.mocap.parsing.channel_names import ANKLE_MOMENT, MUSCLE_FORCE, MUSCLE_PRESSURE, PRESSURE_COMMAND, Side
from klute_sim.mocap.parsing.sources import SourceFile

ATMOSPHERIC_RANGE = (0.85, 1.1)
"""Range [bar] of the excess over the commanded pressure that indicates an absolute pressure (assumed)."""
ANKLE_ANGLE = "ankle_angle"
"""Channel of the ankle angle."""


def read_measurements(
    trial: Sequence[SourceFile],
    kinematics: ProsthesisKinematics,
    contacts: Sequence[Contact],
    side: Side,
    options: ImportOptions,
    log: ImportLog,
) -> dict[str, TimeSeries]:
    """Return the measured channels and the commanded pressure of ``trial``: [deg], [bar], [N], [mm], [N.m]."""
    trial_name, channels = trial[0].name, {}
    for name in channel_names.PROSTHESIS_CHANNELS:
        column = find_column(trial, name, None, options)
        if column is not None:
            channels[name] = TimeSeries(column.time, apply_given_sign(column, "prosthesis", log))
    if PRESSURE_COMMAND in channels:
        command = channels[PRESSURE_COMMAND]
        channels[PRESSURE_COMMAND] = TimeSeries(command.time, filters.fill_gaps(command.value, command.time))
    angle = _read_ankle_angle(trial, kinematics, contacts, side, options, log)
    if angle is not None:
        channels[ANKLE_ANGLE] = angle
        if options.ankle_zero == "foot-flat":
            shank = kinematics.channels["shank_angle"]
            angles = {ANKLE_ANGLE: angle.value, "shank_angle": np.interp(angle.time, *shank)}
            apply_zero(angle.time, angles, False, contacts, side, trial_name, options, log)
            channels[ANKLE_ANGLE] = TimeSeries(angle.time, angles[ANKLE_ANGLE])
    moment = find_column(trial, ANKLE_MOMENT, side, options)
    if moment is not None:
        channels[ANKLE_MOMENT] = TimeSeries(moment.time, apply_sign(moment, contacts, side, log))
    _warn_if_ambiguous(channels, trial_name, log)
    return channels


def _read_ankle_angle(
    trial: Sequence[SourceFile],
    kinematics: ProsthesisKinematics,
    contacts: Sequence[Contact],
    side: Side,
    options: ImportOptions,
    log: ImportLog,
) -> TimeSeries | None:
    """Return the ankle angle of the encoder, else of another column, else of the markers.

    The clock of the result is compared with that of the next source.
    """
    candidates: list[tuple[str, TimeSeries]] = []
    for column in _find_ankle_columns(trial, side, options):
        candidates.append((column.file_name, TimeSeries(column.time, apply_sign(column, contacts, side, log))))
    if kinematics.ankle_angle is not None:
        candidates.append((trial[0].name if len(candidates) == 0 else "the markers", kinematics.ankle_angle))
    if not candidates:
        return None
    if candidates[0][1] is kinematics.ankle_angle:
        log.add_derived(
            "Ankle angle: angle between the shank and the line from heel to toe by markers, because no encoder was "
            "logged"
        )
    if len(candidates) > 1:
        time_sync.compare_clocks("the ankle angle", candidates[0], candidates[1], log)
    return candidates[0][1]


def _find_ankle_columns(trial: Sequence[SourceFile], side: Side, options: ImportOptions) -> list[Column]:
    """Return the columns of the ankle angle: the mapped one, else that of the log before those of other files."""
    if (side, ANKLE_ANGLE) in options.mapping.channels:
        groups = [list(trial)]
    else:
        logs = [source for source in trial if "log" in source.detect_roles(options.mapping)]
        groups = [logs, [source for source in trial if source not in logs]]
    columns = [find_column(files, ANKLE_ANGLE, side, options) for files in groups if files]
    return [column for column in columns if column is not None]


def _warn_if_ambiguous(channels: Mapping[str, TimeSeries], trial_name: str, log: ImportLog) -> None:
    """Warn about an absolute pressure and about a force with the wrong sign."""
    if {PRESSURE_COMMAND, MUSCLE_PRESSURE} <= set(channels):
        command, pressure = channels[PRESSURE_COMMAND], channels[MUSCLE_PRESSURE]
        excess = float(np.nanmedian(pressure.value - np.interp(pressure.time, *command)))
        if ATMOSPHERIC_RANGE[0] <= excess <= ATMOSPHERIC_RANGE[1]:
            log.add_warning(
                f"{trial_name}: the pressure exceeds the commanded one by {excess:.2f} bar; it may be an absolute "
                "pressure"
            )
    if MUSCLE_FORCE in channels and np.nanmean(channels[MUSCLE_FORCE].value) < 0.0:
        log.add_warning(
            f"{trial_name}: the force is mostly negative; tension is positive (sign = -1 in a file for --map)"
        )
