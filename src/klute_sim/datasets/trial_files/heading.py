"""The heading of a text file: where it stands, in which encoding, and what separates its cells."""

import csv
import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

from klute_sim.datasets.unit_conversion import EXAMPLE_UNITS, get_si_factor
from klute_sim.errors import InputError
from klute_sim.files import lines
from klute_sim.files.limits import TRIAL

DELIMITERS = ",;\t"
"""Allowed characters between cells."""
MAX_PREAMBLE_LINES = 200
"""Number of lines among which the heading is searched for."""
NUMBER = re.compile(r"[+-]?(\d++(\.\d*+)?|\.\d++)(e[+-]?\d++)?|[+-]?nan", re.IGNORECASE)
"""A number with a decimal point, or a missing sample."""

_DECIMAL = r"[+-]?(?:\d++(?:[.,]\d++)?\.?|[.,]\d++)(?:e[+-]?\d++)?|[+-]?nan"
_SPACED_NUMBERS = re.compile(rf" *+(?:{_DECIMAL})(?P<others>(?: ++(?:{_DECIMAL}))*+) *+", re.IGNORECASE)
"""One number or several with spaces between them, with decimal points or commas."""
_ANY_DELIMITER = re.compile(r"[,;\s\"]")
_LINE = re.compile(rb"([^\r\n]*)(\r\n|\n|\r|\Z)")
_UNIT_CELL = re.compile(r"\(([^()]*)\)|\[([^\[\]]*)\]")
_NO_UNIT = frozenset(("", "-", "--"))
"""Cells of a line of units that state none."""
_QUOTED = re.compile(r'"[^"]*"')
_COMMENT_LETTERS = "#% "
"""Letters with which a program may begin the heading."""


class Heading(NamedTuple):
    """The heading of a text file."""

    cells: tuple[str, ...]
    """Column headings."""
    delimiter: str
    """Character between cells."""
    line: int
    """Number of its line."""
    n_bytes: int
    """Bytes up to the first row of numbers."""
    first_row_line: int
    """Line number of the first row."""
    has_preamble: bool
    """Whether there is text above it."""


class _Line(NamedTuple):
    number: int
    content: bytes
    start: int
    end: int


_BEGINNING = _Line(0, b"", 0, 0)


def find_heading(content: bytes, source: str, heading_row: int | None, is_known: Callable[[str], bool]) -> Heading:
    """Return the heading of ``content``: line ``heading_row``, or the line with most known columns.

    ``is_known`` tells whether a cell is the heading of a known column. Without such a line, the heading is the first
    line that is not blank. A line of units below the heading belongs to it. Raises InputError when there is no heading.
    """
    line = _get_line(content, source, heading_row) if heading_row else _search_line(content, is_known)
    following = next((other for other in _iterate_lines(content, line) if other.content.strip()), None)
    cells, delimiter = _split(_decode(line.content), _decode(following.content) if following else "", source)
    if is_known(cells[0].lstrip(_COMMENT_LETTERS)):
        cells = (cells[0].lstrip(_COMMENT_LETTERS), *cells[1:])
    if all(NUMBER.fullmatch(number) for number in _ANY_DELIMITER.split(_decode(line.content)) if number):
        where = f"line {line.number}" if heading_row else "the first line"
        raise InputError(
            f"trial file {source} has no heading: {where} must name the columns, such as 'time [s]'; if the heading "
            "stands elsewhere, give its line as heading_row"
        )
    if len(cells) == 1 or not any(is_known(cell) for cell in cells):
        _check_no_spaces(content, line, source)
    units = _read_units(following.content, delimiter, len(cells)) if following else None
    if following and units:
        cells = tuple(
            f"{cell} [{unit}]" if unit and "[" not in cell else cell for cell, unit in zip(cells, units, strict=True)
        )
    last = following if following and units else line
    has_preamble = bool(content[: line.start].strip())
    return Heading(cells, delimiter, line.number, last.end, last.number + 1, has_preamble)


def _check_no_spaces(content: bytes, heading: _Line, source: str) -> None:
    """Raise InputError where the first row of numbers below ``heading`` has only spaces between them.

    Where no column is known, ``heading`` may be a line of the text above, so this row may stand further below.
    """
    for line in _iterate_lines(content, heading):
        row = _SPACED_NUMBERS.fullmatch(_decode(line.content))
        if row and row["others"]:
            raise InputError(
                f"trial file {source}: its columns are separated by spaces; separate them by commas, semicolons or tabs"
            )
        if row or line.number > MAX_PREAMBLE_LINES:
            return


def _iterate_lines(content: bytes, after: _Line = _BEGINNING) -> Iterator[_Line]:
    """Yield the lines of ``content`` after the line ``after``."""
    number, position = after.number, after.end
    while position < len(content):
        match = _LINE.match(content, position)
        if match is None:
            return
        number += 1
        yield _Line(number, match[1], position, match.end())
        position = match.end()


def _get_line(content: bytes, source: str, heading_row: int) -> _Line:
    line = _BEGINNING
    for line in _iterate_lines(content):
        if line.number == heading_row:
            break
    if line.number != heading_row or not line.content.strip():
        state = "is blank" if line.number == heading_row else f"is beyond its last line, {line.number}"
        raise InputError(f"trial file {source}: heading_row = {heading_row} {state}; give the line of the heading")
    return line


def _search_line(content: bytes, is_known: Callable[[str], bool]) -> _Line:
    best, best_count = None, -1
    for line in _iterate_lines(content):
        if line.number > MAX_PREAMBLE_LINES and best is not None:
            break
        if not line.content.strip():
            continue
        text = _decode(line.content)
        count = max(_count_known(text, delimiter, is_known) for delimiter in DELIMITERS)
        if count > best_count:
            best, best_count = line, count
    return best or _BEGINNING


def _count_known(text: str, delimiter: str, is_known: Callable[[str], bool]) -> int:
    """Return the number of known headings in a line; one that is repeated, as in a LabVIEW file, counts once."""
    try:
        cells = _split_cells(text, delimiter)
    except csv.Error:
        return 0
    names = {cell.lstrip(_COMMENT_LETTERS).casefold(): cell for cell in cells if not cell[:1].isdigit()}
    return sum(is_known(cell.lstrip(_COMMENT_LETTERS)) for cell in names.values())


def _decode(line: bytes) -> str:
    """Return the text of ``line``: UTF-8, or the encoding of Windows and of old instruments, which hold ° and µ."""
    for encoding in ("utf-8", "cp1252"):
        try:
            return line.decode(encoding)
        except UnicodeDecodeError:
            continue
    return line.decode("latin-1")


def _choose_delimiter(text: str, following: str) -> str:
    """Return the delimiter of the heading ``text``: one as often in the ``following`` line, else the most frequent.

    Units and remarks hold commas, and so do decimal numbers, so a comma is the last choice.
    """
    heading, row = (_QUOTED.sub("", line) for line in (text, following))
    delimiters = DELIMITERS[::-1]
    matching = (delimiter for delimiter in delimiters if 0 < heading.count(delimiter) == row.count(delimiter))
    return next(matching, max(delimiters, key=heading.count))


def _split_cells(text: str, delimiter: str) -> list[str]:
    """Return the cells of a line; raises csv.Error for an open quote or a cell that is too long."""
    return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter, strict=True), [])]


def _split(text: str, following: str, source: str) -> tuple[tuple[str, ...], str]:
    delimiter = _choose_delimiter(text, following)
    lines.check_column_count(text.count(delimiter) + 1, TRIAL.describe(source))
    try:
        cells = _split_cells(text, delimiter)
    except csv.Error as error:
        raise InputError(f"trial file {source}: the heading line cannot be read: {error}") from None
    return tuple(cells), delimiter


def _read_units(line: bytes, delimiter: str, n_cells: int) -> list[str] | None:
    """Return the unit of each column if ``line`` holds units and nothing else.

    They stand in brackets; or no cell is a number, at least half are units of channels, and the others, such as ``V``,
    are taken for units too.
    """
    try:
        cells = _split_cells(_decode(line), delimiter)
    except csv.Error:
        return None
    if len(cells) != n_cells:
        return None
    matches = [_UNIT_CELL.fullmatch(cell) for cell in cells]
    if any(matches) and all(match or not cell for match, cell in zip(matches, cells, strict=True)):
        return [(match[1] or match[2] or "").strip() if match else "" for match in matches]
    n_units = sum(any(get_si_factor(cell, si) is not None for si in EXAMPLE_UNITS) for cell in cells if cell)
    if n_units == 0 or 2 * n_units < sum(map(bool, cells)) or any(NUMBER.match(cell) for cell in cells):
        return None
    return ["" if cell in _NO_UNIT else cell for cell in cells]
