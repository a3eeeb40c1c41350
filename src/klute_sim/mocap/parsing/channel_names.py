"""What a column's label says it is: OpenSim's names, those of D-Flow's kind, and our own.

Channels of one leg, with the signs of :mod:`klute_sim.recording`: ``hip_angle``, ``knee_angle`` (flexion positive),
``ankle_angle`` (dorsiflexion positive), ``shank_angle``, ``thigh_angle`` (inclination, upper end forward positive),
``ankle_moment`` (plantarflexor positive), ``ankle_power`` (generation positive), ``grf_x`` to ``grf_z``,
``grf_vertical``, ``grf_forward``; and of the whole body ``pelvis_tilt`` (backward positive, as OpenSim's),
``pelvis_tx`` (its way forward) and ``belt_speed``. Of a prosthesis: ``ankle_x``, ``ankle_z`` (where its ankle is,
forward of the laboratory's origin and above the ground), ``cop_x``, and what its own log holds, :data:`PROSTHESIS`.
"""

import re
from typing import Literal, NamedTuple, get_args

Side = Literal["right", "left"]
SIDES: tuple[Side, ...] = get_args(Side)

ANGLE_CHANNELS = ("hip_angle", "knee_angle", "ankle_angle", "shank_angle", "thigh_angle", "pelvis_tilt")
ANKLE_MOMENT, ANKLE_POWER, BELT_SPEED, PELVIS_TILT, PELVIS_X = (
    "ankle_moment",
    "ankle_power",
    "belt_speed",
    "pelvis_tilt",
    "pelvis_tx",
)
GRF_VERTICAL, GRF_FORWARD = "grf_vertical", "grf_forward"
GRF_AXES = ("grf_x", "grf_y", "grf_z")
POSITION_CHANNELS = ("ankle_x", "ankle_z", "cop_x")
LEG_CHANNELS = (
    *ANGLE_CHANNELS,
    ANKLE_MOMENT,
    ANKLE_POWER,
    BELT_SPEED,
    PELVIS_X,
    GRF_VERTICAL,
    GRF_FORWARD,
    *GRF_AXES,
    *POSITION_CHANNELS,
)
PRESSURE_COMMAND, MUSCLE_PRESSURE, MUSCLE_FORCE, MUSCLE_LENGTH = (
    "pressure_command",
    "pressure",
    "force",
    "muscle_length",
)
PROSTHESIS_CHANNELS = (PRESSURE_COMMAND, MUSCLE_PRESSURE, MUSCLE_FORCE, MUSCLE_LENGTH)
"""Channels of a prosthesis' own log: pressure asked for, in the muscle, tension of the unit, length of the muscle."""
EVENT_LABELS = {"lhs", "rhs", "lto", "rto"}
"""Columns of a file of events: left and right heel strike and toe-off."""

_TOKEN_PATTERN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_SIDE_TOKENS: dict[str, Side] = {"left": "left", "l": "left", "right": "right", "r": "right"}
_COMMAND_TOKENS = {"command", "commanded", "desired", "setpoint", "target"}
_MEASUREMENT_TOKENS = {"measured", "actual", "sensor"}
_EXCLUDED_TOKENS = {
    "reference",
    "sd",
    "command",
    "beta",
    "adduction",
    "rotation",
    "velocity",
    "actuator",
    "passive",
    "stop",
}
_PLATE_PATTERN = re.compile(
    r"(?:(?P<before>\w+?)_)?ground_(?P<what>force|moment|torque)_(?:(?P<name>[A-Za-z0-9]+)_)?"
    r"(?P<kind>[vpm])?_?(?P<axis>[xyz123])"
)


class ChannelLabel(NamedTuple):
    """What a label says."""

    channel: str
    side: Side | None
    """None: of the whole body, or not said."""
    sign: int
    """What the name says the column has to be multiplied by."""


class PlateLabel(NamedTuple):
    """A column of a ground reaction in OpenSim's way."""

    plate: str
    """Which one; a side's name where the label has one."""
    quantity: Literal["force", "point"]
    axis: int
    """0 forward, 1 up, 2 right, in OpenSim's frame."""


def parse_channel_label(label: str) -> ChannelLabel | None:
    """The channel in a column called ``label``, None for any other."""
    if label in POSITION_CHANNELS:  # others' columns of such names may be of another axis
        return ChannelLabel(label, None, 1)
    tokens = [token.lower() for token in _TOKEN_PATTERN.findall(label)]
    has = set(tokens)
    own = _match_prosthesis_channel(has)
    if own:
        return ChannelLabel(own, None, 1)
    if has & _EXCLUDED_TOKENS or not tokens:
        return None
    side = next((_SIDE_TOKENS[token] for token in tokens if token in _SIDE_TOKENS), None)
    channel, sign = _match_leg_channel(has)
    return ChannelLabel(channel, side, sign) if channel else None


def _match_prosthesis_channel(tokens: set[str]) -> str:
    """What a prosthesis' own log calls so; '' for anything else, such as a pressure's centre or a muscle's force."""
    plain = tokens - _MEASUREMENT_TOKENS
    if "pressure" in tokens and plain & _COMMAND_TOKENS and plain <= {"pressure", *_COMMAND_TOKENS}:
        return PRESSURE_COMMAND
    exact = {
        MUSCLE_PRESSURE: [{"pressure"}],
        MUSCLE_LENGTH: [{"muscle", "length"}],
        MUSCLE_FORCE: [{"force"}, {"tension"}, {"load", "cell"}],
    }
    return next((channel for channel, names in exact.items() if plain in names), "")


def _match_leg_channel(tokens: set[str]) -> tuple[str, int]:
    plantar = any("plantar" in token for token in tokens)
    if "grf" in tokens:
        axis = next((f"grf_{a}" for a in ("vertical", "forward", "x", "y", "z") if a in tokens), "")
        return axis, 1
    if "belt" in tokens and "speed" in tokens:
        return BELT_SPEED, 1
    if "ankle" in tokens and "power" in tokens:
        return ANKLE_POWER, 1
    if "ankle" in tokens and tokens & {"moment", "torque"}:
        # OpenSim's generalised force of a coordinate that grows with dorsiflexion; others name the plantarflexor's.
        return ANKLE_MOMENT, -1 if "angle" in tokens and not plantar else 1
    if tokens & {"moment", "torque", "force", "power", "speed"}:
        return "", 1
    if "pelvis" in tokens and tokens & {"tilt", "tx"}:
        return (PELVIS_TILT if "tilt" in tokens else PELVIS_X), 1
    if tokens & {"angle", "flexion", "dorsiflexion", "plantarflexion"}:
        for joint in ("hip", "knee", "ankle", "shank", "thigh"):
            if joint in tokens:
                return f"{joint}_angle", -1 if plantar or "extension" in tokens else 1
    return "", 1


def parse_plate_label(label: str) -> PlateLabel | None:
    """The plate, quantity and axis of a column called ``label`` in OpenSim's way, None for any other."""
    match = _PLATE_PATTERN.fullmatch(label)
    if match is None or match["what"] != "force" or match["kind"] not in ("v", "p"):
        return None
    which = match["before"] or match["name"] or "0"
    axis = {"x": 0, "y": 1, "z": 2, "1": 0, "2": 1, "3": 2}[match["axis"]]
    return PlateLabel(_SIDE_TOKENS.get(which.lower(), which), "force" if match["kind"] == "v" else "point", axis)
