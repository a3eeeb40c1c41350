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

ANGLES = ("hip_angle", "knee_angle", "ankle_angle", "shank_angle", "thigh_angle", "pelvis_tilt")
MOMENT, POWER, BELT, TILT, TRAVEL = "ankle_moment", "ankle_power", "belt_speed", "pelvis_tilt", "pelvis_tx"
VERTICAL, FORWARD = "grf_vertical", "grf_forward"
AXES = ("grf_x", "grf_y", "grf_z")
PLACES = ("ankle_x", "ankle_z", "cop_x")
CHANNELS = (*ANGLES, MOMENT, POWER, BELT, TRAVEL, VERTICAL, FORWARD, *AXES, *PLACES)
COMMAND, PRESSURE, FORCE, LENGTH = "pressure_command", "pressure", "force", "muscle_length"
PROSTHESIS = (COMMAND, PRESSURE, FORCE, LENGTH)
"""Channels of a prosthesis' own log: pressure asked for, in the muscle, tension of the unit, length of the muscle."""
EVENTS = {"lhs", "rhs", "lto", "rto"}
"""Columns of a file of events: left and right heel strike and toe-off."""

_TOKENS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_SIDE: dict[str, Side] = {"left": "left", "l": "left", "right": "right", "r": "right"}
_COMMANDED = {"command", "commanded", "desired", "setpoint", "target"}
_MEASURED = {"measured", "actual", "sensor"}
_NOT_THIS = {"reference", "sd", "command", "beta", "adduction", "rotation", "velocity", "actuator", "passive", "stop"}
_PLATE = re.compile(
    r"(?:(?P<before>\w+?)_)?ground_(?P<what>force|moment|torque)_(?:(?P<name>[A-Za-z0-9]+)_)?"
    r"(?P<kind>[vpm])?_?(?P<axis>[xyz123])"
)


class Named(NamedTuple):
    """What a label says."""

    channel: str
    side: Side | None
    """None: of the whole body, or not said."""
    sign: int
    """What the name says the column has to be multiplied by."""


class PlateColumn(NamedTuple):
    """A column of a ground reaction in OpenSim's way."""

    plate: str
    """Which one; a side's name where the label has one."""
    kind: Literal["force", "point"]
    axis: int
    """0 forward, 1 up, 2 right, in OpenSim's frame."""


def named(label: str) -> Named | None:
    """The channel in a column called ``label``, None for any other."""
    if label in PLACES:  # others' columns of such names may be of another axis
        return Named(label, None, 1)
    tokens = [token.lower() for token in _TOKENS.findall(label)]
    has = set(tokens)
    own = _of_prosthesis(has)
    if own:
        return Named(own, None, 1)
    if has & _NOT_THIS or not tokens:
        return None
    side = next((_SIDE[token] for token in tokens if token in _SIDE), None)
    channel, sign = _channel(has)
    return Named(channel, side, sign) if channel else None


def _of_prosthesis(has: set[str]) -> str:
    """What a prosthesis' own log calls so; '' for anything else, such as a pressure's centre or a muscle's force."""
    plain = has - _MEASURED
    if "pressure" in has and plain & _COMMANDED and plain <= {"pressure", *_COMMANDED}:
        return COMMAND
    exact = {
        PRESSURE: [{"pressure"}],
        LENGTH: [{"muscle", "length"}],
        FORCE: [{"force"}, {"tension"}, {"load", "cell"}],
    }
    return next((channel for channel, names in exact.items() if plain in names), "")


def _channel(has: set[str]) -> tuple[str, int]:
    plantar = any("plantar" in token for token in has)
    if "grf" in has:
        axis = next((f"grf_{a}" for a in ("vertical", "forward", "x", "y", "z") if a in has), "")
        return axis, 1
    if "belt" in has and "speed" in has:
        return BELT, 1
    if "ankle" in has and "power" in has:
        return POWER, 1
    if "ankle" in has and has & {"moment", "torque"}:
        # OpenSim's generalised force of a coordinate that grows with dorsiflexion; others name the plantarflexor's.
        return MOMENT, -1 if "angle" in has and not plantar else 1
    if has & {"moment", "torque", "force", "power", "speed"}:
        return "", 1
    if "pelvis" in has and has & {"tilt", "tx"}:
        return (TILT if "tilt" in has else TRAVEL), 1
    if has & {"angle", "flexion", "dorsiflexion", "plantarflexion"}:
        for joint in ("hip", "knee", "ankle", "shank", "thigh"):
            if joint in has:
                return f"{joint}_angle", -1 if plantar or "extension" in has else 1
    return "", 1


def plate_column(label: str) -> PlateColumn | None:
    """The plate, quantity and axis of a column called ``label`` in OpenSim's way, None for any other."""
    match = _PLATE.fullmatch(label)
    if match is None or match["what"] != "force" or match["kind"] not in ("v", "p"):
        return None
    which = match["before"] or match["name"] or "0"
    axis = {"x": 0, "y": 1, "z": 2, "1": 0, "2": 1, "3": 2}[match["axis"]]
    return PlateColumn(_SIDE.get(which.lower(), which), "force" if match["kind"] == "v" else "point", axis)
