"""One trial's files to its legs, by joint angles where there are some, by markers otherwise."""

from collections.abc import Sequence

import numpy as np

from klute_sim.gait.reference import GRAVITY
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import dynamics, from_joint_angles, from_markers
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_lookup, channel_names, markers
from klute_sim.mocap.parsing.channel_names import SIDES
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.mocap.strides import loads
from klute_sim.mocap.strides.leg import LegChannels
from klute_sim.mocap.strides.postprocess import ResampledLoads, apply_zero, compute_ankle_power, resample_loads

REQUIRED_ANGLES = ("knee_angle", "ankle_angle")


def extract_legs(trial: Sequence[SourceFile], options: ImportOptions, log: ImportLog) -> list[LegChannels]:
    """The legs of one trial that have all that a stride needs; what the others lack is noted."""
    where = trial[0].name
    captured = next((source for source in trial if source.markers is not None), None)
    found = {side: {n: channel_lookup.find_column(trial, n, side, options) for n in REQUIRED_ANGLES} for side in SIDES}
    angles = any(all(of.values()) for of in found.values())
    moments = any(
        channel_lookup.find_column(trial, channel_names.ANKLE_MOMENT, side, options) is not None for side in SIDES
    )
    if angles and (moments or captured is None):
        return from_joint_angles.legs_from_joint_angles(trial, where, options, log)
    if captured is not None and captured.markers is not None:
        if angles:
            files = sorted({column.file_name for of in found.values() for column in of.values() if column is not None})
            log.add_derived(
                f"{captured.name}: joint angles and the ankle's moment are from its markers; the angles in "
                f"{', '.join(files)} come without a moment and were left out"
            )
        return _legs_from_markers(trial, captured, where, options, log)
    log.add_missing(f"{where}: neither knee and ankle angles of one leg nor markers were recognised")
    return []


def _legs_from_markers(
    trial: Sequence[SourceFile], source: SourceFile, trial_name: str, options: ImportOptions, log: ImportLog
) -> list[LegChannels]:
    assert source.markers is not None
    roles = markers.identify_markers(source.markers, options.mapping, trial_name)
    frame = markers.find_walking_frame(source.markers, roles, options.mapping, trial_name, log)
    smooth = from_markers.preprocess_markers(source.markers, frame, options.motion_cutoff, trial_name)
    both = {side: from_markers.locate_landmarks(smooth, roles, side, trial_name, log) for side in SIDES}
    known = {side: leg for side, leg in both.items() if leg is not None}
    on = loads.read_foot_loads(trial, options, log)
    plates = loads.read_plate_loads(trial, frame, log)
    if plates and not on:
        right, left = both["right"], both["left"]
        bend = right.knee_angle - left.knee_angle if right and left else np.full(len(smooth.time), np.nan)
        on = loads.assign_to_feet(plates, list(known), smooth.time, bend, trial_name, options, log)
    result = []
    for side, leg in known.items():
        if side not in on:
            log.add_missing(f"{trial_name}: no ground reaction of the {side} foot; without it there is no heel strike")
            continue
        foot = resample_loads(on[side], leg.time, side, trial_name, options, log)
        angles = {
            "hip_angle": -leg.thigh_angle,
            "knee_angle": leg.knee_angle,
            "ankle_angle": leg.shank_angle - leg.foot_pitch,
            "shank_angle": leg.shank_angle,
        }
        log.add_derived("Joint angles: inclinations of the lines between joint centres, in the plane of walking")
        log.add_derived("Hip flexion: of the thigh against the vertical, not against the pelvis")
        apply_zero(leg.time, angles, False, foot.contacts, side, trial_name, options, log)
        channels = angles | {channel_names.GRF_VERTICAL: foot.vertical, channel_names.GRF_FORWARD: foot.forward}
        if foot.cop is None:
            log.add_missing(f"{trial_name}: no centre of pressure, so no ankle moment of the {side} leg")
        else:
            mass = options.mass or _estimate_body_mass(foot)
            moment = dynamics.compute_ankle_moment(leg, foot.forward, foot.vertical, foot.cop, mass)
            channels[channel_names.ANKLE_MOMENT] = moment
            channels[channel_names.ANKLE_POWER] = compute_ankle_power(leg.time, moment, angles["ankle_angle"])
            log.add_derived(
                "Ankle moment: inverse dynamics of the foot in the sagittal plane, a rigid body of Winter's mass and "
                "inertia, under the ground reaction"
            )
            log.add_derived("Ankle power: moment times plantarflexion rate")
        speed = _estimate_walking_speed(leg, foot)
        result.append(LegChannels(side, trial_name, leg.time, channels, foot.contacts, speed, impulses=foot.impulses))
    return result


def _estimate_body_mass(foot: ResampledLoads) -> float:
    """Body mass [kg] good enough for the foot's own: both feet together carry it, each for half of the time."""
    return 2.0 * float(np.nanmean(foot.vertical)) / GRAVITY


def _estimate_walking_speed(landmarks: from_markers.LegLandmarks, foot: ResampledLoads) -> float | None:
    """How fast the hip passes over the ground [m/s]: its way, plus what a treadmill carries the standing foot back.

    None without a whole stance.
    """
    carried = []
    for c in foot.contacts:
        if c.has_foot_strike and c.has_toe_off:
            span = c.toe_off - c.foot_strike
            start, end = (np.searchsorted(landmarks.time, c.foot_strike + share * span) for share in (0.25, 0.5))
            if 0 < start < end < len(landmarks.time):
                carried.append(
                    (landmarks.heel[end, 0] - landmarks.heel[start, 0]) / (landmarks.time[end] - landmarks.time[start])
                )
    known = np.isfinite(landmarks.hip[:, 0])
    if not carried or not np.isfinite(carried).all() or known.sum() < 2:
        return None
    travelled = float(np.polyfit(landmarks.time[known], landmarks.hip[known, 0], 1)[0])
    return travelled - float(np.mean(carried))
