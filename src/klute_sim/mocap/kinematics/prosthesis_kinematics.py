"""What moves a prosthesis in one trial: where its shank leans and its ankle is, and whose load is whose."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import filters, from_joint_angles, from_markers
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_lookup, channel_names, markers
from klute_sim.mocap.parsing.channel_lookup import Column
from klute_sim.mocap.parsing.channel_names import SIDES, Side
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.mocap.parsing.time_sync import Signal
from klute_sim.mocap.strides import loads
from klute_sim.mocap.strides.loads import GroundReaction

MOTION_CHANNELS = ("shank_angle", "ankle_x", "ankle_z")


@dataclass(frozen=True, eq=False)
class ProsthesisKinematics:
    """Motion and loads of one trial, not filtered."""

    channels: Mapping[str, Signal]
    """Those of :data:`MOTION`; angle [deg], places [m] in the frame of the loads."""
    loads: Mapping[Side, GroundReaction]
    from_plates: bool
    """Whether the loads are force plates', in the frame of the motion."""
    ankle_angle: Signal | None = None
    """Angle between shank and the line from heel to toe [deg], of markers."""


def find_named_sides(trial: Sequence[SourceFile], options: ImportOptions) -> set[Side]:
    """Legs that the files of ``trial`` tell of by name."""
    found: set[Side] = set()
    for source in trial:
        if source.markers is not None:
            roles = markers.identify_markers(source.markers, options.mapping, source.name)
            found |= {side for side in SIDES if roles.select(side, "ankle") or roles.select(side, "shank")}
        for label in source.labels:
            meant = channel_names.parse_channel_label(label.split("[")[0].strip())
            if meant is not None and meant.side is not None and meant.channel in channel_names.ANGLE_CHANNELS:
                found.add(meant.side)
    return found | {side for side in SIDES if any(owner == side for owner, _ in options.mapping.channels)}


def extract_kinematics(
    trial: Sequence[SourceFile], side: Side, options: ImportOptions, log: ImportLog
) -> ProsthesisKinematics | None:
    """Of the leg of ``side``, from markers or from columns; None where something is missing, which is noted."""
    where = trial[0].name
    captured = next((source for source in trial if source.markers is not None), None)
    if captured is not None:
        return _extract_from_markers(trial, captured, side, where, options, log)
    found = {name: channel_lookup.find_column(trial, name, side, options) for name in MOTION_CHANNELS}
    lacking = [name for name, column in found.items() if column is None]
    if lacking:
        log.add_missing(
            f"{where}: nothing says how the {side} shank leans and where its ankle is: add the markers (.trc, .c3d) or "
            f"name a column of {' and '.join(lacking)} in a file for --map, under [{side}]"
        )
        return None
    on = loads.read_foot_loads(trial, options, log)
    plates = loads.read_plate_loads(trial, None, log) if side not in on else {}
    if plates:
        knees: dict[Side, dict[str, Column]] = {}
        for one in SIDES:
            knee = channel_lookup.find_column(trial, "knee_angle", one, options)
            knees[one] = {} if knee is None else {"knee_angle": knee}
        clock, apart = from_joint_angles.compute_knee_difference(knees)
        on = loads.assign_to_feet(plates, SIDES if len(clock) else [side], clock, apart, where, options, log)
    channels = {}
    for name, column in found.items():
        if column is not None:
            channels[name] = Signal(
                column.time, filters.fill_gaps(channel_lookup.apply_given_sign(column, side, log), column.time)
            )
    return ProsthesisKinematics(channels, on, bool(plates))


def _extract_from_markers(
    trial: Sequence[SourceFile], source: SourceFile, side: Side, trial_name: str, options: ImportOptions, log: ImportLog
) -> ProsthesisKinematics | None:
    assert source.markers is not None
    roles = markers.identify_markers(source.markers, options.mapping, trial_name)
    frame = markers.find_walking_frame(source.markers, roles, options.mapping, trial_name, log)
    raw = from_markers.preprocess_markers(source.markers, frame, 0.0, trial_name)
    both = {
        one: from_markers.locate_landmarks(raw, roles, one, trial_name, log if one == side else ImportLog())
        for one in SIDES
    }
    leg, right, left = both[side], both["right"], both["left"]
    if leg is None:
        return None
    on = loads.read_foot_loads(trial, options, log)
    plates = loads.read_plate_loads(trial, frame, log) if side not in on else {}
    if plates:
        apart = right.knee_angle - left.knee_angle if right and left else np.full(len(raw.time), np.nan)
        known = [one for one in SIDES if both[one] is not None]
        on = loads.assign_to_feet(plates, known, raw.time, apart, trial_name, options, log)
    level = _estimate_ground_height(on[side]) if plates and side in on else 0.0
    log.add_derived("Inclination of the shank: of the line from ankle to knee, in the plane of walking")
    channels = {
        "shank_angle": Signal(leg.time, leg.shank_angle),
        "ankle_x": Signal(leg.time, leg.ankle[:, 0]),
        "ankle_z": Signal(leg.time, leg.ankle[:, 1] - level),
    }
    return ProsthesisKinematics(channels, on, bool(plates), Signal(leg.time, leg.shank_angle - leg.foot_pitch))


def _estimate_ground_height(load: GroundReaction) -> float:
    """Height of the ground [m] in the laboratory: that of the centre of pressure."""
    if load.cop is None:
        return 0.0
    known = load.cop[np.isfinite(load.cop[:, 1]) & (load.vertical > CONTACT_FORCE_THRESHOLD), 1]
    return float(np.median(known)) if len(known) else 0.0
