"""Channels of the trials of each rig: names, SI units and roles."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple, TypeAlias, get_args

from klute_sim.datasets.mechanism_channels import parse_channel

Rig = Literal["bench", "gait"]
"""Rig whose channels are always the same."""
RIGS: tuple[Rig, ...] = get_args(Rig)
RigName = Literal["bench", "gait", "mjcf"]
"""Rig that the trials of a dataset are recorded on; ``mjcf`` is a model that the dataset names, with its channels."""


class MechanismChannels(NamedTuple):
    """Channels that a dataset of a mechanism names (:mod:`klute_sim.datasets.mechanism_channels`)."""

    prescribed: tuple[str, ...]
    """Prescribed channels; every trial has all of them."""
    measured: tuple[str, ...]
    """Measured channels; every trial has at least one of them."""


ChannelSource: TypeAlias = Rig | MechanismChannels
"""Where the channels of trials follow from: their rig, or what the dataset of a mechanism names."""

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

MOTION_CHANNELS = ("shank_angle", "ankle_x", "ankle_z")
"""Prescribed channels of gait whose accelerations move the foot."""
MAX_MOTION_INTERVAL = 0.02
"""Largest sampling interval of these [s], for the low-pass filter of a replay with a cutoff of 16 Hz."""

GAP_TOLERANT_CHANNEL = "cop_x"
"""The only prescribed channel that may have gaps: an unloaded foot has no centre of pressure."""


def get_prescribed_units(source: ChannelSource) -> Mapping[str, str]:
    """Return channel -> SI unit of the inputs that the trials of ``source`` need."""
    if isinstance(source, MechanismChannels):
        return {name: parse_channel(name).si_unit for name in source.prescribed}
    return PRESCRIBED_CHANNELS[source]


def get_measured_units(source: ChannelSource) -> Mapping[str, str]:
    """Return channel -> SI unit of the outputs of which the trials of ``source`` need at least one."""
    if isinstance(source, MechanismChannels):
        return {name: parse_channel(name).si_unit for name in source.measured}
    return MEASURED_CHANNELS[source]


def get_rig_name(source: ChannelSource) -> RigName:
    """Return the name of the rig of ``source``."""
    return "mjcf" if isinstance(source, MechanismChannels) else source


def _get_aliases(source: ChannelSource) -> Mapping[str, str]:
    return {} if isinstance(source, MechanismChannels) else CHANNEL_ALIASES[source]


def get_column_units(source: ChannelSource) -> dict[str, str]:
    """Return all column names allowed in a trial of ``source`` with their SI units."""
    units = {TIME_COLUMN: "s", **get_prescribed_units(source), **get_measured_units(source)}
    return units | {alias: units[channel] for alias, channel in _get_aliases(source).items()}


def resolve_channel(source: ChannelSource, name: str) -> str:
    """Return the channel of a column called ``name``."""
    return _get_aliases(source).get(name, name)
