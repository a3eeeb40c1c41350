"""Ground reactions of each foot: from columns that name it, or from force plates that do not.

A plate's load goes to the leg whose knee is straighter in the middle of the contact, while the other one swings: that
needs no lengths, no positions of plates and no sign but the knee's, which the knee tells itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from klute_sim.errors import InputError
from klute_sim.gait import contacts as gait_contacts
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_lookup, channel_names
from klute_sim.mocap.parsing.channel_names import SIDES, Side
from klute_sim.mocap.parsing.markers import WalkingFrame
from klute_sim.mocap.parsing.sources import SourceFile
from klute_sim.recording.recording import Array

MAX_CONTACT_TIME = 1.6
"""A longer contact [s] of a walking foot is two feet on one plate, or standing."""
MIDSTANCE_RANGE = (0.2, 0.8)
"""Shares of a contact in which the other leg swings."""
TYPICAL_CONTACT_TIME = 0.7
"""What a contact that is cut by the record's ends is taken to last [s] (assumed)."""
MIN_KNEE_DIFFERENCE = 5.0
"""Difference of the knees' mean flexion [deg] below which nothing is told; in walking it is near 30."""
MAX_PLATE_OFFSET = 3.0
"""Load of an empty plate [N] from which it is told."""
COP_TOLERANCE = 1e-9
MAX_SHARED_COP_FRACTION = 0.2
"""Share of samples with one centre of pressure for both feet from which it is told; for a third both are down."""


@dataclass(frozen=True, eq=False)
class GroundReaction:
    """Ground reaction on one foot, or on one plate [N], on the body; up positive, forward as the axis is."""

    time: Array
    vertical: Array
    forward: Array
    cop: Array | None = None
    """(n, 2): forward and up [m] in the frame of walking; None: not told."""


def read_foot_loads(trial: Sequence[SourceFile], options: ImportOptions, log: ImportLog) -> dict[Side, GroundReaction]:
    """Loads from columns that name their foot."""
    found: dict[Side, GroundReaction] = {}
    for side in SIDES:
        vertical = channel_lookup.find_column(trial, channel_names.GRF_VERTICAL, side, options)
        forward = channel_lookup.find_column(trial, channel_names.GRF_FORWARD, side, options)
        if vertical is None or forward is None:
            three = [channel_lookup.find_column(trial, axis, side, options) for axis in channel_names.GRF_AXES]
            present = [c for c in three if c is not None]
            if len(present) < 2 or len({c.source.path for c in present}) > 1:
                continue
            up, ahead = _find_axes(np.stack([c.values for c in present], axis=1))
            vertical, forward = vertical or present[up], forward or present[ahead]
        sign = 1.0 if np.nanmean(vertical.values) > 0.0 else -1.0
        for channel, column, why in (
            (channel_names.GRF_VERTICAL, vertical, "the axis with the largest mean load"),
            (channel_names.GRF_FORWARD, forward, "of the others, the one with the larger range"),
        ):
            stated = column.channel == channel
            log.add_channel(
                **{"channel": channel, "side": side, "file": column.file_name, "column": column.label},
                **{"unit": column.unit, "sign": int(sign) if channel == channel_names.GRF_VERTICAL else 1, "zero": 0.0},
                why=f"unit {column.unit_reason}; axis {'by its name' if stated else why}",
            )
        along = np.interp(vertical.time, forward.time, forward.values)  # they may be of two files
        found[side] = GroundReaction(vertical.time, sign * vertical.values, along)
    _warn_if_shared_cop(trial, log)
    return found


def _find_axes(force: Array) -> tuple[int, int]:
    """Which columns of ``force`` (n, axes) are vertical and fore-aft."""
    size = np.abs(np.nanmean(force, axis=0))
    up = int(size.argmax())
    swing = np.nanmax(force, axis=0) - np.nanmin(force, axis=0)
    swing[up] = -1.0
    return up, int(swing.argmax())


def _warn_if_shared_cop(trial: Sequence[SourceFile], log: ImportLog) -> None:
    """Both feet with one centre of pressure, always or while both are down: plates that do not know which foot."""
    for source in trial:
        for label in source.labels:
            other = label.replace("Left", "Right").replace("left", "right")
            if "cop" not in label.lower() or other == label or other not in source.labels:
                continue
            one, two = source.get_column(label), source.get_column(other)
            share = float(np.mean(np.abs(one - two) < COP_TOLERANCE))
            if share > MAX_SHARED_COP_FRACTION and np.nanmax(one) > np.nanmin(one):
                log.add_warning(
                    f"{source.name}: '{label}' and '{other}' are the same for {100 * share:.0f} % of the time: one "
                    "centre of pressure for both feet; it was not used"
                )
                break


def read_plate_loads(
    trial: Sequence[SourceFile], frame: WalkingFrame | None, log: ImportLog
) -> dict[str, GroundReaction]:
    """Plate -> its loads, in the frame of walking; a plate that OpenSim's labels give to a foot is named so."""
    found: dict[str, GroundReaction] = {}
    for source in trial:
        name = source.name
        for number, plate in enumerate(source.plates, 1):
            if frame is None:
                raise InputError(f"{source.path} has force plates, but no markers that say which way the walk went")
            key = f"plate {number}"
            force, point = frame.rotate(plate.force), frame.rotate(plate.cop)
            force, sign = _orient_upward(force, 1, key, name, log)
            found[key] = GroundReaction(plate.time, force[:, 1], force[:, 0], point[:, :2])
            log.add_channel(
                **{"channel": "ground reaction", "side": key, "file": name, "column": f"force platform {number}"},
                **{"unit": "N", "sign": sign, "zero": 0.0, "why": frame.description},
            )
        found |= _read_opensim_plates(source, name, frame, log)
    return found


def _read_opensim_plates(
    source: SourceFile, file_name: str, frame: WalkingFrame | None, log: ImportLog
) -> dict[str, GroundReaction]:
    parts: dict[str, dict[tuple[str, int], str]] = {}
    for label in source.labels:
        meant = channel_names.parse_plate_label(label)
        if meant is not None:
            parts.setdefault(meant.plate, {})[meant.quantity, meant.axis] = label
    found = {}
    for which, labels in parts.items():
        if not all(("force", axis) in labels for axis in range(3)):
            raise InputError(f"{source.path}: the ground reaction '{which}' has not all three components")
        force = np.stack([source.get_column(labels["force", axis]) for axis in range(3)], axis=1)
        empty = next((labels["force", axis] for axis in range(3) if not np.isfinite(force[:, axis]).any()), None)
        if empty is not None:
            raise InputError(f"{source.path}: column '{empty}' holds no number")
        whole = all(("point", axis) in labels for axis in range(3))
        point = np.stack([source.get_column(labels["point", axis]) for axis in range(3)], axis=1) if whole else None
        up, ahead, why = 1, 0, "OpenSim's axes: x forward, y up, z right"
        if frame is not None:  # markers in the same laboratory
            force, point = frame.rotate(force), None if point is None else frame.rotate(point)
            why = frame.description
        elif np.abs(np.nanmean(force, axis=0)).argmax() != 1:
            up, ahead = _find_axes(force)
            why = f"up is {'xyz'[up]}, not OpenSim's y: the axis with the largest mean load"
            log.add_warning(
                f"{file_name}: the vertical ground reaction is along {'xyz'[up]}, not along y as OpenSim has it"
            )
        force, sign = _orient_upward(force, up, f"the ground reaction '{which}'", file_name, log)
        key = which if which in SIDES else f"plate {which}"
        place = None if point is None else point[:, [ahead, up]]
        found[key] = GroundReaction(channel_lookup.read_time(source), force[:, up], force[:, ahead], place)
        log.add_channel(
            **{"channel": "ground reaction", "side": key, "file": file_name, "column": labels["force", up] + ", ..."},
            **{"unit": "N", "sign": sign, "zero": 0.0, "why": why},
        )
    return found


def _orient_upward(force: Array, up: int, description: str, file_name: str, log: ImportLog) -> tuple[Array, int]:
    """``force`` (n, 3) on the body, and its sign; some record the force on the plate."""
    if not np.nanmean(force[:, up]) < 0.0:
        return force, 1
    log.add_warning(f"{file_name}: {description} points down; it was turned to act on the body")
    return -force, -1


def remove_offset(loads: GroundReaction, description: str, trial_name: str, log: ImportLog) -> GroundReaction:
    """``loads`` with what the empty plate reads taken off."""
    zero = gait_contacts.estimate_force_offset(loads.vertical)
    if abs(zero) > MAX_PLATE_OFFSET:
        log.add_warning(f"{trial_name}: {description} reads {zero:.1f} N with nobody on it; this was taken off")
    return replace(loads, vertical=loads.vertical - zero)


def assign_to_feet(
    plates: dict[str, GroundReaction],
    legs: Sequence[Side],
    time: Array,
    knee_difference: Array,
    trial_name: str,
    options: ImportOptions,
    log: ImportLog,
) -> dict[Side, GroundReaction]:
    """Each foot's loads from ``plates``; ``bend`` is how much more the right knee is flexed than the left one [deg].

    Where the files have one of the ``legs`` only, everything is taken for its.
    """
    parts: dict[Side, list[tuple[GroundReaction, float, float]]] = {side: [] for side in SIDES}
    for key, raw in plates.items():
        loads = remove_offset(raw, key, trial_name, log)
        spans = gait_contacts.find_contacts(loads.time, loads.vertical, options.contact_threshold)
        feet = [_identify_foot(span, time, knee_difference) for span in spans]
        for foot, span in zip(feet, spans, strict=True):
            known = {f for f in feet if f is not None}
            side: Side | None = foot or (known.pop() if len(known) == 1 else None)
            if key in SIDES:
                side = "right" if key == "right" else "left"
            elif len(legs) == 1:
                side = legs[0]
            if span.toe_off - span.foot_strike > MAX_CONTACT_TIME:
                log.add_warning(
                    f"{trial_name}: {key} is loaded for {span.toe_off - span.foot_strike:.2f} s on end, by both feet or standing; "
                    "this was left out"
                )
            elif side is None:
                log.add_warning(
                    f"{trial_name}: nothing tells whose foot is on {key} at {span.foot_strike:.2f} s; left out"
                )
            else:
                parts[side].append((loads, span.foot_strike, span.toe_off))
                if key not in SIDES and len(legs) > 1:
                    log.add_derived(f"Whose foot is on a plate: the leg with the straighter knee ({side}: {key})")
    return {side: _merge_contacts(found) for side, found in parts.items() if found}


def _identify_foot(contact: gait_contacts.Contact, time: Array, knee_difference: Array) -> Side | None:
    """Whose contact it is; None where it does not tell, as one that is cut by the record's ends often does not."""
    length = (
        contact.toe_off - contact.foot_strike
        if contact.has_foot_strike and contact.has_toe_off
        else TYPICAL_CONTACT_TIME
    )
    strike = contact.foot_strike if contact.has_foot_strike else contact.toe_off - length
    low, high = (strike + share * length for share in MIDSTANCE_RANGE)
    middle = knee_difference[
        (time >= max(low, contact.foot_strike)) & (time <= min(high, contact.toe_off)) & np.isfinite(knee_difference)
    ]
    if not len(middle) or not abs(float(middle.mean())) > MIN_KNEE_DIFFERENCE:
        return None
    return "left" if middle.mean() > 0.0 else "right"


def _merge_contacts(contacts: Sequence[tuple[GroundReaction, float, float]]) -> GroundReaction:
    """One foot's contacts with several plates, on the first one's clock; zero between."""
    time = contacts[0][0].time
    vertical, forward, moment = np.zeros(len(time)), np.zeros(len(time)), np.zeros((len(time), 2))
    has_point = all(loads.cop is not None and np.isfinite(loads.cop).any(axis=0).all() for loads, *_ in contacts)
    for loads, start, end in contacts:
        inside = (time >= start - 0.02) & (time <= end + 0.02)  # what is below the threshold belongs to it
        here = [np.interp(time[inside], loads.time, c) for c in (loads.vertical, loads.forward)]
        vertical[inside] += here[0]
        forward[inside] += here[1]
        if has_point and loads.cop is not None:
            for axis in range(2):
                known = np.isfinite(loads.cop[:, axis])
                place = np.interp(time[inside], loads.time[known], loads.cop[known, axis])
                moment[inside, axis] += here[0] * place
    loaded = np.abs(vertical) > 1e-6
    point = np.where(loaded[:, None], moment / np.where(loaded, vertical, 1.0)[:, None], 0.0)
    return GroundReaction(time, vertical, forward, point if has_point else None)
