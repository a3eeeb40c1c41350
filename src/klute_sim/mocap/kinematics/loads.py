"""Ground reactions of each foot, from columns that name the foot or from force plates that do not.

A contact on a plate belongs to the leg whose knee is straighter in the middle of the contact, while the other leg
swings. This rule needs no segment lengths, no plate positions and no signs except that of the knee angle, which the
data determine. Without the angles of both knees, the centre of pressure stays under the foot that stands, and the ankle
of the other foot passes it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from klute_sim.datasets.foot_load import MAX_UNREPORTED_OFFSET, PlateOffset, estimate_plate_offset
from klute_sim.datasets.trial import TimeSeries
from klute_sim.errors import InputError
from klute_sim.gait.contacts import MAX_EVENT_GAP_TIME, Contact, fill_swings, find_contacts
from klute_sim.mask_runs import find_runs
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.kinematics import filters
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_lookup, channel_names
from klute_sim.mocap.parsing.channel_names import SIDES, Side
from klute_sim.mocap.parsing.markers import WalkingFrame
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.types import Array

MAX_CONTACT_TIME = 1.6
"""Longest contact of a walking foot [s]; a longer one is two feet on one plate, or standing."""
MIDSTANCE_RANGE = (0.2, 0.8)
"""Fractions of a contact between which the other leg swings."""
TYPICAL_CONTACT_TIME = 0.7
"""Duration [s] of a contact that the start or end of the recording truncates (assumed)."""
MIN_KNEE_DIFFERENCE = 5.0
"""Smallest difference of the knees' mean flexion [deg] that identifies a foot; in walking it is near 30."""
MIN_PASSING_DISTANCE = 0.3
"""Shortest distance by which the ankle of the other foot passes the centre of pressure within :data:`MIDSTANCE_RANGE`
[m] (assumed; a swing carries it by 0.6 m or more, and the ankle that stands moves by a tenth of that)."""
COP_TOLERANCE = 1e-9
"""Largest difference between equal centres of pressure, in the unit of the file."""
MAX_SHARED_COP_FRACTION = 0.2
"""Largest fraction of samples with equal centres of pressure of both feet that is not reported; double support takes a
third of a stride."""
MIN_STEP_FORCE = 50.0
"""Smallest range of the force on a plate that somebody steps on [N] (assumed)."""
DIRECTION_PERCENTILES = 0.5, 99.5
"""Percentiles of a vertical force that stand for its extremes without spikes (assumed)."""
CONTACT_MARGIN = 0.02
"""Time [s] before and after a contact in which loads below the threshold belong to it."""


@dataclass(frozen=True, eq=False)
class GroundReaction:
    """Ground reaction on one foot or one plate, acting on the body."""

    file_name: str
    """Name of the file that contains it, or of the files."""
    time: Array
    """Sample times (n,) [s]."""
    vertical: Array
    """Vertical force (n,) [N], up positive."""
    forward: Array
    """Fore-aft force (n,) [N], positive along the forward axis of the file."""
    cop: Array | None = None
    """Centre of pressure (n, 2) in the walking frame, forward and up [m]; None if unknown."""


def read_foot_loads(trial: Sequence[SourceFile], options: ImportOptions, log: ImportLog) -> dict[Side, GroundReaction]:
    """Return the ground reaction of each foot from columns that name the foot."""
    foot_loads: dict[Side, GroundReaction] = {}
    for side in SIDES:
        vertical = channel_lookup.find_column(trial, channel_names.GRF_VERTICAL, side, options)
        forward = channel_lookup.find_column(trial, channel_names.GRF_FORWARD, side, options)
        if vertical is None or forward is None:
            axes = [channel_lookup.find_column(trial, axis, side, options) for axis in channel_names.GRF_AXES]
            columns = [c for c in axes if c is not None]
            if len(columns) < 2 or len({c.source.path for c in columns}) > 1:
                continue
            up, ahead = _find_axes(np.stack([c.values for c in columns], axis=1))
            vertical, forward = vertical or columns[up], forward or columns[ahead]
        sign = -1.0 if _points_down(vertical.values) else 1.0
        for channel, column, axis_reason in (
            (channel_names.GRF_VERTICAL, vertical, "the axis with the largest mean load"),
            (channel_names.GRF_FORWARD, forward, "of the other axes, the one with the largest range"),
        ):
            reason = "by its name" if column.channel == channel else axis_reason
            log.add_channel(
                **{"channel": channel, "side": side, "file": column.file_name, "column": column.label},
                **{"unit": column.unit, "sign": int(sign) if channel == channel_names.GRF_VERTICAL else 1, "zero": 0.0},
                reason=f"unit {column.unit_reason}; axis {reason}",
            )
        # The two columns may come from files with different times.
        forward_values = np.interp(vertical.time, forward.time, forward.values)
        foot_loads[side] = GroundReaction(vertical.file_name, vertical.time, sign * vertical.values, forward_values)
    _warn_if_shared_cop(trial, log)
    return foot_loads


def _find_axes(force: Array) -> tuple[int, int]:
    """Return the columns of ``force`` (n, axes) with the vertical and the fore-aft component."""
    mean_load = np.abs(np.nanmean(force, axis=0))
    up = int(mean_load.argmax())
    load_range = np.nanmax(force, axis=0) - np.nanmin(force, axis=0)
    load_range[up] = -1.0
    return up, int(load_range.argmax())


def _warn_if_shared_cop(trial: Sequence[SourceFile], log: ImportLog) -> None:
    """Warn if both feet share one centre of pressure, as with plates that cannot separate the feet."""
    for source in trial:
        for label in source.labels:
            other_label = label.replace("Left", "Right").replace("left", "right")
            if "cop" not in label.lower() or other_label == label or other_label not in source.labels:
                continue
            left, right = source.get_column(label), source.get_column(other_label)
            fraction = float(np.mean(np.abs(left - right) < COP_TOLERANCE))
            if fraction > MAX_SHARED_COP_FRACTION and np.nanmax(left) > np.nanmin(left):
                log.add_warning(
                    f"{source.name}: '{label}' and '{other_label}' are equal for {100 * fraction:.0f} % of the time: "
                    "one centre of pressure for both feet, which was not used"
                )
                break


def read_plate_loads(
    trial: Sequence[SourceFile], frame: WalkingFrame | None, log: ImportLog
) -> dict[str, GroundReaction]:
    """Return plate name -> ground reaction in the walking frame; OpenSim labels may name a foot instead of a plate."""
    plate_loads: dict[str, GroundReaction] = {}
    for source in trial:
        file_name = source.name
        for number, plate in enumerate(source.plates, 1):
            if frame is None:
                raise InputError(f"{source.path} has force plates but no markers that show the walking direction")
            plate_name = f"plate {number}"
            force, cop = frame.rotate(plate.force), frame.rotate(plate.cop)
            force, sign = _orient_upward(force, 1, plate_name, file_name, log)
            forward, vertical, _ = sign * frame.rotate(plate.offset)
            _warn_of_offset(PlateOffset(vertical, forward), plate_name, file_name, log)
            plate_loads[plate_name] = GroundReaction(file_name, plate.time, force[:, 1], force[:, 0], cop[:, :2])
            log.add_channel(
                **{"channel": "ground reaction", "side": plate_name, "file": file_name},
                **{"column": f"force plate {number}", "unit": "N", "sign": sign, "zero": 0.0},
                reason=frame.description,
            )
        plate_loads |= _read_opensim_plates(source, file_name, frame, log)
    return plate_loads


def _read_opensim_plates(
    source: SourceFile, file_name: str, frame: WalkingFrame | None, log: ImportLog
) -> dict[str, GroundReaction]:
    plate_labels: dict[str, dict[tuple[str, int], str]] = {}
    for label in source.labels:
        parsed = channel_names.parse_plate_label(label)
        if parsed is not None:
            plate_labels.setdefault(parsed.plate, {})[parsed.quantity, parsed.axis] = label
    plate_loads = {}
    for plate, labels in plate_labels.items():
        if not all(("force", axis) in labels for axis in range(3)):
            raise InputError(f"{source.path}: the ground reaction '{plate}' lacks one of the three components")
        force = np.stack([source.get_column(labels["force", axis]) for axis in range(3)], axis=1)
        empty = next((labels["force", axis] for axis in range(3) if not np.isfinite(force[:, axis]).any()), None)
        if empty is not None:
            raise InputError(f"{source.path}: column '{empty}' contains no numbers")
        has_cop = all(("point", axis) in labels for axis in range(3))
        cop = np.stack([source.get_column(labels["point", axis]) for axis in range(3)], axis=1) if has_cop else None
        up, ahead, reason = 1, 0, "OpenSim axes: x forward, y up, z right"
        if frame is not None:  # the markers are in the same laboratory frame
            force, cop = frame.rotate(force), None if cop is None else frame.rotate(cop)
            reason = frame.description
        elif np.abs(np.nanmean(force, axis=0)).argmax() != 1:
            up, ahead = _find_axes(force)
            reason = f"up is {'xyz'[up]}, not OpenSim's y: the axis with the largest mean load"
            log.add_warning(
                f"{file_name}: the vertical ground reaction is along {'xyz'[up]}, not along y as in OpenSim"
            )
        force, sign = _orient_upward(force, up, f"the ground reaction '{plate}'", file_name, log)
        plate_name = plate if plate in SIDES else f"plate {plate}"
        cop_2d = None if cop is None else cop[:, [ahead, up]]
        plate_loads[plate_name] = GroundReaction(
            file_name, channel_lookup.read_time(source), force[:, up], force[:, ahead], cop_2d
        )
        log.add_channel(
            **{"channel": "ground reaction", "side": plate_name, "file": file_name},
            **{"column": labels["force", up] + ", ...", "unit": "N", "sign": sign, "zero": 0.0, "reason": reason},
        )
    return plate_loads


def _orient_upward(force: Array, up: int, description: str, file_name: str, log: ImportLog) -> tuple[Array, int]:
    """Return ``force`` (n, 3) on the body and its sign; some programs record the force on the plate."""
    if not _points_down(force[:, up]):
        return force, 1
    log.add_warning(f"{file_name}: {description} points down; its sign was reversed to act on the body")
    return -force, -1


def _points_down(vertical: Array) -> bool:
    """Return whether a ``vertical`` force (n,) [N] is largest downward; False on an unloaded plate."""
    known = vertical[np.isfinite(vertical)]
    if not len(known) or np.ptp(known) < MIN_STEP_FORCE:
        return False
    low, high = np.percentile(known, DIRECTION_PERCENTILES)
    return bool(-low > high)


def preprocess_load(loads: GroundReaction, description: str, options: ImportOptions, log: ImportLog) -> GroundReaction:
    """Return ``loads`` without the offset of the plate, and with gaps filled; ``description`` names the plate.

    Samples that the file leaves out are gaps. Short gaps are interpolated, unless a heel strike or toe-off is somewhere
    in them; the load is zero in swings that the file leaves out. The other gaps remain.
    """
    loads = _insert_missing_samples(loads)
    offset = estimate_plate_offset(loads.vertical, loads.forward)
    _warn_of_offset(offset, description, loads.file_name, log)
    filled = fill_swings(loads.time, loads.vertical - offset.vertical)
    is_left_out = np.isnan(loads.vertical) & (filled == 0.0)
    vertical = filters.fill_gaps(filled, loads.time)
    for start, stop in find_runs(np.isnan(filled)):
        load_states = {bool(filled[k] > options.contact_threshold) for k in (start - 1, stop) if 0 <= k < len(filled)}
        if len(load_states) == 2 and loads.time[stop] - loads.time[start - 1] > MAX_EVENT_GAP_TIME:
            vertical[start:stop] = np.nan
    forward = filters.fill_gaps(np.where(is_left_out, 0.0, loads.forward - offset.forward), loads.time)
    return replace(loads, vertical=vertical, forward=forward)


def _insert_missing_samples(loads: GroundReaction) -> GroundReaction:
    time, vertical = filters.insert_missing_samples(loads.time, loads.vertical)
    _, forward = filters.insert_missing_samples(loads.time, loads.forward)
    cop = None if loads.cop is None else filters.insert_missing_samples(loads.time, loads.cop)[1]
    return replace(loads, time=time, vertical=vertical, forward=forward, cop=cop)


def _warn_of_offset(offset: PlateOffset, description: str, file_name: str, log: ImportLog) -> None:
    if max(map(abs, offset)) > MAX_UNREPORTED_OFFSET:
        vertical, forward = (round(reading, 1) + 0.0 for reading in offset)  # zero removes the sign of a negative zero
        log.add_warning(
            f"{file_name}: without load, {description} reads {vertical:.1f} N vertically and {forward:.1f} N "
            "fore-aft; this offset was subtracted"
        )


def assign_to_feet(
    plates: dict[str, GroundReaction],
    legs: Sequence[Side],
    time: Array,
    knee_difference: Array,
    options: ImportOptions,
    log: ImportLog,
    ankles: Mapping[Side, TimeSeries] = MappingProxyType({}),
) -> dict[Side, GroundReaction]:
    """Return the ground reaction of each foot from ``plates``.

    ``knee_difference`` (n,) is the flexion of the right knee minus that of the left [deg] at ``time``. Where it is
    unknown, the centre of pressure shows the foot: it stays with the ankle of ``ankles`` (forward position [m]) that
    stands. If the files contain only one of the ``legs``, it gets all loads that its ankle does not contradict.
    """
    contacts_by_side: dict[Side, list[tuple[GroundReaction, float, float]]] = {side: [] for side in SIDES}
    for plate, raw_loads in plates.items():
        loads = preprocess_load(raw_loads, plate, options, log)
        contacts = find_contacts(loads.time, loads.vertical, options.contact_threshold)
        feet = [_identify_foot(contact, time, knee_difference) for contact in contacts]
        passing = _find_passing_legs(legs, ankles, contacts, loads)
        if not any(feet) and len(legs) == 2:
            standing = [[leg for leg in legs if leg not in others] for others in passing]
            feet = [sides[0] if len(sides) == 1 else None for sides in standing]
        for foot, contact, others in zip(feet, contacts, passing, strict=True):
            identified = {f for f in feet if f is not None}
            side: Side | None = foot or (identified.pop() if len(identified) == 1 else None)
            if plate in SIDES:
                side = "right" if plate == "right" else "left"
            elif len(legs) == 1:
                side = legs[0]
                if side in others:
                    log.add_derived(
                        f"Foot on a plate: contacts whose centre of pressure the {side} ankle passes are of the other "
                        "foot and were left out"
                    )
                    continue
            if contact.toe_off - contact.foot_strike > MAX_CONTACT_TIME:
                log.add_warning(
                    f"{loads.file_name}: {plate} is loaded for {contact.toe_off - contact.foot_strike:.2f} s without a "
                    "pause, by both feet or in standing; this contact was excluded"
                )
            elif side is None:
                log.add_warning(
                    f"{loads.file_name}: the foot on {plate} at {contact.foot_strike:.2f} s cannot be identified; this "
                    "contact was excluded"
                )
            else:
                contacts_by_side[side].append((loads, contact.foot_strike, contact.toe_off))
                if plate not in SIDES and len(legs) > 1:
                    is_known = bool(np.isfinite(knee_difference).any())
                    method = "of the leg with the straighter knee" if is_known else "whose ankle stands"
                    log.add_derived(f"Foot on a plate: that {method} ({side}: {plate})")
    return {side: _merge_contacts(contacts) for side, contacts in contacts_by_side.items() if contacts}


def _identify_foot(contact: Contact, time: Array, knee_difference: Array) -> Side | None:
    """Return the side of a contact; None if it is unclear, as for contacts that the recording truncates."""
    is_complete = contact.has_foot_strike and contact.has_toe_off
    duration = contact.toe_off - contact.foot_strike if is_complete else TYPICAL_CONTACT_TIME
    foot_strike = contact.foot_strike if contact.has_foot_strike else contact.toe_off - duration
    low, high = (foot_strike + fraction * duration for fraction in MIDSTANCE_RANGE)
    inside = (time >= max(low, contact.foot_strike)) & (time <= min(high, contact.toe_off))
    midstance = knee_difference[inside & np.isfinite(knee_difference)]
    if not len(midstance) or not abs(float(midstance.mean())) > MIN_KNEE_DIFFERENCE:
        return None
    return "left" if midstance.mean() > 0.0 else "right"


def _find_passing_legs(
    legs: Sequence[Side], ankles: Mapping[Side, TimeSeries], contacts: Sequence[Contact], loads: GroundReaction
) -> list[set[Side]]:
    """Return the legs whose ankle passes the centre of pressure of each contact.

    If all complete contacts on the plate agree, the others, which the recording truncates, follow them.
    """
    passing = [{leg for leg in legs if _passes(ankles.get(leg), contact, loads)} for contact in contacts]
    complete = [
        passing_legs for passing_legs, c in zip(passing, contacts, strict=True) if c.has_foot_strike and c.has_toe_off
    ]
    is_agreed = bool(complete) and all(passing_legs == complete[0] for passing_legs in complete)
    return [complete[0]] * len(contacts) if is_agreed else passing


def _passes(ankle: TimeSeries | None, contact: Contact, loads: GroundReaction) -> bool:
    """Return whether ``ankle`` moves past the centre of pressure during ``contact``, as that of the other foot does."""
    if ankle is None or loads.cop is None:
        return False
    duration = contact.toe_off - contact.foot_strike
    low, high = (contact.foot_strike + fraction * duration for fraction in MIDSTANCE_RANGE)
    known = np.isfinite(ankle.value)
    inside = (loads.time >= low) & (loads.time <= high) & np.isfinite(loads.cop[:, 0])
    if inside.sum() < 2 or known.sum() < 2:
        return False
    distance = loads.cop[inside, 0] - np.interp(loads.time[inside], ankle.time[known], ankle.value[known])
    return bool(distance[-1] - distance[0] < -MIN_PASSING_DISTANCE)


def _merge_contacts(contacts: Sequence[tuple[GroundReaction, float, float]]) -> GroundReaction:
    """Return the contacts (loads, start [s], end [s]) of one foot at the first one's times, with zero load between."""
    time = contacts[0][0].time
    vertical, forward, moment = np.zeros(len(time)), np.zeros(len(time)), np.zeros((len(time), 2))
    has_cop = all(loads.cop is not None and np.isfinite(loads.cop).any(axis=0).all() for loads, *_ in contacts)
    for loads, start, end in contacts:
        inside = (time >= start - CONTACT_MARGIN) & (time <= end + CONTACT_MARGIN)
        forces = [np.interp(time[inside], loads.time, c) for c in (loads.vertical, loads.forward)]
        vertical[inside] += forces[0]
        forward[inside] += forces[1]
        if has_cop and loads.cop is not None:
            for axis in range(2):
                known = np.isfinite(loads.cop[:, axis])
                position = np.interp(time[inside], loads.time[known], loads.cop[known, axis])
                moment[inside, axis] += forces[0] * position
    for loads in {id(loads): loads for loads, *_ in contacts}.values():
        is_unknown = np.isnan(np.interp(time, loads.time, loads.vertical + loads.forward))
        vertical[is_unknown], forward[is_unknown] = np.nan, np.nan
    loaded = np.abs(vertical) > 1e-6
    cop = np.where(loaded[:, None], moment / np.where(loaded, vertical, 1.0)[:, None], 0.0)
    file_names = ", ".join(dict.fromkeys(loads.file_name for loads, *_ in contacts))
    return GroundReaction(file_names, time, vertical, forward, cop if has_cop else None)
