"""Mapping file of ``--map FILE``: the meaning of columns and markers whose names are unclear or wrong.

.. code-block:: toml

    [right]                                # or [left]; [body] for pelvis_tilt, belt_speed
    ankle_angle = { column = "RAnkFlex", unit = "deg", sign = -1, zero = -90.0 }
    knee_angle = "RKneeFlex"               # column only: unit, sign and zero are detected
    [markers.right]
    ankle = ["RMALL"]                      # the joint centre is the mean of these markers
    shank = ["RS1", "RS2", "RS3"]          # a cluster: joint centres follow from its motion
    [axes]
    forward = "-y"                         # axis of the laboratory frame
    up = "z"
    [prosthesis]                           # log: pressure_command, pressure, force, muscle_length
    pressure = { column = "P1", unit = "kPa" }
    [clock]
    "log.csv" = 0.35                       # time offset of this file [s]
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

from klute_sim.errors import InputError
from klute_sim.files.limits import MAPPING
from klute_sim.files.toml import read_toml
from klute_sim.mocap.parsing import channel_names
from klute_sim.mocap.parsing.channel_names import Side

BODY_SECTION, PROSTHESIS_SECTION = "body", "prosthesis"
MARKER_ROLES = ("hip", "knee", "ankle", "heel", "toe", "midfoot", "thigh", "shank", "asis", "psis", "sacrum")
"""Marker roles: joints and points of the foot, clusters on segments, landmarks of the pelvis."""
AXIS_NAMES = tuple(f"{sign}{axis}" for sign in ("", "-") for axis in "xyz")
"""Names of the laboratory axes and their opposites."""


@dataclass(frozen=True)
class ColumnSpec:
    """User's specification of one channel; None values are detected."""

    column: str
    """Label of the column."""
    unit: str | None = None
    """Unit of the column."""
    sign: int | None = None
    """Factor (1 or -1) that gives the standard sign."""
    zero: float | None = None
    """Reading of the column, after the sign, at the channel's zero, in the column's unit."""


@dataclass(frozen=True)
class ImportMapping:
    """User's assignment of columns and markers."""

    channels: Mapping[tuple[str, str], ColumnSpec] = field(default_factory=dict)
    """(side, ``body`` or ``prosthesis``; channel) -> column specification."""
    markers: Mapping[tuple[Side, str], tuple[str, ...]] = field(default_factory=dict)
    """(side, role) -> marker names."""
    axes: Mapping[str, str] = field(default_factory=dict)
    """``forward`` and ``up`` -> axis of the laboratory frame."""
    clock_offsets: Mapping[str, float] = field(default_factory=dict)
    """File name -> time offset that is added to its times [s]."""

    def get_column_names(self, *, prosthesis: bool) -> set[str]:
        """Return the labels of the assigned columns: those of the prosthesis log, or all others."""
        return {c.column for (owner, _), c in self.channels.items() if (owner == PROSTHESIS_SECTION) == prosthesis}


def read(path: Path | None) -> ImportMapping:
    """Read the mapping file at ``path`` (None: an empty mapping); raise InputError with the key and allowed values."""
    if path is None:
        return ImportMapping()
    keys = read_toml(path, MAPPING)
    sides = get_args(Side)
    _check_keys(keys, (*sides, BODY_SECTION, PROSTHESIS_SECTION, "markers", "axes", "clock"), str(path))
    channels = {}
    section_channels = {
        BODY_SECTION: (channel_names.PELVIS_TILT, channel_names.BELT_SPEED, channel_names.PELVIS_X),
        PROSTHESIS_SECTION: channel_names.PROSTHESIS_CHANNELS,
    }
    for owner in (*sides, BODY_SECTION, PROSTHESIS_SECTION):
        allowed = section_channels.get(owner, channel_names.LEG_CHANNELS)
        section = _check_table(keys.get(owner, {}), f"{path}: [{owner}]")
        _check_keys(section, allowed, f"{path}: [{owner}]")
        for channel, value in section.items():
            channels[owner, channel] = _parse_column_spec(value, f"{path}: {owner}.{channel}")
    markers: dict[tuple[Side, str], tuple[str, ...]] = {}
    marker_sections = _check_table(keys.get("markers", {}), f"{path}: [markers]")
    _check_keys(marker_sections, sides, f"{path}: [markers]")
    for side in sides:
        section = _check_table(marker_sections.get(side, {}), f"{path}: [markers.{side}]")
        _check_keys(section, MARKER_ROLES, f"{path}: [markers.{side}]")
        for role, value in section.items():
            if not isinstance(value, list) or not value or not all(isinstance(name, str) for name in value):
                raise InputError(f"{path}: markers.{side}.{role} must be a list of one or more marker names")
            markers[side, role] = tuple(value)
    axes = _check_table(keys.get("axes", {}), f"{path}: [axes]")
    _check_keys(axes, ("forward", "up"), f"{path}: [axes]")
    for key, value in axes.items():
        if value not in AXIS_NAMES:
            raise InputError(f"{path}: axes.{key} = {value!r}; allowed: {', '.join(AXIS_NAMES)}")
    if axes and (len(axes) < 2 or axes["forward"][-1] == axes["up"][-1]):
        raise InputError(f"{path}: [axes] needs 'forward' and 'up', along two different axes")
    clock_offsets = _check_table(keys.get("clock", {}), f"{path}: [clock]")
    for file, value in clock_offsets.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{path}: clock.'{file}' = {value!r}; allowed is a number of seconds")
    return ImportMapping(channels, markers, axes, clock_offsets)


def _parse_column_spec(value: Any, location: str) -> ColumnSpec:
    if isinstance(value, str) and value:
        return ColumnSpec(value)
    if not isinstance(value, dict) or not isinstance(value.get("column"), str):
        raise InputError(f"{location} must be a column label, or a table with 'column'")
    _check_keys(value, ("column", "unit", "sign", "zero"), location)
    unit, sign, zero = value.get("unit"), value.get("sign"), value.get("zero")
    if unit is not None and not isinstance(unit, str):
        raise InputError(f"{location}: unit = {unit!r}; allowed is a unit as text, such as 'deg'")
    if sign is not None and (isinstance(sign, bool) or sign not in (1, -1)):
        raise InputError(f"{location}: sign = {sign!r}; allowed: 1 and -1")
    if zero is not None and (isinstance(zero, bool) or not isinstance(zero, int | float) or not math.isfinite(zero)):
        raise InputError(f"{location}: zero = {zero!r}; allowed is a number in the unit of the column")
    return ColumnSpec(value["column"], unit, sign, zero)


def _check_table(value: Any, location: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{location} must be a table")
    return value


def _check_keys(keys: Mapping[str, Any], allowed: tuple[str, ...], location: str) -> None:
    for key in keys:
        if key not in allowed:
            raise InputError(f"{location}: unknown key '{key}'; allowed: {', '.join(allowed)}")
