"""Legs of one trial, from joint angles if there are usable ones, otherwise from markers."""

from collections.abc import Sequence

import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.datasets.trial import TimeSeries
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import checks, dynamics, from_markers, loads
from klute_sim.mocap.kinematics.from_joint_angles import extract_legs_from_joint_angles
from klute_sim.mocap.kinematics.from_markers import LegLandmarks
from klute_sim.mocap.kinematics.leg import Leg
from klute_sim.mocap.kinematics.postprocess import ResampledLoads, apply_zero, compute_ankle_power, resample_loads
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names, markers
from klute_sim.mocap.parsing.channel_lookup import find_column
from klute_sim.mocap.parsing.channel_names import SIDES
from klute_sim.mocap.parsing.missing_columns import describe_missing_load, describe_missing_quantities
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.mocap.strides.strides import STANCE_FRACTION

REQUIRED_ANGLES = ("knee_angle", "ankle_angle")
"""Angles that a leg from joint angles needs."""


def extract_legs(trial: Sequence[SourceFile], options: ImportOptions, log: ImportLog) -> list[Leg]:
    """Return the legs of one trial with all data that a stride needs, and log what the others lack."""
    trial_name = trial[0].name
    capture = next((source for source in trial if source.markers is not None), None)
    columns = {side: {n: find_column(trial, n, side, options) for n in REQUIRED_ANGLES} for side in SIDES}
    has_angles = any(all(side_columns.values()) for side_columns in columns.values())
    has_moment = any(find_column(trial, channel_names.ANKLE_MOMENT, side, options) is not None for side in SIDES)
    if has_angles and (has_moment or capture is None):
        return extract_legs_from_joint_angles(trial, trial_name, options, log)
    if capture is not None:
        if has_angles:
            angle_files = sorted({c.file_name for side_columns in columns.values() for c in side_columns.values() if c})
            log.add_derived(
                f"{capture.name}: joint angles and the ankle moment are computed from its markers; the angles in "
                f"{', '.join(angle_files)} have no moment and were ignored"
            )
        return _extract_legs_from_markers(trial, capture, trial_name, options, log)
    log.add_missing(
        f"{trial_name}: neither knee and ankle angles of one leg nor markers were recognised; still needed for "
        f"{describe_missing_quantities(trial, options)}"
    )
    return []


def _extract_legs_from_markers(
    trial: Sequence[SourceFile], source: SourceFile, trial_name: str, options: ImportOptions, log: ImportLog
) -> list[Leg]:
    assert source.markers is not None
    roles = markers.identify_markers(source.markers, options.mapping, source.name)
    frame = markers.find_walking_frame(source.markers, roles, options.mapping, source.name, log)
    filtered = from_markers.preprocess_markers(source.markers, frame, options.motion_cutoff, source.name)
    located = {side: from_markers.locate_landmarks(filtered, roles, side, source.name, log) for side in SIDES}
    landmarks_by_side = {side: landmarks for side, landmarks in located.items() if landmarks is not None}
    findings = checks.find_landmark_findings(landmarks_by_side, options.stature, source.name)
    log.require_accepted(findings, options.accept)
    foot_loads = loads.read_foot_loads(trial, options, log)
    plates = loads.read_plate_loads(trial, frame, log)
    if plates and not foot_loads:
        right, left = located["right"], located["left"]
        knee_difference = right.knee_angle - left.knee_angle if right and left else np.full(len(filtered.time), np.nan)
        sides = list(landmarks_by_side)
        ankles = {side: TimeSeries(leg.time, leg.ankle[:, 0]) for side, leg in landmarks_by_side.items()}
        foot_loads = loads.assign_to_feet(plates, sides, filtered.time, knee_difference, options, log, ankles)
    log.require_accepted(checks.find_cop_findings(landmarks_by_side, foot_loads), options.accept)
    legs = []
    for side, landmarks in landmarks_by_side.items():
        if side not in foot_loads:
            log.add_missing(f"{trial_name}: {describe_missing_load(trial, side, options)}")
            continue
        foot = resample_loads(foot_loads[side], landmarks.time, side, options, log)
        angles = {
            "hip_angle": -landmarks.thigh_angle,
            "knee_angle": landmarks.knee_angle,
            "ankle_angle": landmarks.shank_angle - landmarks.foot_pitch,
            "shank_angle": landmarks.shank_angle,
        }
        log.add_derived("Joint angles: inclinations of the lines between joint centres, in the sagittal plane")
        log.add_derived("Hip flexion: angle of the thigh to the vertical, not to the pelvis")
        apply_zero(landmarks.time, angles, False, foot.contacts, side, source.name, options, log)
        channels = angles | {channel_names.GRF_VERTICAL: foot.vertical, channel_names.GRF_FORWARD: foot.forward}
        if foot.cop is None:
            log.add_missing(
                f"{foot_loads[side].file_name}: no centre of pressure, so no ankle moment of the {side} leg"
            )
        else:
            mass = options.mass or _estimate_body_mass(foot)
            moment = dynamics.compute_ankle_moment(landmarks, foot.forward, foot.vertical, foot.cop, mass)
            channels[channel_names.ANKLE_MOMENT] = moment
            channels[channel_names.ANKLE_POWER] = compute_ankle_power(landmarks.time, moment, angles["ankle_angle"])
            log.add_derived(
                "Ankle moment: inverse dynamics of the foot in the sagittal plane, a rigid body with Winter's mass and "
                "inertia, under the ground reaction"
            )
            log.add_derived("Ankle power: moment times plantarflexion rate")
        speed = _estimate_walking_speed(landmarks, foot)
        legs.append(Leg(side, trial_name, landmarks.time, channels, foot.contacts, speed, impulses=foot.impulses))
    return legs


def _estimate_body_mass(foot: ResampledLoads) -> float:
    """Return the body mass [kg], accurate enough for the inertia of the foot; 0 without a complete contact.

    Each foot carries half of the impulse of a stride, of which it stands for a typical fraction.
    """
    durations = [c.toe_off - c.foot_strike for c in foot.contacts if c.has_foot_strike and c.has_toe_off]
    if not durations or not foot.impulses:
        return 0.0
    return 2.0 * STANCE_FRACTION * float(np.mean(foot.impulses) / (np.mean(durations) * GRAVITY))


def _estimate_walking_speed(landmarks: LegLandmarks, foot: ResampledLoads) -> float | None:
    """Return the speed of the hip relative to the standing foot [m/s], on the ground or on a treadmill.

    Returns None without a complete stance.
    """
    foot_speeds = []
    for c in foot.contacts:
        if c.has_foot_strike and c.has_toe_off:
            duration = c.toe_off - c.foot_strike
            start, end = (np.searchsorted(landmarks.time, c.foot_strike + f * duration) for f in (0.25, 0.5))
            if 0 < start < end < len(landmarks.time):
                distance = landmarks.heel[end, 0] - landmarks.heel[start, 0]
                foot_speeds.append(distance / (landmarks.time[end] - landmarks.time[start]))
    known = np.isfinite(landmarks.hip[:, 0])
    if not foot_speeds or not np.isfinite(foot_speeds).all() or known.sum() < 2:
        return None
    hip_speed = float(np.polyfit(landmarks.time[known], landmarks.hip[known, 0], 1)[0])
    return hip_speed - float(np.mean(foot_speeds))
