"""The expressions of ``[columns]`` with which one file becomes a trial of the bench."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np

from klute_sim.datasets import unit_conversion
from klute_sim.datasets.channels import get_column_units
from klute_sim.datasets.draft.headings import PERCENT, RATIO, RELATIVE_UNITS, HeadingMeaning, interpret_heading
from klute_sim.datasets.trial_files.expressions import parse_expression
from klute_sim.datasets.trial_files.sources import ColumnSource, open_source
from klute_sim.datasets.trial_files.table import read_trial_file
from klute_sim.errors import InputError
from klute_sim.files.limits import TRIAL
from klute_sim.files.reading import read_bytes
from klute_sim.types import Array

ATMOSPHERIC_PRESSURE_PA = 101325.0
"""Pressure that is subtracted from absolute pressures [Pa] (standard atmosphere)."""

_SI_UNITS = get_column_units("bench")
USUAL_UNITS = {"s": "s", "m": "mm", "N": "N", "Pa": "bar"}
"""SI unit -> unit that is assumed where a heading states none, and its samples do not contradict."""
UNKNOWN_UNIT = "?"
"""Unit of a length whose numbers are neither mm nor clearly anything else."""
_STANDARD_HEADING = re.compile(r"(?P<name>\w+)\s*\[\s*(?P<unit>[^\[\]]+?)\s*\]")
_PLAIN_NAME = re.compile(r"[^\W\d]\w*")


@dataclass(frozen=True)
class ColumnChoice:
    """Where a channel comes from."""

    heading: str
    """Heading of its column."""
    expression: str | None
    """Expression for ``[columns]``; None where the heading itself names the channel and its unit."""
    unit: str
    """Unit of its numbers."""
    is_unit_assumed: bool = False
    """Whether the file states no unit."""
    remark: str = ""
    """What the user has to check; '' where nothing is assumed."""
    other_expressions: tuple[str, ...] = ()
    """Expressions of the time for the other files of the trial."""

    def list_expressions(self) -> list[str]:
        """Return all expressions for ``[columns]``; none where headings name the channel and its unit."""
        return [*([self.expression] if self.expression else []), *self.other_expressions]


@dataclass(frozen=True)
class Displacement:
    """A column that states how far the unit is from its resting length."""

    heading: str
    """Heading of the column."""
    unit: str
    """Unit of its numbers, which may be relative to the resting length."""
    direction: int
    """1 where the column grows with the length, -1 where it grows as the muscle shortens."""

    def format_length(self, resting_length: float) -> str:
        """Return the expression of the length of a unit with this ``resting_length`` [m]."""
        column, sign = format_column(self.heading), "+" if self.direction > 0 else "-"
        if self.unit in RELATIVE_UNITS:
            fraction = f"{column} / 100" if self.unit == PERCENT else column
            return f"{1e3 * resting_length:.6g} * (1 {sign} {fraction}) [mm]"
        zero = resting_length / (unit_conversion.get_si_factor(self.unit, "m") or 1.0)
        return f"{zero:.6g} {sign} {column} [{self.unit}]"


@dataclass(frozen=True, eq=False)
class RecognizedFile:
    """A file, its channels, and their samples."""

    path: Path
    """The file."""
    choices: Mapping[str, ColumnChoice]
    """Channel or time -> where it comes from."""
    unused: tuple[str, ...]
    """Headings of columns of which no channel is known."""
    samples: Mapping[str, Array]
    """Channel or time -> samples [SI], all at the times of this file; a displacement in per cent is a ratio until its
    resting length is known."""
    displacement: Displacement | None = None
    """Displacement that the length follows from; None where the file holds the length itself."""
    raw_choices: Mapping[str, ColumnChoice] = field(default_factory=dict)
    """Channel of which the file has only a raw reading -> an expression whose calibration the user has to state."""
    readings: Mapping[str, Array] = field(default_factory=dict)
    """The same channels -> numbers of that column."""
    companions: tuple[Path, ...] = ()
    """Other files of the same trial, whose channels are among those above."""

    def get_output(self, channel: str) -> Array | None:
        """Return the samples of ``channel`` [SI], or its raw reading; None where the file has neither."""
        return self.samples.get(channel, self.readings.get(channel))


def recognize_file(path: Path, assumed_units: Mapping[str, str] = MappingProxyType({})) -> RecognizedFile:
    """Return the channels of the file at ``path``, without empty columns; raises InputError when it cannot be read.

    ``assumed_units`` are those of headings without a unit, instead of the usual ones.
    """
    content = read_bytes(path, TRIAL)
    file = open_source(content, path, None, lambda heading: interpret_heading(heading) is not None, ())
    chosen = _choose_headings(file, is_raw=False)
    raw = {name: column for name, column in _choose_headings(file, is_raw=True).items() if name not in chosen}
    unknown = {name for name, (heading, _) in chosen.items() if assumed_units.get(heading) == UNKNOWN_UNIT}
    raw |= {name: chosen.pop(name) for name in unknown}
    choices = {
        channel: _describe_column(heading, meaning, assumed_units.get(heading, ""), has_units=file.has_units)
        for channel, (heading, meaning) in chosen.items()
    }
    plain = {
        channel: ColumnChoice(heading, f"{format_column(heading)} [{_SI_UNITS[channel]}]", _SI_UNITS[channel])
        for channel, (heading, _) in raw.items()
    }
    read = _read_samples(path, {**choices, **plain})
    numbers = {channel: values for channel, values in read.items() if np.isfinite(values).any()}
    used = {heading for channel, (heading, _) in {**raw, **chosen}.items() if channel in numbers}
    return RecognizedFile(
        path,
        choices={channel: choice for channel, choice in choices.items() if channel in numbers},
        unused=tuple(heading for heading in file.headings if heading not in used),
        samples={channel: values for channel, values in numbers.items() if channel in choices},
        raw_choices={
            channel: (_describe_unknown_length if channel in unknown else _describe_reading)(raw[channel][0], channel)
            for channel in raw
            if channel in numbers
        },
        readings={channel: values for channel, values in numbers.items() if channel in raw},
    )


def _choose_headings(file: ColumnSource, *, is_raw: bool) -> dict[str, tuple[str, HeadingMeaning]]:
    """Return the best heading of each channel, in the order of the channels of the bench.

    A column that cannot be read, such as a time of day, is chosen only where no other holds the channel.
    """
    candidates: dict[str, list[tuple[int, str, HeadingMeaning]]] = {}
    for index, heading in enumerate(file.headings):
        meaning = interpret_heading(heading)
        if meaning is not None and meaning.is_raw == is_raw:
            candidates.setdefault(meaning.channel, []).append((index, heading, meaning))
    chosen = {}
    for channel in (channel for channel in _SI_UNITS if channel in candidates):
        columns = sorted(candidates[channel], key=lambda column: column[2].rank)
        readable = (column for column in columns if len(columns) == 1 or _is_readable(file, column[0]))
        chosen[channel] = next(readable, columns[0])[1:]
    return chosen


def _is_readable(file: ColumnSource, index: int) -> bool:
    try:
        file.read_columns([index])
    except InputError:
        return False
    return True


def _describe_column(heading: str, meaning: HeadingMeaning, assumed_unit: str, *, has_units: bool) -> ColumnChoice:
    standard = _STANDARD_HEADING.fullmatch(heading) if has_units and not meaning.is_absolute else None
    if standard and standard["name"].lower() in (meaning.channel, "unit_length") and standard["unit"] == meaning.unit:
        return ColumnChoice(heading, None, meaning.unit)
    unit = meaning.unit or assumed_unit or USUAL_UNITS[_SI_UNITS[meaning.channel]]
    if unit == PERCENT:
        return ColumnChoice(heading, f"{format_column(heading)} / 100 [m]", PERCENT)
    if unit == RATIO:
        remark = "the file states no unit; a fraction of the resting length is assumed, because its numbers are no mm"
        return ColumnChoice(heading, f"{format_column(heading)} [m]", RATIO, is_unit_assumed=True, remark=remark)
    remarks = [] if meaning.unit else [f"the file states no unit; {unit} is assumed"]
    term = format_column(heading)
    if meaning.is_absolute:
        factor = unit_conversion.get_si_factor(unit, "Pa") or 1.0
        term += f" - {ATMOSPHERIC_PRESSURE_PA / factor:.6g}"
        remarks.append("the pressure of the room is subtracted, a standard atmosphere")
    return ColumnChoice(heading, f"{term} [{unit}]", unit, not meaning.unit, "; ".join(remarks))


def _describe_reading(heading: str, channel: str) -> ColumnChoice:
    unit = USUAL_UNITS[_SI_UNITS[channel]]
    remark = f"this is a raw reading; state its calibration: ZERO is the reading at 0 {unit}, SCALE the {unit} per step"
    return ColumnChoice(heading, f"(`{heading}` - ZERO) * SCALE [{unit}]", unit, remark=remark)


def _describe_unknown_length(heading: str, channel: str) -> ColumnChoice:
    column = format_column(heading)
    remark = (
        "the file states no unit, and its numbers are no mm; write [m] if they are metres, or RESTING_LENGTH * (1 - "
        f"{column}) [mm] if they are a contraction relative to the resting length"
    )
    return ColumnChoice(heading, f"{column} [UNIT]", "mm", remark=remark)


def format_column(heading: str) -> str:
    """Return ``heading`` as an expression names it, in backticks unless it is a plain name."""
    return heading if _PLAIN_NAME.fullmatch(heading) else f"`{heading}`"


def _read_samples(path: Path, choices: Mapping[str, ColumnChoice]) -> Mapping[str, Array]:
    expressions = {
        channel: [parse_expression(choice.expression, _SI_UNITS[channel], f"[columns] {channel}", f"trial file {path}")]
        for channel, choice in choices.items()
        if choice.expression is not None
    }
    units = {channel: _SI_UNITS[channel] for channel in choices}
    return read_trial_file(path, units, expressions).columns
