"""Steps common to all sources of a leg: resampled loads, signs, the ankle's zero, and the ankle power."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.gait.contacts import Contact, find_contacts
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import filters
from klute_sim.mocap.kinematics.loads import GroundReaction, preprocess_load
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names, conventions
from klute_sim.mocap.parsing.channel_lookup import HEADER_CONTRADICTION, Column
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.types import Array

MAX_FLAT_FOOT_PITCH = 5.0
"""Largest pitch of the flat foot [deg] that is not reported; a larger one shows that the model that computed the angles
defines another neutral ankle."""
MAX_ANKLE_MEDIAN = 45.0
"""Largest median ankle angle [deg]; a larger one is the angle between foot and shank, 90 degrees in standing."""


@dataclass(frozen=True, eq=False)
class ResampledLoads:
    """Loads of a foot at the times of its leg."""

    contacts: list[Contact]
    """Contacts with the ground."""
    vertical: Array
    """Filtered vertical force (n,) [N]; zero in swing, NaN where nothing was measured."""
    forward: Array
    """Filtered fore-aft force (n,) [N], forward positive; zero in swing, NaN where nothing was measured."""
    cop: Array | None
    """Centre of pressure (n, 2), forward and up [m], NaN in swing; None if unknown."""
    impulses: tuple[float, ...]
    """Vertical impulse [N.s] of each complete contact without gaps."""


def resample_loads(
    loads: GroundReaction, time: Array, side: Side, options: ImportOptions, log: ImportLog
) -> ResampledLoads:
    """Return ``loads`` of the foot of ``side`` at ``time`` with standard signs, and the contacts."""
    loads = preprocess_load(loads, f"the plate of the {side} foot", options, log)
    contacts = find_contacts(loads.time, loads.vertical, options.contact_threshold)
    rate = (len(loads.time) - 1) / (loads.time[-1] - loads.time[0])
    sign = conventions.detect_sign(channel_names.GRF_FORWARD, loads.time, loads.forward, contacts)
    if sign is None and any(c.has_foot_strike and c.has_toe_off for c in contacts):
        log.add_warning(
            f"{loads.file_name}: the sign of the {side} foot's fore-aft load is unclear; positive is assumed to be "
            "forward"
        )
    forward_raw = (sign or 1) * loads.forward
    if sign is not None:
        reason = conventions.SIGN_RULES[channel_names.GRF_FORWARD]
        log.add_sign(sign, reason, channel=channel_names.GRF_FORWARD, side=side, file=loads.file_name, unit="N")
    impulses = []
    for c in contacts:
        if c.has_foot_strike and c.has_toe_off:
            inside = (loads.time >= c.foot_strike) & (loads.time <= c.toe_off)
            impulse = float(np.trapezoid(loads.vertical[inside], loads.time[inside]))
            impulses += [impulse] if np.isfinite(impulse) else []
    on_ground = np.zeros(len(time), dtype=bool)
    for c in contacts:
        on_ground |= (time >= c.foot_strike) & (time <= c.toe_off)
    measured = (time >= loads.time[0]) & (time <= loads.time[-1])

    def resample(samples: Array) -> Array:
        filtered = np.interp(time, loads.time, filters.low_pass(samples, rate, options.load_cutoff))
        return np.where(measured, np.where(on_ground | np.isnan(filtered), filtered, 0.0), np.nan)

    vertical, forward = resample(loads.vertical), resample(forward_raw)
    cop = None
    if loads.cop is not None:
        # The centre of pressure jumps at contacts. Its moment and the force are smooth, so these are filtered. Both are
        # from the samples with a known centre, so their ratio does not depend on the origin of the laboratory.
        known = np.isfinite(loads.cop[:, 0]) & (loads.vertical > options.contact_threshold)
        force = resample(np.where(known, loads.vertical, 0.0))
        moment = resample(np.where(known, loads.vertical * np.nan_to_num(loads.cop[:, 0]), 0.0))
        position = np.full(len(time), np.nan)
        for c in contacts:
            inside = (time >= c.foot_strike) & (time <= c.toe_off)
            is_heavy = inside & (force > options.contact_threshold)
            if is_heavy.any():
                position[inside] = np.interp(time[inside], time[is_heavy], moment[is_heavy] / force[is_heavy])
        height = float(np.median(loads.cop[known, 1])) if known.any() else 0.0
        cop = np.stack([position, np.full(len(time), height)], axis=1)
    return ResampledLoads(contacts, vertical, forward, cop, tuple(impulses))


def apply_sign(column: Column, contacts: Sequence[Contact], side: Side, log: ImportLog) -> Array:
    """Return the values of ``column`` with the standard sign and zero, and log the reasons."""
    spec = column.spec
    detected_sign = conventions.detect_sign(column.channel, column.time, column.values, contacts)
    zero = logged_zero = 0.0
    if spec and spec.sign is not None:
        sign, reason = spec.sign, "as specified"
    elif detected_sign is not None:
        sign, reason = detected_sign, conventions.SIGN_RULES[column.channel]
        if spec is None and sign != column.label_sign:
            reason += "; the label suggests the opposite"
    else:
        sign, reason = column.label_sign, "by the label"
    values = sign * column.values
    if spec and spec.zero is not None and column.zero is not None:
        zero, logged_zero = column.zero, spec.zero
        reason += "; zero as specified"
    elif column.channel == "ankle_angle" and abs(np.nanmedian(values)) > MAX_ANKLE_MEDIAN:
        zero = logged_zero = conventions.round_to_right_angle(values)
        log.add_warning(
            f"{column.file_name}: '{column.label}' is {sign * zero * np.pi / 180.0:.4f} rad "
            f"({sign * zero:.0f} degrees) in standing; this was subtracted"
        )
        reason += "; zero is the nearest right angle"
    if HEADER_CONTRADICTION in column.unit_reason:
        log.add_warning(
            f"{column.file_name}: inDegrees is wrong: by the range of the knee angle, angles are in {column.unit}"
        )
    if column.channel != channel_names.PELVIS_TILT:
        log.add_channel(
            **{"channel": column.channel, "side": side, "file": column.file_name, "column": column.label},
            **{"unit": column.unit, "sign": sign, "zero": logged_zero},
            reason=f"unit {column.unit_reason}; sign: {reason}",
        )
    if column.channel in ("hip_angle", "ankle_angle"):
        clipping = conventions.detect_clipping(values)
        if clipping is not None:
            log.add_warning(
                f"{column.file_name}: '{column.label}' stays at {clipping[0]:.1f} degrees for "
                f"{100 * clipping[1]:.0f} % of the time: a bound of the model may clip it"
            )
    return np.asarray(values - zero, dtype=np.float64)


def apply_zero(
    time: Array,
    angles: dict[str, Array],
    shank_zero_is_free: bool,
    contacts: Sequence[Contact],
    side: Side,
    file_name: str,
    options: ImportOptions,
    log: ImportLog,
) -> None:
    """Shift ``angles`` in place so that the foot is flat in mid-stance.

    Shifts the shank angle if its zero is free, otherwise the ankle angle, which is from the file ``file_name``.
    """
    pitch = angles["shank_angle"] - angles["ankle_angle"]
    offset = conventions.estimate_flat_foot_pitch(time, pitch, contacts)
    spec = options.mapping.channels.get((side, "ankle_angle"))
    if offset is None:
        log.add_warning(f"{file_name}: no complete stance of the {side} foot, so the flat foot is unknown")
        return
    if shank_zero_is_free:
        angles["shank_angle"] = angles["shank_angle"] - offset
        log.add_derived(
            "Shank inclination: knee minus hip angle, plus a constant that makes the foot flat from 25 to 50 % of "
            "stance; assumes no tilt of pelvis and trunk"
        )
        return
    if options.ankle_zero == "file" or (spec is not None and spec.zero is not None):
        if abs(offset) > MAX_FLAT_FOOT_PITCH:
            log.add_warning(f"{file_name}: the {side} foot is pitched by {offset:.1f} degrees where it should be flat")
        return
    angles["ankle_angle"] = angles["ankle_angle"] + offset
    log.add_derived("Zero of the ankle: flat foot from 25 to 50 % of stance (--ankle-zero)")
    if abs(offset) > MAX_FLAT_FOOT_PITCH:
        log.add_warning(
            f"{file_name}: with the zero of the file the {side} foot is pitched by {offset:.1f} degrees where it is "
            "flat; the ankle's zero was shifted by this angle"
        )


def compute_ankle_power(time: Array, moment: Array, ankle_angle: Array) -> Array:
    """Return the net ankle power [W]: ``moment`` [N.m] times plantarflexion rate; generation is positive."""
    return np.asarray(-moment * np.gradient(np.radians(ankle_angle), time), dtype=np.float64)
