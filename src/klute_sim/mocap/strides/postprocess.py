"""The steps that all ways to a leg share: loads onto its clock, signs, the ankle's zero, what can be derived."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.gait import contacts as gait_contacts
from klute_sim.gait.contacts import Contact
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import filters
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names, conventions
from klute_sim.mocap.parsing.channel_lookup import HEADER_CONTRADICTION, Column
from klute_sim.mocap.parsing.channel_names import Side
from klute_sim.mocap.strides.loads import GroundReaction, remove_offset
from klute_sim.recording.recording import Array

MAX_FLAT_FOOT_PITCH = 5.0
"""Pitch of the flat foot [deg] from which it is told: the model that gave the angles has another neutral ankle."""


@dataclass(frozen=True, eq=False)
class ResampledLoads:
    """A foot's loads on the clock of its leg."""

    contacts: list[Contact]
    vertical: Array
    """[N], filtered, zero where the foot is not on the ground, NaN where nothing was measured."""
    forward: Array
    cop: Array | None
    impulses: tuple[float, ...]


def resample_loads(
    loads: GroundReaction, time: Array, side: Side, trial_name: str, options: ImportOptions, log: ImportLog
) -> ResampledLoads:
    """``loads`` of the foot of ``side`` at ``time``, with its contacts; their signs are decided here."""
    loads = remove_offset(loads, f"the {side} foot's vertical load", trial_name, log)
    contacts = gait_contacts.find_contacts(loads.time, loads.vertical, options.contact_threshold)
    rate = (len(loads.time) - 1) / (loads.time[-1] - loads.time[0])
    sign = conventions.detect_sign(channel_names.GRF_FORWARD, loads.time, loads.forward, contacts)
    if sign is None and any(c.has_foot_strike and c.has_toe_off for c in contacts):
        log.add_warning(
            f"{trial_name}: the {side} foot's fore-aft load does not tell its sign; taken as forward positive"
        )
    forward = (sign or 1) * loads.forward
    if sign is not None:
        log.add_channel(
            **{
                "channel": channel_names.GRF_FORWARD,
                "side": side,
                "file": trial_name,
                "column": "as above",
                "unit": "N",
                "sign": sign,
            },
            **{"zero": 0.0, "why": conventions.SIGN_RULES[channel_names.GRF_FORWARD]},
        )
    impulses = []
    for c in contacts:
        if c.has_foot_strike and c.has_toe_off:
            inside = (loads.time >= c.foot_strike) & (loads.time <= c.toe_off)
            impulses.append(float(np.trapezoid(loads.vertical[inside], loads.time[inside])))
    on_ground = np.zeros(len(time), dtype=bool)
    for c in contacts:
        on_ground |= (time >= c.foot_strike) & (time <= c.toe_off)
    measured = (time >= loads.time[0]) & (time <= loads.time[-1])

    def resampled(samples: Array, free: float = 0.0) -> Array:
        smooth = filters.low_pass(filters.fill_gaps(samples, loads.time), rate, options.load_cutoff)
        here = np.interp(time, loads.time, smooth)
        return np.where(measured, np.where(on_ground, here, free), np.nan)

    vertical, along = resampled(loads.vertical), resampled(forward)
    point = None
    if loads.cop is not None:
        # The moment is smooth where the point is not, so that is what is filtered.
        known = np.isfinite(loads.cop[:, 0]) & (loads.vertical > options.contact_threshold)
        ahead = np.where(known, loads.vertical * np.nan_to_num(loads.cop[:, 0]), 0.0)
        level = float(np.median(loads.cop[known, 1])) if known.any() else 0.0
        place = np.divide(
            resampled(ahead), vertical, out=np.zeros(len(time)), where=vertical > options.contact_threshold
        )
        point = np.stack([place, np.full(len(time), level)], axis=1)
    return ResampledLoads(contacts, vertical, along, point, tuple(impulses))


def apply_sign(column: Column, contacts: Sequence[Contact], side: Side, log: ImportLog) -> Array:
    """The column's values with the sign that is right here, which is reported with its reason."""
    choice = column.spec
    by_data = conventions.detect_sign(column.channel, column.time, column.values, contacts)
    zero = 0.0
    if choice and choice.sign is not None:
        sign, why = choice.sign, "as given"
    elif by_data is not None:
        sign, why = by_data, conventions.SIGN_RULES[column.channel]
        if choice is None and sign != column.label_sign:
            why += "; its name would say the opposite"
    else:
        sign, why = column.label_sign, "by its name"
    values = sign * column.values
    if choice and choice.zero is not None:
        zero = choice.zero
        why += "; zero as given"
    elif column.channel == "ankle_angle" and abs(np.nanmedian(values)) > 45.0:
        zero = conventions.round_to_right_angle(values)
        log.add_warning(
            f"{column.file_name}: '{column.label}' is {sign * zero * np.pi / 180.0:.4f} rad ({sign * zero:.0f} degrees) in "
            "standing; this was taken off"
        )
        why += "; zero is the nearest right angle"
    if HEADER_CONTRADICTION in column.unit_reason:
        log.add_warning(
            f"{column.file_name}: inDegrees is wrong: by how far the knee moves, angles are in {column.unit}"
        )
    if column.channel != channel_names.PELVIS_TILT:
        log.add_channel(
            **{"channel": column.channel, "side": side, "file": column.file_name, "column": column.label},
            **{"unit": column.unit, "sign": sign, "zero": zero, "why": f"unit {column.unit_reason}; sign: {why}"},
        )
    if column.channel in ("hip_angle", "ankle_angle"):
        stuck = conventions.detect_clipping(values)
        if stuck is not None:
            log.add_warning(
                f"{column.file_name}: '{column.label}' stands at {stuck[0]:.1f} degrees for {100 * stuck[1]:.0f} % of the "
                "time: it looks clipped by a model's bound"
            )
    return np.asarray(values - zero, dtype=np.float64)


def apply_zero(
    time: Array,
    angles: dict[str, Array],
    shank_zero_is_free: bool,
    contacts: Sequence[Contact],
    side: Side,
    trial_name: str,
    options: ImportOptions,
    log: ImportLog,
) -> None:
    """Make the foot flat where it is flat, in place: by the shank's zero if that is free, else by the ankle's."""
    pitch = angles["shank_angle"] - angles["ankle_angle"]
    off = conventions.estimate_flat_foot_pitch(time, pitch, contacts)
    given = options.mapping.channels.get((side, "ankle_angle"))
    if off is None:
        log.add_warning(f"{trial_name}: no whole stance of the {side} foot, so nothing says where it is flat")
        return
    if shank_zero_is_free:
        angles["shank_angle"] = angles["shank_angle"] - off
        log.add_derived(
            "Shank inclination: knee minus hip, plus a constant that makes the foot flat between a quarter and a half "
            "of stance; pelvis and trunk are taken not to tilt"
        )
        return
    if options.ankle_zero == "file" or (given is not None and given.zero is not None):
        if abs(off) > MAX_FLAT_FOOT_PITCH:
            log.add_warning(f"{trial_name}: the {side} foot is pitched by {off:.1f} degrees where it should be flat")
        return
    angles["ankle_angle"] = angles["ankle_angle"] + off
    log.add_derived("Zero of the ankle: where the foot is flat between a quarter and a half of stance (--ankle-zero)")
    if abs(off) > MAX_FLAT_FOOT_PITCH:
        log.add_warning(
            f"{trial_name}: with its own zero the {side} foot is pitched by {off:.1f} degrees where it is flat; the ankle's "
            "zero was moved by as much"
        )


def compute_ankle_power(time: Array, moment: Array, ankle_angle: Array) -> Array:
    """Net ankle power [W]: moment times plantarflexion rate; generation positive."""
    return np.asarray(-moment * np.gradient(np.radians(ankle_angle), time), dtype=np.float64)
