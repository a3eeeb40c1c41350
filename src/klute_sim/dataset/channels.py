"""What a trial of each rig holds: names, SI units, roles."""

from types import MappingProxyType
from typing import Literal, get_args

Rig = Literal["bench", "gait"]
RIGS: tuple[Rig, ...] = get_args(Rig)

TIME = "time"
LOAD = "body_load"
VERTICAL = "grf_vertical"

PRESCRIBED = MappingProxyType(
    {
        "bench": {"length": "m", "pressure_command": "Pa"},
        "gait": {"shank_angle": "rad", LOAD: "N", "pressure_command": "Pa"},
    }
)
"""Rig -> channel -> SI unit of what the rig imposes; all of them are needed, without gaps."""

MEASURED = MappingProxyType(
    {
        "bench": {"force": "N", "pressure": "Pa", "muscle_length": "m"},
        "gait": {
            "ankle_angle": "rad",
            "ankle_moment": "N*m",
            VERTICAL: "N",
            "grf_forward": "N",
            "pressure": "Pa",
            "force": "N",
        },
    }
)
"""Rig -> channel -> SI unit of what may be measured; at least one is needed."""

ALIASES = MappingProxyType({"bench": {"unit_length": "length"}, "gait": {}})
"""Rig -> name in a recording of ours -> channel, where the two mean the same."""

# The gait rig tracks the load, it does not predict it. So a trial without `body_load` prescribes its vertical
# reaction (our own gait recordings are such trials), which then is no measurement to be explained.
STANDS_IN = MappingProxyType({"bench": {}, "gait": {LOAD: VERTICAL}})
"""Rig -> prescribed channel -> measured channel that is taken for it where it is missing."""


def known(rig: Rig) -> dict[str, str]:
    """Every column name a trial of ``rig`` may use -> SI unit."""
    units = {TIME: "s", **PRESCRIBED[rig], **MEASURED[rig]}
    return units | {alias: units[channel] for alias, channel in ALIASES[rig].items()}


def channel(rig: Rig, name: str) -> str:
    """The channel that a column called ``name`` holds."""
    return ALIASES[rig].get(name, name)
