"""Legs from joint angles of other programs: OpenSim's inverse kinematics, or the software of a treadmill."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from klute_sim.datasets.trial import TimeSeries
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import checks, filters, from_markers, loads
from klute_sim.mocap.kinematics.leg import Leg
from klute_sim.mocap.kinematics.loads import GroundReaction
from klute_sim.mocap.kinematics.postprocess import apply_sign, apply_zero, compute_ankle_power, resample_loads
from klute_sim.mocap.kinematics.quasistatic_moment import (
    ANKLE_FORWARD,
    ANKLE_HEIGHT,
    add_cop,
    compute_quasistatic_moment,
    describe_missing_positions,
)
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names, markers, time_sync
from klute_sim.mocap.parsing.channel_lookup import Column, apply_given_sign, find_column
from klute_sim.mocap.parsing.channel_names import SIDES, Side
from klute_sim.mocap.parsing.markers import WalkingFrame
from klute_sim.mocap.parsing.missing_columns import describe_missing_load
from klute_sim.mocap.parsing.sources import OPENSIM_STORAGE, SourceFile
from klute_sim.plausibility.gait.steps import Series
from klute_sim.types import Array

MIN_PELVIS_TRAVEL = 0.5
"""Shortest distance [m] that the pelvis travels in overground walking; less is treadmill walking."""
MIN_PELVIS_TILT = 2.0
"""Smallest median tilt of the pelvis [deg] that shows its sign; people walk with the pelvis tilted forward by about 10
degrees (assumed: nobody walks with it tilted backward by more than this)."""
LEG_COLUMNS = (
    *(name for name in channel_names.ANGLE_CHANNELS if name != channel_names.PELVIS_TILT),
    channel_names.ANKLE_MOMENT,
    *channel_names.POSITION_CHANNELS,
)
"""Channels of a leg that files with joint angles may contain."""


@dataclass(frozen=True, eq=False)
class _UniformClock:
    """Uniform times of a leg, to which other columns are resampled."""

    time: Array
    """Uniform sample times (n,) [s]."""

    def resample(self, column: Column, values: Array, cutoff: float) -> Array:
        """Return ``values`` of ``column``, filtered at ``cutoff`` [Hz], at these times; NaN outside the column."""
        time, complete = filters.insert_missing_samples(column.time, values)
        column_time = filters.make_uniform_time(time, column.source.path)
        uniform = filters.resample_uniform(column_time, time, filters.fill_gaps(complete, time))
        rate = (len(column_time) - 1) / (column_time[-1] - column_time[0])
        filtered = filters.low_pass(uniform, rate, cutoff)
        return np.asarray(np.interp(self.time, column_time, filtered, left=np.nan, right=np.nan), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _BodyColumns:
    """Channels common to both legs."""

    pelvis_tilt: Column | None
    """Tilt of the pelvis, backward positive; None if unknown."""
    belt_speed: Column | None
    """Speed of the treadmill belt; None if unknown."""
    walking_speed: float | None
    """Walking speed [m/s]; None if unknown."""


def extract_legs_from_joint_angles(
    trial: Sequence[SourceFile], trial_name: str, options: ImportOptions, log: ImportLog
) -> list[Leg]:
    """Return the legs of ``trial`` that have knee and ankle angles and a ground reaction."""
    leg_columns: dict[Side, dict[str, Column]] = {}
    for side in SIDES:
        columns = {name: find_column(trial, name, side, options) for name in LEG_COLUMNS}
        leg_columns[side] = {name: column for name, column in columns.items() if column is not None}
    body = _find_body_columns(trial, options, log)
    foot_loads = loads.read_foot_loads(trial, options, log)
    capture = None if foot_loads else _find_capture(trial)
    frame = None if capture is None else _find_walking_frame(capture, leg_columns, options, log)
    plates = loads.read_plate_loads(trial, frame, log) if not foot_loads else {}
    if plates:
        sides = [side for side, columns in leg_columns.items() if "knee_angle" in columns]
        time, knee_difference = compute_knee_difference(leg_columns)
        foot_loads = loads.assign_to_feet(plates, sides, time, knee_difference, options, log)
    legs = []
    for side, side_columns in leg_columns.items():
        if "knee_angle" not in side_columns or "ankle_angle" not in side_columns:
            continue
        if side not in foot_loads:
            log.add_missing(f"{trial_name}: {describe_missing_load(trial, side, options)}")
            continue
        leg = _build_leg(side, side_columns, body, foot_loads[side], trial_name, options, log)
        legs += [leg] if leg else []
    return legs


def _find_body_columns(trial: Sequence[SourceFile], options: ImportOptions, log: ImportLog) -> _BodyColumns:
    pelvis_x = find_column(trial, channel_names.PELVIS_X, None, options)
    belt_columns = [find_column(trial, channel_names.BELT_SPEED, side, options) for side in (None, *SIDES)]
    belt_speed = next((column for column in belt_columns if column is not None), None)
    pelvis_tilt = find_column(trial, channel_names.PELVIS_TILT, None, options)
    for column in (belt_speed, pelvis_x):
        if column is not None:
            sign = (column.spec and column.spec.sign) or 1
            reason = f"unit {column.unit_reason}" if column.spec is None else "as specified"
            _log_body_column(column, sign, 0.0, reason, log)
    if pelvis_tilt is not None:
        pelvis_tilt = _apply_tilt_sign(pelvis_tilt, log)
    return _BodyColumns(pelvis_tilt, belt_speed, _estimate_speed(pelvis_x))


def _apply_tilt_sign(column: Column, log: ImportLog) -> Column:
    """Return the tilt of the pelvis with the standard sign, backward positive, and log the reason."""
    spec, median = column.spec, float(np.nanmedian(column.values))
    if spec is not None and spec.sign is not None:
        sign, reason = spec.sign, "as specified"
    elif column.source.file_type == OPENSIM_STORAGE:
        sign, reason = 1, "backward positive, as in OpenSim"
    elif abs(median) >= MIN_PELVIS_TILT:
        sign, reason = (-1 if median > 0.0 else 1), "people walk with the pelvis tilted forward"
    else:
        sign, reason = 1, "backward positive, as in OpenSim; the tilt is too small to show it"
    zero = (spec and spec.zero) or 0.0
    _log_body_column(column, sign, zero, f"unit {column.unit_reason}; sign: {reason}", log)
    return replace(column, values=sign * column.values - (column.zero or 0.0))


def _log_body_column(column: Column, sign: int, zero: float, reason: str, log: ImportLog) -> None:
    log.add_channel(
        **{"channel": column.channel, "side": "body", "file": column.file_name, "column": column.label},
        **{"unit": column.unit, "sign": sign, "zero": zero, "reason": reason},
    )


def _find_capture(trial: Sequence[SourceFile]) -> SourceFile | None:
    """Return the C3D file with force plates and markers; None if there is none."""
    return next((source for source in trial if source.plates and source.markers is not None), None)


def _find_walking_frame(
    capture: SourceFile, leg_columns: Mapping[Side, Mapping[str, Column]], options: ImportOptions, log: ImportLog
) -> WalkingFrame:
    """Return the walking frame by the markers of ``capture``, whose clock is compared with that of the knee angles."""
    assert capture.markers is not None
    roles = markers.identify_markers(capture.markers, options.mapping, capture.name)
    frame = markers.find_walking_frame(capture.markers, roles, options.mapping, capture.name, log)
    moved = from_markers.preprocess_markers(capture.markers, frame, options.motion_cutoff, capture.name)
    for side, columns in leg_columns.items():
        landmarks = from_markers.locate_landmarks(moved, roles, side, capture.name, ImportLog())
        if landmarks is not None and "knee_angle" in columns:
            knee = columns["knee_angle"]
            by_markers = TimeSeries(landmarks.time, landmarks.knee_angle)
            by_angles = TimeSeries(knee.time, apply_sign(knee, (), side, ImportLog()))
            quantity = f"the {side} knee angle"
            time_sync.compare_clocks(quantity, (capture.name, by_markers), (knee.file_name, by_angles), log)
    return frame


def _estimate_speed(pelvis_x: Column | None) -> float | None:
    """Return the speed [m/s] of a pelvis that travels through the laboratory; None on a treadmill."""
    if pelvis_x is None or abs(pelvis_x.values[-1] - pelvis_x.values[0]) < MIN_PELVIS_TRAVEL:
        return None
    return abs(float(np.polyfit(pelvis_x.time, pelvis_x.values, 1)[0]))


def compute_knee_difference(leg_columns: Mapping[Side, Mapping[str, Column]]) -> tuple[Array, Array]:
    """Return times [s] and the flexion of the right knee minus that of the left [deg]; empty arrays without both."""
    knees = [leg_columns[side].get("knee_angle") for side in SIDES]
    if knees[0] is None or knees[1] is None:
        return np.zeros(0), np.zeros(0)
    right, left = (apply_sign(knee, (), side, ImportLog()) for knee, side in zip(knees, SIDES, strict=True) if knee)
    return knees[0].time, np.asarray(right - np.interp(knees[0].time, knees[1].time, left), dtype=np.float64)


def _build_leg(
    side: Side,
    leg_columns: Mapping[str, Column],
    body: _BodyColumns,
    load: GroundReaction,
    trial_name: str,
    options: ImportOptions,
    log: ImportLog,
) -> Leg | None:
    knee = leg_columns["knee_angle"]
    knee_time, _ = filters.insert_missing_samples(knee.time, knee.values)
    clock = _UniformClock(filters.make_uniform_time(knee_time, knee.source.path))
    has_moment = channel_names.ANKLE_MOMENT in leg_columns
    load = load if has_moment else add_cop(load, leg_columns, side, options, log)
    foot = resample_loads(load, clock.time, side, options, log)
    angles = {
        name: clock.resample(column, apply_sign(column, foot.contacts, side, log), options.motion_cutoff)
        for name, column in leg_columns.items()
        if name in channel_names.ANGLE_CHANNELS
    }
    findings = checks.find_side_findings(Series(clock.time, angles["knee_angle"]), foot.contacts, side, knee.file_name)
    log.require_accepted(findings, options.accept)
    shank_zero_is_free = _derive_shank_angle(angles, body.pelvis_tilt, clock, log, options.motion_cutoff)
    if shank_zero_is_free is None:
        log.add_missing(
            f"{trial_name}: neither a hip angle nor an inclination of the {side} thigh or shank, so the inclination of "
            "the leg is unknown"
        )
        return None
    ankle_file = leg_columns["ankle_angle"].file_name
    apply_zero(clock.time, angles, shank_zero_is_free, foot.contacts, side, ankle_file, options, log)
    channels = {name: angles[name] for name in ("hip_angle", "knee_angle", "ankle_angle", "shank_angle")}
    channels |= {channel_names.GRF_VERTICAL: foot.vertical, channel_names.GRF_FORWARD: foot.forward}
    moment = None
    if has_moment:
        column = leg_columns[channel_names.ANKLE_MOMENT]
        moment = clock.resample(column, apply_sign(column, foot.contacts, side, log), options.load_cutoff)
    elif ANKLE_FORWARD in leg_columns and ANKLE_HEIGHT in leg_columns:
        ankle = {
            name: clock.resample(
                leg_columns[name], apply_given_sign(leg_columns[name], side, log), options.motion_cutoff
            )
            for name in (ANKLE_FORWARD, ANKLE_HEIGHT)
        }
        place = f"file {load.file_name}, {side} foot"
        moment = compute_quasistatic_moment(clock.time, foot, ankle, place, options, log)
    if moment is not None:
        channels[channel_names.ANKLE_MOMENT] = moment
        channels[channel_names.ANKLE_POWER] = compute_ankle_power(clock.time, moment, angles["ankle_angle"])
        log.add_derived("Ankle power: moment times plantarflexion rate")
    else:
        log.add_missing(
            f"{trial_name}: no ankle moment of the {side} leg, which angles and ground reaction do not determine: add "
            "a column 'Ankle moment [N*m/kg]', the inverse dynamics (.sto), the markers (.trc, .c3d), or "
            f"{describe_missing_positions(leg_columns, foot.cop is not None)}"
        )
    belt = body.belt_speed
    belt_speed = None if belt is None else np.interp(clock.time, belt.time, belt.values)
    return Leg(side, trial_name, clock.time, channels, foot.contacts, body.walking_speed, belt_speed, foot.impulses)


def _derive_shank_angle(
    angles: dict[str, Array], pelvis_tilt: Column | None, clock: _UniformClock, log: ImportLog, cutoff: float
) -> bool | None:
    """Add missing shank and hip angles to ``angles``.

    Returns whether the zero of the shank angle is free; None if the angles cannot be computed.
    """
    knee = angles["knee_angle"]
    if "shank_angle" not in angles and "thigh_angle" in angles:
        angles["shank_angle"] = angles["thigh_angle"] + knee
        log.add_derived("Shank inclination: thigh inclination plus knee flexion")
    if "shank_angle" in angles:
        if "hip_angle" not in angles:
            angles["hip_angle"] = knee - angles["shank_angle"]
            log.add_derived("Hip flexion: angle of the thigh to the vertical, not to the pelvis")
        return False
    if "hip_angle" not in angles:
        return None
    if pelvis_tilt is None:
        angles["shank_angle"] = knee - angles["hip_angle"]
        return True
    angles["shank_angle"] = knee - angles["hip_angle"] - clock.resample(pelvis_tilt, pelvis_tilt.values, cutoff)
    log.add_derived("Shank inclination: knee flexion minus hip flexion minus pelvis tilt (backward positive)")
    return False
