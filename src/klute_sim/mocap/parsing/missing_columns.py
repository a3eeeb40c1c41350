"""Columns that an import did not recognise, and quantities of a leg that it still needs."""

from collections.abc import Sequence

from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import channel_names
from klute_sim.mocap.parsing.channel_lookup import find_column
from klute_sim.mocap.parsing.channel_names import SIDES, Side, parse_channel_label, parse_plate_label, strip_unit
from klute_sim.mocap.parsing.mapping import ImportMapping
from klute_sim.mocap.parsing.sources import SourceFile

MAX_NAMED_COLUMNS = 6
"""Largest number of columns that a sentence names."""
REQUIRED_QUANTITIES = {
    "hip (or thigh, shank) angle": ("hip_angle", "thigh_angle", "shank_angle"),
    "knee angle": ("knee_angle",),
    "ankle angle": ("ankle_angle",),
    "ankle moment": (channel_names.ANKLE_MOMENT,),
}
"""Quantity that a leg needs from tables -> channels of which one is enough; the ground reaction comes to these."""
_AXIS_NAMES = {channel_names.GRF_VERTICAL: "vertical", channel_names.GRF_FORWARD: "fore-aft"}


def describe_missing_load(trial: Sequence[SourceFile], side: Side, options: ImportOptions) -> str:
    """Return which part of the ground reaction of the foot of ``side`` no column shows, and what that means."""
    missing = [channel for channel in _AXIS_NAMES if _lacks(trial, channel, side, options)]
    if missing == [channel_names.GRF_FORWARD]:
        others = [q for q in _list_missing_quantities(trial, side, options) if q != "fore-aft ground reaction"]
        advice = f"; also missing: {', '.join(others)}" if others else ""
        return (
            f"no fore-aft ground reaction of the {side} foot, which the rig tracks as well as the vertical one: add a "
            f"column 'GRF forward [N/kg]'{advice}"
        )
    axis = f"{_AXIS_NAMES[missing[0]]} " if len(missing) == 1 else ""
    return f"no {axis}ground reaction of the {side} foot, so its heel strikes are unknown"


def describe_missing_quantities(trial: Sequence[SourceFile], options: ImportOptions) -> str:
    """Return what the leg of ``trial`` with most quantities still needs, as in ``the right leg: knee angle``."""
    sides = (options.side,) if options.side else SIDES
    missing_by_side = {side: _list_missing_quantities(trial, side, options) for side in sides}
    side, missing = min(missing_by_side.items(), key=lambda item: len(item[1]))
    return f"the {side} leg: {', '.join(missing)}"


def _list_missing_quantities(trial: Sequence[SourceFile], side: Side, options: ImportOptions) -> list[str]:
    missing = [
        quantity
        for quantity, channels in REQUIRED_QUANTITIES.items()
        if all(_lacks(trial, channel, side, options) for channel in channels)
    ]
    axes = [axis for axis in channel_names.GRF_AXES if not _lacks(trial, axis, side, options)]
    has_plates = any(source.plates or any(map(parse_plate_label, source.labels)) for source in trial)
    if has_plates or len(axes) > 1:
        return missing
    missing_axes = [axis for channel, axis in _AXIS_NAMES.items() if _lacks(trial, channel, side, options)]
    return [*missing, *(f"{axis} ground reaction" for axis in missing_axes)]


def _lacks(trial: Sequence[SourceFile], channel: str, side: Side, options: ImportOptions) -> bool:
    return find_column(trial, channel, side, options) is None


def describe_unused_columns(files: Sequence[SourceFile], mapping: ImportMapping) -> str:
    """Return the columns of ``files`` whose names mean nothing to the import, and what to do; '' if there are none."""
    assigned = {*mapping.get_column_names(prosthesis=False), *mapping.get_column_names(prosthesis=True)}
    labels = [
        label
        for source in files
        for label in source.labels
        if label not in assigned
        and label != source.time_label
        and strip_unit(label).lower() not in channel_names.EVENT_LABELS
        and parse_channel_label(label) is None
        and parse_plate_label(label) is None
    ]
    if not labels:
        return ""
    n_more = len(labels) - MAX_NAMED_COLUMNS
    names = ", ".join(f"'{label}'" for label in labels[:MAX_NAMED_COLUMNS]) + (f" and {n_more} more" * (n_more > 0))
    return f"columns not used: {names}; assign them in a file for --map if they contain what is missing"
