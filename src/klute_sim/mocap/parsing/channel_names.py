"""Parsing of column labels: names of OpenSim, of treadmill software such as D-Flow, and of this package.

Channels of a leg have the signs of :mod:`klute_sim.recording`: ``hip_angle`` and ``knee_angle`` (flexion positive),
``ankle_angle`` (dorsiflexion positive), ``shank_angle`` and ``thigh_angle`` (inclination, upper end forward positive),
``ankle_moment`` (plantarflexor positive), ``ankle_power`` (generation positive), ``grf_x`` to ``grf_z``,
``grf_vertical`` and ``grf_forward``. Channels of the body: ``pelvis_tilt`` (backward positive, as in OpenSim),
``pelvis_tx`` (forward position) and ``belt_speed``. Channels of a prosthesis: ``ankle_x`` and ``ankle_z`` (position of
the ankle, forward of the laboratory's origin and above the ground), ``cop_x``, and :data:`PROSTHESIS_CHANNELS`.
"""

import re
from typing import Literal, NamedTuple, get_args

Side = Literal["right", "left"]
SIDES: tuple[Side, ...] = get_args(Side)

ANGLE_CHANNELS = ("hip_angle", "knee_angle", "ankle_angle", "shank_angle", "thigh_angle", "pelvis_tilt")
ANKLE_MOMENT = "ankle_moment"
ANKLE_POWER = "ankle_power"
BELT_SPEED = "belt_speed"
PELVIS_TILT = "pelvis_tilt"
PELVIS_X = "pelvis_tx"
GRF_VERTICAL = "grf_vertical"
GRF_FORWARD = "grf_forward"
GRF_AXES = ("grf_x", "grf_y", "grf_z")
POSITION_CHANNELS = ("ankle_x", "ankle_z", "cop_x")
LEG_CHANNELS = (
    *ANGLE_CHANNELS,
    *(ANKLE_MOMENT, ANKLE_POWER, BELT_SPEED, PELVIS_X),
    *(GRF_VERTICAL, GRF_FORWARD, *GRF_AXES),
    *POSITION_CHANNELS,
)
"""Channels that ``--map`` can assign to a leg."""
PRESSURE_COMMAND = "pressure_command"
MUSCLE_PRESSURE = "pressure"
MUSCLE_FORCE = "force"
MUSCLE_LENGTH = "muscle_length"
PROSTHESIS_CHANNELS = (PRESSURE_COMMAND, MUSCLE_PRESSURE, MUSCLE_FORCE, MUSCLE_LENGTH)
"""Channels of a prosthesis log: commanded pressure, muscle pressure, tension and length of the muscle."""
EVENT_LABELS = {"lhs", "rhs", "lto", "rto"}
"""Columns of an event file: heel strikes and toe-offs of the left and right foot."""

_ROUND_BRACKETS = re.compile(r"(?P<name>.*?)\s*\((?P<unit>[^()]*)\)")
_TIME_WITH_UNIT = re.compile(r"(?P<name>time|timestamp)_(?P<unit>s|ms)", re.IGNORECASE)
_BRACKET_UNITS = {
    **dict.fromkeys(("s", "sec", "seconds"), "s"),
    **{unit: unit for unit in ("ms", "min", "rad", "m", "mm", "cm", "m/s", "bar", "psi", "kgf", "lbf", "%")},
    **{unit.lower(): unit for unit in ("N", "kN", "N/kg", "BW", "W", "W/kg", "kPa", "MPa")},
    **dict.fromkeys(("deg", "degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("nm", "n*m", "n·m", "n.m", "n-m"), "N*m"),
    **dict.fromkeys(("nm/kg", "n*m/kg", "n·m/kg", "n.m/kg", "n-m/kg"), "N*m/kg"),
}
"""Unit in round brackets, in lower case and without spaces -> unit."""
_TOKEN_PATTERN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_GRF_PATTERN = re.compile(r"grf", re.IGNORECASE)
_SIDE_TOKENS: dict[str, Side] = {"left": "left", "l": "left", "right": "right", "r": "right"}
_GROUND_REACTION_TOKENS = (frozenset({"grf"}), frozenset({"ground", "reaction"}))
_VERTICAL_TOKENS = frozenset({"vertical", "vert", "v"})
_FORE_AFT_TOKENS = (
    *(frozenset({token}) for token in ("forward", "ap", "anteroposterior", "foreaft", "anterior", "posterior")),
    *(frozenset({"fore", "aft"}), frozenset({"a", "p"}), frozenset({"antero", "posterior"})),
    *(frozenset({"braking"}), frozenset({"propulsive"})),
)
"""Words of which each set names the fore-aft axis; the sign is detected, so either end of the axis will do."""
_COMMAND_TOKENS = {"command", "commanded", "cmd", "desired", "setpoint", "target"}
_MEASUREMENT_TOKENS = {"measured", "actual", "sensor"}
_EXCLUDED_TOKENS = frozenset(
    (
        *(*_COMMAND_TOKENS, "reference", "ref", "sd", "std", "beta", "actuator", "passive", "stop"),
        *("velocity", "vel", "acceleration", "acc"),
        *("adduction", "abduction", "inversion", "eversion", "varus", "valgus", "rotation", "frontal", "transverse"),
    )
)
"""Words of columns of a leg that are no measured angle or load in the plane of walking."""
_PLATE_PATTERN = re.compile(
    r"(?:(?:(?P<prefix>\w+?)_)?ground_force(?P<number>\d*)|force(?P<other_number>\d+))_(?:(?P<name>\w+?)_)?"
    r"(?P<kind>[vp])_?(?P<axis>[xyz123])"
)
"""OpenSim's force (v) or point of application (p), such as ``ground_force_vx``, ``1_ground_force_vx``,
``ground_force_1_v_1``, ``ground_force1_vx``, ``ground_force_calcn_r_vx`` (AddBiomechanics) and ``force1_vx``
(GaitDynamics)."""


class ChannelLabel(NamedTuple):
    """Meaning of a column label."""

    channel: str
    """Standard channel name."""
    side: Side | None
    """Side of the leg; None for a channel of the body, or if the label names no side."""
    sign: int
    """Factor that, by the label, converts the column to the standard sign."""


class PlateLabel(NamedTuple):
    """Meaning of an OpenSim label of a ground reaction."""

    plate: str
    """Name of the force plate, or a side."""
    quantity: Literal["force", "point"]
    """Force, or point of application."""
    axis: int
    """Axis of the OpenSim frame: 0 forward, 1 up, 2 right."""


def split_unit(label: str) -> tuple[str, str]:
    """Return the name and the unit of ``label``: ``Time (s)`` and ``time_s`` as ``time [s]``; '' without a unit.

    Round brackets may hold a remark instead, so only :data:`_BRACKET_UNITS` count there.
    """
    if "[" in label:
        name, _, unit = label.partition("[")
        return name.strip(), unit.rstrip("] ")
    match = _ROUND_BRACKETS.fullmatch(label.strip())
    if match is not None and match["unit"].replace(" ", "").lower() in _BRACKET_UNITS:
        return match["name"].strip(), _BRACKET_UNITS[match["unit"].replace(" ", "").lower()]
    time = _TIME_WITH_UNIT.fullmatch(label.strip())
    return (time["name"], time["unit"].lower()) if time is not None else (label.strip(), "")


def strip_unit(label: str) -> str:
    """Return ``label`` without a unit in brackets."""
    return split_unit(label)[0]


def parse_channel_label(label: str) -> ChannelLabel | None:
    """Return the channel that ``label``, with or without a unit, names; None if it names none."""
    label, unit = split_unit(label)
    if label in POSITION_CHANNELS:  # exact names only: similar names of other programs use other axes
        return ChannelLabel(label, None, 1)
    spaced_label = _GRF_PATTERN.sub(" grf ", label)  # one word also in vGRF and GRFz
    ordered_tokens = [token.lower() for token in _TOKEN_PATTERN.findall(spaced_label)]
    tokens = set(ordered_tokens)
    prosthesis_channel = _match_prosthesis_channel(tokens)
    if prosthesis_channel:
        return ChannelLabel(prosthesis_channel, None, 1)
    if tokens & _EXCLUDED_TOKENS or not tokens:
        return None
    side = next((_SIDE_TOKENS[token] for token in ordered_tokens if token in _SIDE_TOKENS), None)
    channel, sign = _match_leg_channel(tokens)
    channel = channel or _match_joint(tokens - _SIDE_TOKENS.keys(), unit)
    return ChannelLabel(channel, side, sign) if channel else None


def _match_prosthesis_channel(tokens: set[str]) -> str:
    """Return the prosthesis channel of ``tokens``; '' for similar quantities such as the centre of pressure."""
    relevant = tokens - _MEASUREMENT_TOKENS
    if "pressure" in tokens and relevant & _COMMAND_TOKENS and relevant <= {"pressure", *_COMMAND_TOKENS}:
        return PRESSURE_COMMAND
    exact = {
        MUSCLE_PRESSURE: [{"pressure"}],
        MUSCLE_LENGTH: [{"muscle", "length"}],
        MUSCLE_FORCE: [{"force"}, {"tension"}, {"load", "cell"}],
    }
    return next((channel for channel, alternatives in exact.items() if relevant in alternatives), "")


def _match_joint(tokens: set[str], unit: str) -> str:
    """Return the channel of a label that names a joint and nothing else, whose ``unit`` says what of it; or ''."""
    joint = next((joint for joint in ("hip", "knee", "ankle") if tokens == {joint}), "")
    unit = _BRACKET_UNITS.get(unit.replace(" ", "").lower(), unit)
    if joint == "ankle" and unit.startswith("N*m"):
        return ANKLE_MOMENT
    return f"{joint}_angle" if joint and unit in ("", "deg", "rad") else ""


def _match_leg_channel(tokens: set[str]) -> tuple[str, int]:
    """Return the leg or body channel of ``tokens`` and the sign by the label; ('', 1) if there is none."""
    plantar = any("plantar" in token for token in tokens)
    if any(words <= tokens for words in _GROUND_REACTION_TOKENS):
        return _match_ground_reaction(tokens), 1
    if "belt" in tokens and "speed" in tokens:
        return BELT_SPEED, 1
    if "ankle" in tokens and "power" in tokens:
        return ANKLE_POWER, 1
    if ("ankle" in tokens or plantar) and tokens & {"moment", "torque"}:
        # The generalised force of OpenSim's ankle angle is positive for dorsiflexion; other programs use the opposite.
        return ANKLE_MOMENT, -1 if "angle" in tokens and not plantar else 1
    if tokens & {"moment", "torque", "force", "power", "speed"}:
        return "", 1
    if "pelvis" in tokens and tokens & {"tilt", "tx"}:
        return (PELVIS_TILT if "tilt" in tokens else PELVIS_X), 1
    if tokens & {"angle", "flexion", "dorsiflexion", "plantarflexion"}:
        for joint in ("hip", "knee", "ankle", "shank", "thigh"):
            if joint in tokens:
                return f"{joint}_angle", -1 if plantar or "extension" in tokens else 1
        if tokens & {"dorsiflexion", "plantarflexion"}:  # only ankles do
            return "ankle_angle", -1 if plantar else 1
    return "", 1


def _match_ground_reaction(tokens: set[str]) -> str:
    """Return the channel of a ground reaction force; '' for its moment, its centre, and an unknown or lateral axis."""
    if tokens & {"moment", "torque", "point", "cop"}:
        return ""
    if tokens & _VERTICAL_TOKENS:
        return GRF_VERTICAL
    if any(words <= tokens for words in _FORE_AFT_TOKENS):
        return GRF_FORWARD
    return next((f"grf_{axis}" for axis in "xyz" if axis in tokens), "")


def parse_plate_label(label: str) -> PlateLabel | None:
    """Return the plate, quantity and axis of an OpenSim ground reaction ``label``; None for other labels."""
    match = _PLATE_PATTERN.fullmatch(label)
    if match is None:
        return None
    plate = match["prefix"] or match["name"] or match["number"] or match["other_number"] or "0"
    side = _SIDE_TOKENS.get(plate.lower().removeprefix("calcn_").removeprefix("foot_"))
    axis = {"x": 0, "y": 1, "z": 2, "1": 0, "2": 1, "3": 2}[match["axis"]]
    return PlateLabel(side or plate, "force" if match["kind"] == "v" else "point", axis)
