"""Which columns of a trial file hold which channel: by their headings, or by the expressions of ``[columns]``."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from klute_sim.datasets import unit_conversion
from klute_sim.datasets.channels import TIME_COLUMN
from klute_sim.datasets.trial_files.expressions import ROW, Expression
from klute_sim.datasets.trial_files.sources import ColumnSource
from klute_sim.errors import InputError, suggest
from klute_sim.types import Array

MAX_SUGGESTION_LENGTH = 80
"""Longest heading that is compared with a misspelt name [letters]."""
MAX_LISTED_COLUMNS = 12
"""Maximum number of columns that one message lists."""

PRESSURE_UNIT = "Pa"
"""SI unit of pressures."""
_HEADING = re.compile(r"(?P<name>\w+)\s*\[(?P<unit>[^\[\]]*)\]")
_HEADING_WITHOUT_UNIT = re.compile(r"(?P<name>\w+)\s*([(\[{/,:].*)?")


class Assignment(NamedTuple):
    """The columns of a channel in one file."""

    heading: str
    """Heading or expression, for messages."""
    indices: Mapping[str, int]
    """Name in the expression -> index of the column; one entry for a channel without an expression."""
    unit: str
    """Unit of the numbers."""
    factor: float
    """Factor of the unit to SI."""
    expression: Expression | None = None
    """Expression; None where the heading names the channel."""

    def compute(self, columns: Mapping[int, Array], n_rows: int, source: str) -> Array:
        """Return the samples (n_rows,) [SI] from the ``columns`` of the file by index."""
        if self.expression is None:
            return columns[next(iter(self.indices.values()))] * self.factor
        values = {name: columns[index] for name, index in self.indices.items()}
        result = self.expression.evaluate(values | {ROW: np.arange(float(n_rows))} if ROW not in values else values)
        is_missing = [np.isnan(np.broadcast_to(samples, result.shape)) for samples in values.values()]
        is_undefined = np.isnan(result) & ~np.any(is_missing, axis=0)
        if is_undefined.any():
            raise InputError(
                f"trial file {source}: {self.expression.label} = '{self.heading}' is not a number in row "
                f"{int(is_undefined.argmax()) + 1}; look for a division by 0"
            )
        return np.array(np.broadcast_to(result * self.factor, (n_rows,)))


@dataclass(frozen=True)
class Assignments:
    """All channels of one file."""

    by_channel: Mapping[str, Assignment]
    """Channel or time -> its columns."""
    missing: Mapping[str, str]
    """Channel -> reason why its expression does not belong to this file."""
    ignored: tuple[str, ...]
    """Headings of columns that are not used."""
    remarks: tuple[str, ...]
    """Remarks for the user, one sentence each."""


def assign_columns(
    file: ColumnSource, column_units: Mapping[str, str], expressions: Mapping[str, Sequence[Expression]], source: str
) -> Assignments:
    """Return the columns of each channel in ``column_units`` (name -> SI unit) that ``file`` has.

    The first expression of a channel applies whose columns the file has, all of them. Raises InputError for a column
    that has no unit or one of another dimension, and for a channel or a name of a column that occurs twice.
    """
    by_channel: dict[str, Assignment] = {}
    missing: dict[str, str] = {}
    remarks = [*file.remarks]
    for channel, alternatives in expressions.items():
        lookups = [(expression, *_find_columns(expression, file, source)) for expression in alternatives]
        applicable = next(((expression, indices) for expression, indices, reason in lookups if not reason), None)
        if applicable is None:
            missing[channel] = _describe_missing([reason for _, _, reason in lookups], alternatives, file)
            continue
        expression, indices = applicable
        unit, factor, remark = _determine_unit(expression, file, indices, column_units[channel], source)
        by_channel[channel] = Assignment(expression.text, indices, unit, factor, expression)
        remarks += [remark] if remark else []
    used = {index for assignment in by_channel.values() for index in assignment.indices.values()}
    # A column that only corrects another channel, such as the force in a length, remains a channel of its own. A
    # pressure does not: where a force is computed from it, the device may have no air.
    sole = {next(iter(a.indices.values())) for a in by_channel.values() if len(a.indices) == 1}
    ignored: list[str] = []
    for index, heading in enumerate(file.headings if file.has_units else ()):
        is_used = index in sole or (index in used and not _states_channel(heading, column_units))
        name = None if is_used else _match_channel(heading, column_units, by_channel, missing, source)
        if name is None:
            ignored += [] if index in used else [heading]
            continue
        if name in by_channel:
            raise InputError(
                f"trial file {source}: columns '{by_channel[name].heading}' and '{heading}' are the same channel; "
                "remove one of them"
            )
        unit, factor = _require_unit(heading, column_units[name], source)
        by_channel[name] = Assignment(heading, {name: index}, unit, factor)
    return Assignments(by_channel, missing, tuple(ignored), tuple(remarks))


def _describe_missing(reasons: Sequence[str], alternatives: Sequence[Expression], file: ColumnSource) -> str:
    """Return why none of the ``alternatives`` applies to ``file``; ``reasons`` hold that of each."""
    if len(reasons) == 1:
        return reasons[0]
    texts = " or ".join(f"'{expression.text}'" for expression in alternatives)
    return f"it does not have the columns of {texts}; its columns are {format_columns(file.headings) or 'none'}"


def is_known_heading(
    heading: str, column_units: Mapping[str, str], expressions: Mapping[str, Sequence[Expression]]
) -> bool:
    """Return whether ``heading`` is that of a column in ``column_units`` or in an expression, with or without unit."""
    names = {heading.casefold(), _split_heading(heading)[0].casefold()}
    return not names.isdisjoint(column_units) or any(
        not names.isdisjoint((column.casefold(), _split_heading(column)[0].casefold()))
        for alternatives in expressions.values()
        for expression in alternatives
        for column in expression.columns
    )


def states_unit(heading: str, si_unit: str) -> bool:
    """Return whether ``heading`` states a unit of the kind of ``si_unit``."""
    unit = _split_heading(heading)[1]
    return unit is not None and unit_conversion.get_si_factor(unit, si_unit) is not None


def format_columns(headings: Sequence[str]) -> str:
    """Return ``headings`` for a message, the first :data:`MAX_LISTED_COLUMNS` of them."""
    n_others = len(headings) - MAX_LISTED_COLUMNS
    listed = ", ".join(map(repr, headings[:MAX_LISTED_COLUMNS]))
    return f"{listed} and {n_others} more" if n_others > 0 else listed


def _find_columns(expression: Expression, file: ColumnSource, source: str) -> tuple[dict[str, int], str]:
    """Return the indices of the columns of ``expression``, and '' or the reason why the file lacks one."""
    indices = {}
    for name in expression.columns:
        matches = _match_headings(name, file)
        if len(matches) > 1:
            first, second = (file.headings[index] for index in matches[:2])
            matching = f"columns '{first}' and '{second}' match it; write the complete heading in backticks"
            equal = f"{len(matches)} columns have the heading '{first}'; rename all but one in the file"
            raise InputError(
                f"trial file {source}: {expression.label} = '{expression.text}' names '{name}', but "
                f"{equal if first == second else matching}"
            )
        if matches:
            indices[name] = matches[0]
        elif name in file.unreadable:
            return {}, f"'{name}' is {file.unreadable[name]}"
        elif name != ROW:
            columns = format_columns(file.headings) or "none"
            candidates = [heading for heading in file.headings if len(heading) <= MAX_SUGGESTION_LENGTH]
            return {}, f"there is no column '{name}'; {suggest(name, candidates, f'the columns are {columns}')}"
    return indices, ""


def _match_headings(name: str, file: ColumnSource) -> list[int]:
    """Return the indices of the headings that ``name`` means: the heading itself, or its part before a unit.

    Case does not matter where nothing else matches, but ``Row`` is not meant by the number of the row.
    """
    names = [_split_heading(heading)[0] for heading in file.headings] if file.has_units else list(file.headings)
    folded = [heading.casefold() for heading in names] if name != ROW else []
    for candidates, target in ((file.headings, name), (names, name), (folded, name.casefold())):
        matches = [index for index, candidate in enumerate(candidates) if candidate == target]
        if matches:
            return matches
    return []


def _split_heading(heading: str) -> tuple[str, str | None]:
    """Return name and unit of a heading of any form, such as ``Force (N)``; None without a unit."""
    opening = {"]": "[", ")": "("}.get(heading[-1:], "")
    start = heading.rfind(opening) if opening else -1
    return (heading, None) if start < 0 else (heading[:start].rstrip(), heading[start + 1 : -1].strip())


def _determine_unit(
    expression: Expression, file: ColumnSource, indices: Mapping[str, int], si_unit: str, source: str
) -> tuple[str, float, str]:
    """Return the unit of ``expression``, its factor to SI, and a remark or ''."""
    name = expression.only_column
    heading = file.headings[indices[name]] if name is not None and name in indices and file.has_units else ""
    heading_unit = _split_heading(heading)[1]
    if expression.unit is not None:
        is_contradiction = heading_unit is not None and unit_conversion.get_si_factor(heading_unit, si_unit) not in (
            None,
            unit_conversion.get_si_factor(expression.unit, si_unit),
        )
        remark = f"trial file {source}: column '{heading}' is read in {expression.unit}, as {expression.label} says"
        factor = unit_conversion.get_si_factor(expression.unit, si_unit) or 1.0
        return expression.unit, factor, remark if is_contradiction else ""
    examples = unit_conversion.EXAMPLE_UNITS[si_unit]
    if heading_unit is None:
        raise InputError(
            f"trial file {source}: {expression.label} = '{expression.text}' names a column without a unit; write for "
            f"example '{expression.text} [{examples.split(',')[0]}]'"
        )
    column_factor = unit_conversion.get_si_factor(heading_unit, si_unit)
    if column_factor is None:
        _check_no_raw_reading(heading, expression.label.split(" ")[-1], si_unit, source)
        raise InputError(
            f"trial file {source}: {expression.label} = '{expression.text}' names the column '{heading}', which has "
            f"{unit_conversion.describe_wrong_unit(heading_unit, si_unit)}"
        )
    return heading_unit, column_factor, ""


def _match_channel(
    heading: str,
    column_units: Mapping[str, str],
    assigned: Mapping[str, Assignment],
    missing: Collection[str],
    source: str,
) -> str | None:
    """Return the channel that ``heading`` names, ignoring case; None for other columns and for mapped channels."""
    match = _HEADING.fullmatch(heading) or _HEADING_WITHOUT_UNIT.fullmatch(heading)
    name = match["name"].lower() if match else ""
    is_mapped = name in assigned and assigned[name].expression is not None
    if match is None or name not in column_units or is_mapped:
        return None
    if match.re is _HEADING_WITHOUT_UNIT and name == TIME_COLUMN and name in missing:
        return None  # the time of another file is stated, and that of this one can be as well
    _check_no_raw_reading(heading, name, column_units[name], source)
    if match.re is _HEADING_WITHOUT_UNIT:
        example = unit_conversion.EXAMPLE_UNITS[column_units[name]].split(",")[0]
        raise InputError(
            f"trial file {source}: column '{heading}' has no unit in square brackets; write for example "
            f"'{name} [{example}]'"
        )
    return name


def _check_no_raw_reading(heading: str, channel: str, si_unit: str, source: str) -> None:
    """Raise InputError where ``heading`` states a unit, such as V, that becomes one of ``channel`` by calibration."""
    unit = _split_heading(heading)[1]
    if unit is None or unit.replace(" ", "").lower() not in unit_conversion.RAW_UNITS:
        return
    example = unit_conversion.EXAMPLE_UNITS[si_unit].split(",")[0]
    raise InputError(
        f"trial file {source}: column '{heading}' is a raw reading in {unit}; state its calibration under [columns], "
        f'for example {channel} = "(`{heading}` - 0.5) * 2.5 [{example}]" if it reads 0.5 {unit} at 0 {example} and '
        f"rises by 1 {unit} per 2.5 {example}, or rename the column to leave it out"
    )


def _states_channel(heading: str, column_units: Mapping[str, str]) -> bool:
    """Return whether ``heading`` is the name of a channel with a unit of its kind, other than a pressure."""
    match = _HEADING.fullmatch(heading)
    name = match["name"].lower() if match else ""
    if match is None or column_units.get(name, PRESSURE_UNIT) == PRESSURE_UNIT:
        return False
    return unit_conversion.get_si_factor(match["unit"].strip(), column_units[name]) is not None


def _require_unit(heading: str, si_unit: str, source: str) -> tuple[str, float]:
    match = _HEADING.fullmatch(heading)
    unit = match["unit"].strip() if match else ""
    factor = unit_conversion.get_si_factor(unit, si_unit)
    if factor is None:
        raise InputError(
            f"trial file {source}: column '{heading}' has {unit_conversion.describe_wrong_unit(unit, si_unit)}"
        )
    return unit, factor
