"""Motion that a replay prescribes to a prosthesis in one trial: shank inclination, ankle position and foot loads."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD, MOTION_CHANNELS
from klute_sim.datasets.trial import TimeSeries
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import checks, filters, from_joint_angles, from_markers, loads
from klute_sim.mocap.kinematics.loads import GroundReaction
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names, markers
from klute_sim.mocap.parsing.channel_lookup import Column, apply_given_sign, find_column
from klute_sim.mocap.parsing.channel_names import SIDES, Side
from klute_sim.mocap.parsing.sources import SourceFile

REQUIRED_LANDMARKS = ("knee", "ankle")
"""Landmarks that determine the inclination of the shank and the position of the ankle."""


@dataclass(frozen=True, eq=False)
class ProsthesisKinematics:
    """Unfiltered motion and loads of one trial."""

    channels: Mapping[str, TimeSeries]
    """:data:`~klute_sim.datasets.channels.MOTION_CHANNELS`: angle [deg], positions [m] in the frame of the loads."""
    loads: Mapping[Side, GroundReaction]
    """Ground reaction of each foot."""
    from_plates: bool
    """Whether the loads come from force plates in the frame of the motion."""
    ankle_angle: TimeSeries | None = None
    """Angle between the shank and the line from heel to toe by markers [deg]; None without markers of the foot."""


def find_named_sides(trial: Sequence[SourceFile], options: ImportOptions) -> set[Side]:
    """Return the sides of the legs that the files or the mapping of ``trial`` name."""
    sides: set[Side] = set()
    for source in trial:
        if source.markers is not None:
            roles = markers.identify_markers(source.markers, options.mapping, source.name)
            sides |= {side for side in SIDES if roles.select(side, "ankle") or roles.select(side, "shank")}
        for label in source.labels:
            parsed = channel_names.parse_channel_label(label)
            if parsed is not None and parsed.side is not None and parsed.channel in channel_names.ANGLE_CHANNELS:
                sides.add(parsed.side)
    return sides | {side for side in SIDES if any(section == side for section, _ in options.mapping.channels)}


def extract_kinematics(
    trial: Sequence[SourceFile], side: Side, options: ImportOptions, log: ImportLog
) -> ProsthesisKinematics | None:
    """Return motion and loads of the leg of ``side`` from markers, or from columns if there are no markers.

    Returns None and logs the reason if data are missing.
    """
    trial_name = trial[0].name
    capture = next((source for source in trial if source.markers is not None), None)
    if capture is not None:
        return _extract_from_markers(trial, capture, side, options, log)
    columns = {name: find_column(trial, name, side, options) for name in MOTION_CHANNELS}
    missing = [name for name, column in columns.items() if column is None]
    if missing:
        log.add_missing(
            f"{trial_name}: the inclination of the {side} shank or the position of its ankle is unknown: add the "
            f"markers (.trc, .c3d) or name a column of {' and '.join(missing)} in a file for --map, under [{side}]"
        )
        return None
    channels = {}
    for name, column in columns.items():
        if column is not None:
            time, values = filters.insert_missing_samples(column.time, apply_given_sign(column, side, log))
            channels[name] = TimeSeries(time, filters.fill_gaps(values, time))
    foot_loads = loads.read_foot_loads(trial, options, log)
    plates = loads.read_plate_loads(trial, None, log) if side not in foot_loads else {}
    if plates:
        knees: dict[Side, dict[str, Column]] = {}
        for knee_side in SIDES:
            knee = find_column(trial, "knee_angle", knee_side, options)
            knees[knee_side] = {} if knee is None else {"knee_angle": knee}
        knee_time, knee_difference = from_joint_angles.compute_knee_difference(knees)
        legs = SIDES if len(knee_time) else [side]
        ankles = {side: channels["ankle_x"]}
        foot_loads = loads.assign_to_feet(plates, legs, knee_time, knee_difference, options, log, ankles)
    return ProsthesisKinematics(channels, foot_loads, bool(plates))


def _extract_from_markers(
    trial: Sequence[SourceFile], source: SourceFile, side: Side, options: ImportOptions, log: ImportLog
) -> ProsthesisKinematics | None:
    assert source.markers is not None
    roles = markers.identify_markers(source.markers, options.mapping, source.name)
    frame = markers.find_walking_frame(source.markers, roles, options.mapping, source.name, log)
    unfiltered = from_markers.preprocess_markers(source.markers, frame, 0.0, source.name)
    landmarks = {
        s: from_markers.locate_landmarks(
            *(unfiltered, roles, s, source.name, log if s == side else ImportLog()), required=REQUIRED_LANDMARKS
        )
        for s in SIDES
    }
    leg, right, left = landmarks[side], landmarks["right"], landmarks["left"]
    if leg is None:
        return None
    located = {s: one for s, one in landmarks.items() if one is not None}
    log.require_accepted(checks.find_landmark_findings(located, options.stature, source.name), options.accept)
    foot_loads = loads.read_foot_loads(trial, options, log)
    plates = loads.read_plate_loads(trial, frame, log) if side not in foot_loads else {}
    if plates:
        knee_difference = (
            right.knee_angle - left.knee_angle if right and left else np.full(len(unfiltered.time), np.nan)
        )
        legs = [s for s in SIDES if landmarks[s] is not None]
        ankles = {s: TimeSeries(one.time, one.ankle[:, 0]) for s, one in located.items()}
        foot_loads = loads.assign_to_feet(plates, legs, unfiltered.time, knee_difference, options, log, ankles)
    log.require_accepted(checks.find_cop_findings({side: leg}, foot_loads), options.accept)
    ground_height = _estimate_ground_height(foot_loads[side]) if plates and side in foot_loads else 0.0
    log.add_derived("Shank inclination: line from ankle to knee, in the sagittal plane")
    channels = {
        "shank_angle": TimeSeries(leg.time, leg.shank_angle),
        "ankle_x": TimeSeries(leg.time, leg.ankle[:, 0]),
        "ankle_z": TimeSeries(leg.time, leg.ankle[:, 1] - ground_height),
    }
    ankle_angle = leg.shank_angle - leg.foot_pitch
    has_foot = bool(np.isfinite(ankle_angle).any())
    return ProsthesisKinematics(
        channels, foot_loads, bool(plates), TimeSeries(leg.time, ankle_angle) if has_foot else None
    )


def _estimate_ground_height(load: GroundReaction) -> float:
    """Return the height of the ground in the laboratory frame [m]: the median height of the centre of pressure."""
    if load.cop is None:
        return 0.0
    known = load.cop[np.isfinite(load.cop[:, 1]) & (load.vertical > CONTACT_FORCE_THRESHOLD), 1]
    return float(np.median(known)) if len(known) else 0.0
