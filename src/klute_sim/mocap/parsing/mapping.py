"""``--map FILE``: which column or marker is what, where the names do not say it or say it wrongly.

.. code-block:: toml

    [right]                                # or [left]; [body] for pelvis_tilt and belt_speed
    ankle_angle = { column = "RAnkFlex", unit = "deg", sign = -1, zero = -90.0 }
    knee_angle = "RKneeFlex"               # a column alone: the rest is found out
    [markers.right]
    ankle = ["RMALL"]                      # the joint's centre is the mean of these
    shank = ["RS1", "RS2", "RS3"]          # a cluster: the joints are found from how it moves
    [axes]
    forward = "-y"                         # of the laboratory's axes
    up = "z"
    [prosthesis]                           # its own log: pressure_command, pressure, force, muscle_length
    pressure = { column = "P1", unit = "kPa" }
    [clock]
    "log.csv" = 0.35                       # seconds to add to the times in this file
"""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

from klute_sim.errors import InputError
from klute_sim.mocap.formats import content
from klute_sim.mocap.parsing import channel_names
from klute_sim.mocap.parsing.channel_names import Side

BODY_SECTION, PROSTHESIS_SECTION = "body", "prosthesis"
MARKER_ROLES = ("hip", "knee", "ankle", "heel", "toe", "midfoot", "thigh", "shank", "asis", "psis", "sacrum")
"""What markers can be: joints and points of the foot, clusters of a segment, the pelvis."""
AXIS_NAMES = tuple(f"{sign}{axis}" for sign in ("", "-") for axis in "xyz")


@dataclass(frozen=True)
class ColumnSpec:
    """What the user said of one channel; None: to be found out."""

    column: str
    unit: str | None = None
    sign: int | None = None
    zero: float | None = None
    """Value [deg] in the file, after the sign, that is 0 here."""


@dataclass(frozen=True)
class ImportMapping:
    """Everything the user said."""

    channels: Mapping[tuple[str, str], ColumnSpec] = field(default_factory=dict)
    """(side or ``body``, channel) -> choice."""
    markers: Mapping[tuple[Side, str], tuple[str, ...]] = field(default_factory=dict)
    """(side, role) -> marker names."""
    axes: Mapping[str, str] = field(default_factory=dict)
    """``forward`` and ``up`` -> axis of the laboratory."""
    clock_offsets: Mapping[str, float] = field(default_factory=dict)
    """Name of a file -> what is added to its times [s]."""

    def column_names(self, *, prosthesis: bool) -> set[str]:
        """All columns that are named: those of the prosthesis' own log, or the others."""
        return {c.column for (owner, _), c in self.channels.items() if (owner == PROSTHESIS_SECTION) == prosthesis}


def read(path: Path | None) -> ImportMapping:
    """The file at ``path``, or what no file says; raises InputError naming the key and what is allowed."""
    if path is None:
        return ImportMapping()
    try:
        keys = tomllib.loads(content.read(path).decode())
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not valid TOML: {error}") from None
    sides = get_args(Side)
    _check_keys(keys, (*sides, BODY_SECTION, PROSTHESIS_SECTION, "markers", "axes", "clock"), str(path))
    channels = {}
    owned = {
        BODY_SECTION: (channel_names.PELVIS_TILT, channel_names.BELT_SPEED, channel_names.PELVIS_X),
        PROSTHESIS_SECTION: channel_names.PROSTHESIS_CHANNELS,
    }
    for owner in (*sides, BODY_SECTION, PROSTHESIS_SECTION):
        allowed = owned.get(owner, channel_names.LEG_CHANNELS)
        section = _check_table(keys.get(owner, {}), f"{path}: [{owner}]")
        _check_keys(section, allowed, f"{path}: [{owner}]")
        for channel, value in section.items():
            channels[owner, channel] = _parse_column_spec(value, f"{path}: {owner}.{channel}")
    markers: dict[tuple[Side, str], tuple[str, ...]] = {}
    chosen = _check_table(keys.get("markers", {}), f"{path}: [markers]")
    _check_keys(chosen, sides, f"{path}: [markers]")
    for side in sides:
        section = _check_table(chosen.get(side, {}), f"{path}: [markers.{side}]")
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
    clock = _check_table(keys.get("clock", {}), f"{path}: [clock]")
    for file, value in clock.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{path}: clock.'{file}' = {value!r}; allowed is a number of seconds")
    return ImportMapping(channels, markers, axes, clock)


def _parse_column_spec(value: Any, location: str) -> ColumnSpec:
    if isinstance(value, str) and value:
        return ColumnSpec(value)
    if not isinstance(value, dict) or not isinstance(value.get("column"), str):
        raise InputError(f"{location} must be a column's name, or a table with 'column'")
    _check_keys(value, ("column", "unit", "sign", "zero"), location)
    unit, sign, zero = value.get("unit"), value.get("sign"), value.get("zero")
    if unit is not None and not isinstance(unit, str):
        raise InputError(f"{location}: unit = {unit!r}; allowed is a unit as text, such as 'deg'")
    if sign is not None and (isinstance(sign, bool) or sign not in (1, -1)):
        raise InputError(f"{location}: sign = {sign!r}; allowed: 1 and -1")
    if zero is not None and (isinstance(zero, bool) or not isinstance(zero, int | float) or not math.isfinite(zero)):
        raise InputError(f"{location}: zero = {zero!r}; allowed is a number of degrees")
    return ColumnSpec(value["column"], unit, sign, zero)


def _check_table(value: Any, location: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{location} must be a table")
    return value


def _check_keys(keys: Mapping[str, Any], allowed: tuple[str, ...], location: str) -> None:
    for key in keys:
        if key not in allowed:
            raise InputError(f"{location}: unknown key '{key}'; allowed: {', '.join(allowed)}")
