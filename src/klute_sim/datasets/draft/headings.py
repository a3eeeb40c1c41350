"""The channel of the bench that a column heading probably means, in the words and units of laboratories."""

import re
import unicodedata
from typing import NamedTuple

from klute_sim.datasets import unit_conversion
from klute_sim.datasets.channels import get_column_units

MAX_HEADING_LENGTH = 60
"""Length [letters] beyond which a text is a sentence and no heading."""
PERCENT = "%"
"""Unit of an elongation or a contraction that is relative to the resting length."""
RATIO = "1"
"""Unit of such a number that is a fraction, not per cent."""
RELATIVE_UNITS = {PERCENT: 100.0, RATIO: 1.0}
"""Unit of displacements that are relative to the resting length -> number at the resting length."""
_SI_UNITS = get_column_units("bench")
_BRACKETS = re.compile(r"(?P<name>.*?)\s*(\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*(\([ag]\))?[^()]*)\))\s*")
_SEPARATED = re.compile(r"(?P<name>.*?\S)(?P<separator>\s*/\s*|\s+in\s+|[\s_]+)(?P<unit>[^\W\d_]+|%)", re.IGNORECASE)
"""``p / bar``, ``force in N``, ``pressure_bar``, ``contraction / %``."""
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss"})
_TOKEN = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")

_PRESSURE_UNIT = re.compile(r"(?P<unit>[mkh]?pa|m?bar|psi)\(?(g|gauge|rel|ü|(?P<absolute>a|abs|absolute))\)?")
"""A unit that says whether the pressure is a gauge or an absolute pressure, such as ``psig`` or ``kPa abs``."""
_SPELLINGS = {"pa": "Pa", "hpa": "hPa", "kpa": "kPa", "mpa": "MPa", "bar": "bar", "mbar": "mbar", "psi": "psi"}
"""Unit of pressure in small letters -> unit."""
_RAW_WORDS = frozenset(("raw", "count", "counts", "adc", "lsb", "digits", "volt", "volts", "voltage"))
"""Words of such readings where no unit is stated."""
_WEIGHT_UNITS = {"kg": "kgf", "lb": "lbf", "lbs": "lbf"}
"""Unit of a mass on a load cell -> unit of its weight."""

_TIME = frozenset(
    ("time", "t", "timestamp", "elapsed", "zeit", "pruefzeit", "messzeit", "temps", "tiempo", "millis", "micros")
)
_CLOCKS = {"millis": "ms", "micros": "us"}
"""Name of a clock of an Arduino -> its unit."""
_TIME_OF_LABVIEW = "x_value"
"""Heading of the time in text files that LabVIEW writes."""
_PRESSURE = frozenset(("pressure", "p", "press", "gauge", "druck", "istdruck", "pression", "presion"))
_FORCE = frozenset(("force", "f", "load", "loadcell", "tension", "pull", "fuerza")) | frozenset(
    ("kraft", "pruefkraft", "standardkraft")
)
_NAMES_OF_LENGTH = frozenset(("length", "l", "laenge", "longueur", "longitud"))
_SHORTENING = frozenset(("contraction", "shortening", "verkuerzung", "kontraktion"))
_LENGTHENING = frozenset(("elongation", "extension", "lengthening", "verlaengerung"))
_STRAIN = frozenset(("strain", "dehnung"))
_LENGTH = (
    frozenset(("position", "pos", "x", "stroke", "crosshead", "displacement", "disp", "travel", "deflection"))
    | frozenset(("weg", "hub", "traverse", "standardweg", "lvdt"))
    | _NAMES_OF_LENGTH
    | _SHORTENING
    | _LENGTHENING
)
_COMMAND = frozenset(
    (
        "command",
        "commanded",
        "cmd",
        "set",
        "pset",
        "setpoint",
        "sp",
        "desired",
        "des",
        "target",
        "reference",
        "ref",
        "demand",
    )
) | frozenset(("soll", "sollwert", "solldruck", "consigne"))
_MUSCLE = frozenset(("muscle", "pam", "mckibben"))
_PROCESSED = frozenset(
    ("filtered", "filt", "smoothed", "smooth", "lowpass", "lp", "mean", "avg", "std", "sd", "error", "rate", "raw")
)
"""Words of columns that come after others of the same channel."""
_ABSOLUTE = frozenset(("abs", "absolute"))
_UPSTREAM = frozenset(("supply", "line", "tank", "reservoir", "compressor", "source", "upstream", "versorgung"))
"""Words of a pressure that is not yet that of the muscle; such a column comes after others."""
_NO_PRESSURE = frozenset(("stress", "modulus", "zugspannung"))
"""Words of quantities with the unit of a pressure, which testing machines compute."""
_ROOM = frozenset(
    (
        "ambient",
        "atmospheric",
        "atmosphere",
        "barometric",
        "barometer",
        "room",
        "umgebung",
        "umgebungsdruck",
        "luftdruck",
    )
)
"""Words of the pressure of the room, which is not that of the muscle."""

_START = r"(?:(?<![A-Za-z])|(?<=[a-z])(?=[A-Z])|(?=[A-Z][a-z]))"
_END = r"(?:(?![A-Za-z])|(?<=[a-z])(?=[A-Z])|(?=[A-Z][a-z]))"
_GAIT = re.compile(rf"{_START}(?!copy|Copy|COPY)(?i:[lrv]?(grf|cop|shank|ankle)(?:[xyzv]|ap|ml)?){_END}")
"""A word of recordings of gait, with or without letters for a side, a direction and an axis, such as ``GRFz``, ``CoPx``
or ``vGRF``; ``copy`` is none."""


class HeadingMeaning(NamedTuple):
    """What a heading probably means."""

    channel: str
    """Channel, or time."""
    unit: str
    """Unit that the heading states; '' without one."""
    rank: int
    """Order among the columns of one channel; the smallest comes first."""
    is_absolute: bool = False
    """Whether the heading says that the pressure is absolute."""
    is_length: bool = False
    """Whether the heading says length, not position or displacement."""
    direction: int = 0
    """1 where the heading says that a displacement lengthens the muscle, -1 where it shortens it; else 0."""
    is_raw: bool = False
    """Whether the numbers are a reading without calibration, in volts or counts."""


def interpret_heading(heading: str) -> HeadingMeaning | None:
    """Return what ``heading`` probably means; None where neither its words nor its unit belong to a channel."""
    if len(heading) > MAX_HEADING_LENGTH:
        return None
    name, stated_unit = _split_unit(heading)
    stated_unit, _, note = stated_unit.partition(",")  # such as (bar, absolute)
    tokens = _split_words(f"{name} {note}")
    key = stated_unit.replace(" ", "").lower()
    is_raw = key in unit_conversion.RAW_UNITS or (not key and bool(tokens & _RAW_WORDS))
    pressure_unit = _PRESSURE_UNIT.fullmatch(key)
    unit = "" if is_raw else stated_unit
    if pressure_unit:
        unit = _SPELLINGS[pressure_unit["unit"]]
    elif key in _SPELLINGS and not _get_si_unit(stated_unit):
        unit = _SPELLINGS[key]
    elif unit and not _get_si_unit(unit) and _get_si_unit(key):
        unit = key  # such as MM or Newtons
    if not stated_unit:
        unit = next((_CLOCKS[token] for token in tokens if token in _CLOCKS), "")
    if key in _WEIGHT_UNITS and tokens & (_FORCE | {"weight", "cell"}):
        unit = _WEIGHT_UNITS[key]
    channel = _find_channel(name, tokens, unit)
    if channel is None or (is_raw and channel == "time"):
        return None
    is_upstream = channel == "pressure" and bool(tokens & _UPSTREAM)
    is_other = 2 * len(tokens & _PROCESSED) + is_upstream + (not tokens & _get_words(channel)) + (not unit)
    rank = MAX_HEADING_LENGTH * (not unit) if name.lower() == channel else MAX_HEADING_LENGTH * is_other + len(tokens)
    is_absolute = channel in ("pressure", "pressure_command") and (
        bool(pressure_unit and pressure_unit["absolute"]) or bool(tokens & _ABSOLUTE)
    )
    direction = bool(tokens & _LENGTHENING) - bool(tokens & _SHORTENING)
    return HeadingMeaning(channel, unit, rank, is_absolute, bool(tokens & _NAMES_OF_LENGTH), direction, is_raw)


def find_gait_words(heading: str) -> set[str]:
    """Return the words of ``heading`` that recordings of gait have."""
    return {word.lower() for word in _GAIT.findall(heading)}


def _split_words(name: str) -> set[str]:
    return {token.lower() for token in _TOKEN.findall(_spell_in_ascii(name))}


def _spell_in_ascii(text: str) -> str:
    """Return ``text`` with umlauts as two letters, and without accents."""
    decomposed = unicodedata.normalize("NFKD", text.translate(_UMLAUTS))
    return "".join(letter for letter in decomposed if not unicodedata.combining(letter))


def _split_unit(heading: str) -> tuple[str, str]:
    """Return name and unit of ``heading``; '' where no unit of a channel of the bench is stated."""
    match = _BRACKETS.fullmatch(heading)
    if match is not None:
        return match["name"], (match["square"] or match["round"] or "").strip()
    match = _SEPARATED.fullmatch(heading)
    if match is None:
        return heading, ""
    key = match["unit"].lower()
    kind = "Pa" if _PRESSURE_UNIT.fullmatch(key) else "N" if key in _WEIGHT_UNITS else _get_si_unit(match["unit"])
    if not match["separator"].strip(" _"):  # what follows may be a word: pressure_in, F_m
        channel = _find_channel(match["name"], _split_words(match["name"]), "")
        kind = kind if channel is None or kind == _SI_UNITS[channel] else None
    return (
        (match["name"], match["unit"]) if kind or key in unit_conversion.RAW_UNITS or key == PERCENT else (heading, "")
    )


def _get_si_unit(unit: str) -> str | None:
    return next((si for si in ("s", "m", "N", "Pa") if unit_conversion.get_si_factor(unit, si) is not None), None)


def _find_channel(name: str, tokens: set[str], unit: str) -> str | None:
    if name.lower() in _SI_UNITS:
        return "length" if name.lower() == "unit_length" else name.lower()
    if name.lower() == _TIME_OF_LABVIEW:
        return "time"
    if unit == PERCENT:
        return "length" if tokens & (_SHORTENING | _LENGTHENING | _STRAIN) and not tokens & _COMMAND else None
    si_unit = _get_si_unit(unit) if unit else None
    if unit and si_unit is None:
        return None  # such as degrees
    is_command = bool(tokens & _COMMAND)
    if si_unit == "s" or (si_unit is None and tokens & _TIME):
        return "time" if tokens & _TIME or not tokens else None
    if tokens & _NO_PRESSURE:
        return None
    if tokens & _ROOM and (si_unit == "Pa" or tokens & _PRESSURE):
        return None
    if si_unit == "Pa" or (si_unit is None and tokens & _PRESSURE):
        return "pressure_command" if is_command else "pressure"
    if si_unit == "N" or (si_unit is None and tokens & _FORCE):
        return None if is_command else "force"
    if si_unit == "m" or (si_unit is None and tokens & _LENGTH):
        return None if is_command else "muscle_length" if tokens & _MUSCLE else "length"
    return "pressure_command" if is_command else None


def _get_words(channel: str) -> frozenset[str]:
    words = {"time": _TIME, "force": _FORCE, "pressure": _PRESSURE, "pressure_command": _COMMAND, "length": _LENGTH}
    return words.get(channel, _MUSCLE)
