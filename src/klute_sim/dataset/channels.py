"""What a trial of each rig holds: names, SI units, roles."""

from types import MappingProxyType
from typing import Literal, get_args

Rig = Literal["bench", "gait"]
RIGS: tuple[Rig, ...] = get_args(Rig)

TIME = "time"
VERTICAL = "grf_vertical"

PRESCRIBED = MappingProxyType(
    {
        "bench": {"length": "m", "pressure_command": "Pa"},
        "gait": {
            "shank_angle": "rad",
            "ankle_x": "m",
            "ankle_z": "m",
            VERTICAL: "N",
            "grf_forward": "N",
            "cop_x": "m",
            "pressure_command": "Pa",
        },
    }
)
"""Rig -> channel -> SI unit of what the rig imposes; all of them are needed, without gaps."""

MEASURED = MappingProxyType(
    {
        "bench": {"force": "N", "pressure": "Pa", "muscle_length": "m"},
        "gait": {
            "ankle_angle": "rad",
            "force": "N",
            "pressure": "Pa",
            "muscle_length": "m",
            "ankle_moment": "N*m",
        },
    }
)
"""Rig -> channel -> SI unit of what may be measured; at least one is needed."""

ALIASES = MappingProxyType({"bench": {"unit_length": "length"}, "gait": {}})
"""Rig -> name in a recording of ours -> channel, where the two mean the same."""

LOADED = 20.0
"""Vertical load [N] above which a foot is on the ground (assumed, as is usual for force plates)."""

UNKNOWN_UNLOADED = "cop_x"
"""The one prescribed channel that may have gaps: there is no centre of pressure where nothing presses."""


def known(rig: Rig) -> dict[str, str]:
    """Every column name a trial of ``rig`` may use -> SI unit."""
    units = {TIME: "s", **PRESCRIBED[rig], **MEASURED[rig]}
    return units | {alias: units[channel] for alias, channel in ALIASES[rig].items()}


def channel(rig: Rig, name: str) -> str:
    """The channel that a column called ``name`` holds."""
    return ALIASES[rig].get(name, name)
