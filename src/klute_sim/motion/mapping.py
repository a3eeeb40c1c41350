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
from klute_sim.formats import content
from klute_sim.motion import names
from klute_sim.motion.names import Side

BODY, PROSTHESIS = "body", "prosthesis"
ROLES = ("hip", "knee", "ankle", "heel", "toe", "midfoot", "thigh", "shank", "asis", "psis", "sacrum")
"""What markers can be: joints and points of the foot, clusters of a segment, the pelvis."""
AXES = tuple(f"{sign}{axis}" for sign in ("", "-") for axis in "xyz")


@dataclass(frozen=True)
class Choice:
    """What the user said of one channel; None: to be found out."""

    column: str
    unit: str | None = None
    sign: int | None = None
    zero: float | None = None
    """Value [deg] in the file, after the sign, that is 0 here."""


@dataclass(frozen=True)
class Chosen:
    """Everything the user said."""

    channels: Mapping[tuple[str, str], Choice] = field(default_factory=dict)
    """(side or ``body``, channel) -> choice."""
    markers: Mapping[tuple[Side, str], tuple[str, ...]] = field(default_factory=dict)
    """(side, role) -> marker names."""
    axes: Mapping[str, str] = field(default_factory=dict)
    """``forward`` and ``up`` -> axis of the laboratory."""
    clock: Mapping[str, float] = field(default_factory=dict)
    """Name of a file -> what is added to its times [s]."""

    def columns(self, *, prosthesis: bool) -> set[str]:
        """All columns that are named: those of the prosthesis' own log, or the others."""
        return {c.column for (owner, _), c in self.channels.items() if (owner == PROSTHESIS) == prosthesis}


def read(path: Path | None) -> Chosen:
    """The file at ``path``, or what no file says; raises InputError naming the key and what is allowed."""
    if path is None:
        return Chosen()
    try:
        keys = tomllib.loads(content.read(path).text())
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path} is not valid TOML: {error}") from None
    sides = get_args(Side)
    _known(keys, (*sides, BODY, PROSTHESIS, "markers", "axes", "clock"), str(path))
    channels = {}
    owned = {BODY: (names.TILT, names.BELT, names.TRAVEL), PROSTHESIS: names.PROSTHESIS}
    for owner in (*sides, BODY, PROSTHESIS):
        allowed = owned.get(owner, names.CHANNELS)
        section = _table(keys.get(owner, {}), f"{path}: [{owner}]")
        _known(section, allowed, f"{path}: [{owner}]")
        for channel, value in section.items():
            channels[owner, channel] = _choice(value, f"{path}: {owner}.{channel}")
    markers: dict[tuple[Side, str], tuple[str, ...]] = {}
    chosen = _table(keys.get("markers", {}), f"{path}: [markers]")
    _known(chosen, sides, f"{path}: [markers]")
    for side in sides:
        section = _table(chosen.get(side, {}), f"{path}: [markers.{side}]")
        _known(section, ROLES, f"{path}: [markers.{side}]")
        for role, value in section.items():
            if not isinstance(value, list) or not value or not all(isinstance(name, str) for name in value):
                raise InputError(f"{path}: markers.{side}.{role} must be a list of one or more marker names")
            markers[side, role] = tuple(value)
    axes = _table(keys.get("axes", {}), f"{path}: [axes]")
    _known(axes, ("forward", "up"), f"{path}: [axes]")
    for key, value in axes.items():
        if value not in AXES:
            raise InputError(f"{path}: axes.{key} = {value!r}; allowed: {', '.join(AXES)}")
    if axes and (len(axes) < 2 or axes["forward"][-1] == axes["up"][-1]):
        raise InputError(f"{path}: [axes] needs 'forward' and 'up', along two different axes")
    clock = _table(keys.get("clock", {}), f"{path}: [clock]")
    for file, value in clock.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{path}: clock.'{file}' = {value!r}; allowed is a number of seconds")
    return Chosen(channels, markers, axes, clock)


def _choice(value: Any, where: str) -> Choice:
    if isinstance(value, str) and value:
        return Choice(value)
    if not isinstance(value, dict) or not isinstance(value.get("column"), str):
        raise InputError(f"{where} must be a column's name, or a table with 'column'")
    _known(value, ("column", "unit", "sign", "zero"), where)
    unit, sign, zero = value.get("unit"), value.get("sign"), value.get("zero")
    if unit is not None and not isinstance(unit, str):
        raise InputError(f"{where}: unit = {unit!r}; allowed is a unit as text, such as 'deg'")
    if sign is not None and (isinstance(sign, bool) or sign not in (1, -1)):
        raise InputError(f"{where}: sign = {sign!r}; allowed: 1 and -1")
    if zero is not None and (isinstance(zero, bool) or not isinstance(zero, int | float) or not math.isfinite(zero)):
        raise InputError(f"{where}: zero = {zero!r}; allowed is a number of degrees")
    return Choice(value["column"], unit, sign, zero)


def _table(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{where} must be a table")
    return value


def _known(keys: Mapping[str, Any], allowed: tuple[str, ...], where: str) -> None:
    for key in keys:
        if key not in allowed:
            raise InputError(f"{where}: unknown key '{key}'; allowed: {', '.join(allowed)}")
