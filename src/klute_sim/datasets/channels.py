"""Channels of the trials of each rig: names, SI units and roles."""

from types import MappingProxyType
from typing import Literal, get_args

Rig = Literal["bench", "gait"]
"""Rig that trials are recorded on."""
RIGS: tuple[Rig, ...] = get_args(Rig)

TIME_COLUMN = "time"
"""Column with the time of each row."""
VERTICAL_FORCE = "grf_vertical"
"""Channel of the vertical ground reaction force."""

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
"""Rig -> channel -> SI unit of the inputs that the rig prescribes; all are required, without gaps."""

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
"""Rig -> channel -> SI unit of the measured outputs; at least one is required."""

TENSION_CHANNELS = frozenset({"force", "muscle_length"})
"""Measured channels of the bench that depend on the tension, and so on muscle, damper and tendon."""

CHANNEL_ALIASES = MappingProxyType({"bench": {"unit_length": "length"}, "gait": {}})
"""Rig -> name in a simulated recording -> equivalent channel."""

CONTACT_FORCE_THRESHOLD = 20.0
"""Vertical force [N] above which the foot is in contact (assumed; common for force plates)."""

GAP_TOLERANT_CHANNEL = "cop_x"
"""The only prescribed channel that may have gaps: an unloaded foot has no centre of pressure."""


def get_column_units(rig: Rig) -> dict[str, str]:
    """Return all column names allowed in a trial of ``rig`` with their SI units."""
    units = {TIME_COLUMN: "s", **PRESCRIBED_CHANNELS[rig], **MEASURED_CHANNELS[rig]}
    return units | {alias: units[channel] for alias, channel in CHANNEL_ALIASES[rig].items()}


def resolve_channel(rig: Rig, name: str) -> str:
    """Return the channel of a column called ``name``."""
    return CHANNEL_ALIASES[rig].get(name, name)
