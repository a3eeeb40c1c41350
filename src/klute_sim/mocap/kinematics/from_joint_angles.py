"""Legs from joint angles that somebody else computed: OpenSim's inverse kinematics, a treadmill's software."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import filters
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_lookup, channel_names, markers
from klute_sim.mocap.parsing.channel_lookup import Column
from klute_sim.mocap.parsing.channel_names import SIDES, Side
from klute_sim.mocap.parsing.markers import WalkingFrame
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.mocap.strides import loads
from klute_sim.mocap.strides.leg import LegChannels
from klute_sim.mocap.strides.loads import GroundReaction
from klute_sim.mocap.strides.postprocess import apply_sign, apply_zero, compute_ankle_power, resample_loads
from klute_sim.recording.recording import Array

MIN_PELVIS_TRAVEL = 0.5
"""Way of the pelvis [m] below which it walked on a treadmill."""
LEG_COLUMNS = (
    *(name for name in channel_names.ANGLE_CHANNELS if name != channel_names.PELVIS_TILT),
    channel_names.ANKLE_MOMENT,
)


@dataclass(frozen=True, eq=False)
class _UniformClock:
    """The clock of a leg's angles, and other columns brought to it."""

    time: Array

    def resample(self, column: Column, values: Array, cutoff: float) -> Array:
        """``values`` of ``column`` filtered at ``cutoff`` [Hz], at this clock; NaN outside of the column's own time."""
        own = filters.make_uniform_time(column.time, column.source.path)
        whole = filters.resample_uniform(own, column.time, filters.fill_gaps(values, column.time))
        smooth = filters.low_pass(whole, (len(own) - 1) / (own[-1] - own[0]), cutoff)
        return np.asarray(np.interp(self.time, own, smooth, left=np.nan, right=np.nan), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _BodyColumns:
    """What is not of one leg."""

    pelvis_tilt: Column | None
    belt_speed: Column | None
    walking_speed: float | None


def legs_from_joint_angles(
    trial: Sequence[SourceFile], trial_name: str, options: ImportOptions, log: ImportLog
) -> list[LegChannels]:
    """The legs of ``trial`` by its joint angles."""
    found: dict[Side, dict[str, Column]] = {}
    for side in SIDES:
        every = {name: channel_lookup.find_column(trial, name, side, options) for name in LEG_COLUMNS}
        found[side] = {name: column for name, column in every.items() if column is not None}
    travel = channel_lookup.find_column(trial, channel_names.PELVIS_X, None, options)
    belts = [channel_lookup.find_column(trial, channel_names.BELT_SPEED, side, options) for side in (None, *SIDES)]
    belt = next((column for column in belts if column is not None), None)
    tilt = channel_lookup.find_column(trial, channel_names.PELVIS_TILT, None, options)
    if tilt is not None and tilt.spec is not None and tilt.spec.sign == -1:
        tilt = replace(tilt, values=-tilt.values)
    body = _BodyColumns(tilt, belt, _estimate_speed(travel))
    for column, why in (
        (belt, ""),
        (travel, ""),
        (tilt, "; sign: backward positive, as OpenSim's, for nothing in walking tells it"),
    ):
        if column is not None:
            log.add_channel(
                **{"channel": column.channel, "side": "body", "file": column.file_name, "column": column.label},
                **{"unit": column.unit, "sign": (column.spec and column.spec.sign) or 1, "zero": 0.0},
                why=f"unit {column.unit_reason}{why}" if column.spec is None else "as given",
            )
    on = loads.read_foot_loads(trial, options, log)
    plates = loads.read_plate_loads(trial, _find_walking_frame(trial, options, log), log) if not on else {}
    if plates:
        present = [side for side, of in found.items() if "knee_angle" in of]
        clock, apart = compute_knee_difference(found)
        on = loads.assign_to_feet(plates, present, clock, apart, trial_name, options, log)
    result = []
    for side, of in found.items():
        if "knee_angle" not in of or "ankle_angle" not in of:
            continue
        if side not in on:
            log.add_missing(f"{trial_name}: no ground reaction of the {side} foot; without it there is no heel strike")
            continue
        limb = _build_leg(side, of, body, on[side], trial_name, options, log)
        result += [limb] if limb else []
    return result


def _find_walking_frame(trial: Sequence[SourceFile], options: ImportOptions, log: ImportLog) -> WalkingFrame | None:
    """The axes of force plates in a C3D, by its markers; None where no file has both."""
    for source in trial:
        if source.plates and source.markers is not None:
            roles = markers.identify_markers(source.markers, options.mapping, source.name)
            return markers.find_walking_frame(source.markers, roles, options.mapping, source.name, log)
    return None


def _estimate_speed(pelvis_x: Column | None) -> float | None:
    """Speed [m/s] of a pelvis that moves through the laboratory."""
    if pelvis_x is None or abs(pelvis_x.values[-1] - pelvis_x.values[0]) < MIN_PELVIS_TRAVEL:
        return None
    return abs(float(np.polyfit(pelvis_x.time, pelvis_x.values, 1)[0]))


def compute_knee_difference(leg_columns: Mapping[Side, Mapping[str, Column]]) -> tuple[Array, Array]:
    """(time, how much more the right knee is flexed than the left one [deg]); nothing where there is one knee only."""
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
) -> LegChannels | None:
    knee = leg_columns["knee_angle"]
    clock = _UniformClock(filters.make_uniform_time(knee.time, knee.source.path))
    foot = resample_loads(load, clock.time, side, trial_name, options, log)
    angles = {
        name: clock.resample(column, apply_sign(column, foot.contacts, side, log), options.motion_cutoff)
        for name, column in leg_columns.items()
        if name in channel_names.ANGLE_CHANNELS
    }
    free = _derive_shank_angle(angles, body.pelvis_tilt, clock, log, options.motion_cutoff)
    if free is None:
        log.add_missing(
            f"{trial_name}: no hip angle and no inclination of the {side} thigh or shank, so nothing says how the leg leans"
        )
        return None
    apply_zero(clock.time, angles, free, foot.contacts, side, trial_name, options, log)
    channels = {name: angles[name] for name in ("hip_angle", "knee_angle", "ankle_angle", "shank_angle")}
    channels |= {channel_names.GRF_VERTICAL: foot.vertical, channel_names.GRF_FORWARD: foot.forward}
    if channel_names.ANKLE_MOMENT in leg_columns:
        column = leg_columns[channel_names.ANKLE_MOMENT]
        values = apply_sign(column, foot.contacts, side, log)
        channels[channel_names.ANKLE_MOMENT] = clock.resample(column, values, options.load_cutoff)
        channels[channel_names.ANKLE_POWER] = compute_ankle_power(
            clock.time, channels[channel_names.ANKLE_MOMENT], angles["ankle_angle"]
        )
        log.add_derived("Ankle power: moment times plantarflexion rate")
    else:
        log.add_missing(
            f"{trial_name}: no ankle moment of the {side} leg, and none can be derived without the ankle's position: add "
            "the inverse dynamics (.sto) or the markers (.trc, .c3d)"
        )
    belt = None if body.belt_speed is None else np.interp(clock.time, body.belt_speed.time, body.belt_speed.values)
    return LegChannels(side, trial_name, clock.time, channels, foot.contacts, body.walking_speed, belt, foot.impulses)


def _derive_shank_angle(
    angles: dict[str, Array], pelvis_tilt: Column | None, clock: _UniformClock, log: ImportLog, cutoff: float
) -> bool | None:
    """Fill in ``shank_angle`` and ``hip_angle``; whether the shank's zero is free, None where it cannot be had."""
    knee = angles["knee_angle"]
    if "shank_angle" not in angles and "thigh_angle" in angles:
        angles["shank_angle"] = angles["thigh_angle"] + knee
        log.add_derived("Shank inclination: thigh inclination plus knee flexion")
    if "shank_angle" in angles:
        if "hip_angle" not in angles:
            angles["hip_angle"] = knee - angles["shank_angle"]
            log.add_derived("Hip flexion: of the thigh against the vertical, not against the pelvis")
        return False
    if "hip_angle" not in angles:
        return None
    if pelvis_tilt is None:
        angles["shank_angle"] = knee - angles["hip_angle"]
        return True
    angles["shank_angle"] = knee - angles["hip_angle"] - clock.resample(pelvis_tilt, pelvis_tilt.values, cutoff)
    log.add_derived("Shank inclination: knee flexion minus hip flexion minus pelvis tilt (backward positive)")
    return False
