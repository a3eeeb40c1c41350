"""What a trial of each rig holds: names, SI units, roles."""

from types import MappingProxyType
from typing import Literal, get_args

Rig = Literal["bench", "gait"]
RIGS: tuple[Rig, ...] = get_args(Rig)

TIME_COLUMN = "time"
VERTICAL_FORCE = "grf_vertical"

PRESCRIBED_CHANNELS = MappingProxyType(
    {
        "bench": {"length": "m", "pressure_command": "Pa"},
        "gait": {
            "shank_angle": "rad",
            "ankle_x": "m",
            "ankle_z": "m",
            VERTICAL_FORCE: "N",
            "grf_forward": "N",
            "cop_x": "m",
            "pressure_command": "Pa",
        },
    }
)
"""Rig -> channel -> SI unit of what the rig imposes; all of them are needed, without gaps."""

MEASURED_CHANNELS = MappingProxyType(
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

CHANNEL_ALIASES = MappingProxyType({"bench": {"unit_length": "length"}, "gait": {}})
"""Rig -> name in a recording of ours -> channel, where the two mean the same."""

CONTACT_FORCE_THRESHOLD = 20.0
"""Vertical load [N] above which a foot is on the ground (assumed, as is usual for force plates)."""

GAP_TOLERANT_CHANNEL = "cop_x"
"""The one prescribed channel that may have gaps: there is no centre of pressure where nothing presses."""


def get_column_units(rig: Rig) -> dict[str, str]:
    """Every column name a trial of ``rig`` may use -> SI unit."""
    units = {TIME_COLUMN: "s", **PRESCRIBED_CHANNELS[rig], **MEASURED_CHANNELS[rig]}
    return units | {alias: units[channel] for alias, channel in CHANNEL_ALIASES[rig].items()}


def resolve_channel(rig: Rig, name: str) -> str:
    """The channel that a column called ``name`` holds."""
    return CHANNEL_ALIASES[rig].get(name, name)
