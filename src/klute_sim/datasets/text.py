"""Delimited text: a heading line, then numbers with decimal points, separated by comma, semicolon or tab.

The fast reader's errors are vague; after one, the text is searched line by line to name the line and the cell.
"""

import csv
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.csv

from klute_sim.errors import InputError
from klute_sim.files import lines
from klute_sim.files.limits import TRIAL
from klute_sim.types import Array

BOM = b"\xef\xbb\xbf"
"""Byte order mark of UTF-8."""
DELIMITERS = ",;\t"
"""Allowed characters between cells."""

_LEADING_BLANK_LINES = re.compile(rb"([ \t]*(\r\n|\n|\r))*")
_ANY_DELIMITER = re.compile(r"[,;\s\"]")
_FIRST_LINE = re.compile(rb"[^\r\n]*(\r\n|\n|\r)?")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?nan", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?[\d.]*,\d+([eE][+-]?\d+)?")
_MISSING_VALUES = [" " * width for width in range(33)]
"""Empty cells, with or without padding by blanks."""


@dataclass(frozen=True)
class DelimitedText:
    """A text file with a heading line."""

    source: str
    """Path of the file for error messages."""
    headings: tuple[str, ...]
    """Column headings."""
    delimiter: str
    """Character between cells."""
    body: bytes
    """Content below the heading line."""
    first_line: int
    """Line number of the body's first line."""

    def iterate_lines(self) -> Iterator[tuple[int, str]]:
        """Yield line number and text of each row; empty lines are skipped."""
        for number, line in enumerate(lines.iterate_lines(self.body), self.first_line):
            if line:
                yield number, line.decode("utf-8", errors="replace")

    def locate_row(self, row: int) -> str:
        """Return ``line N`` for the row with index ``row``."""
        return next(f"line {number}" for k, (number, _) in enumerate(self.iterate_lines()) if k == row)

    def read_columns(self, indices: Sequence[int]) -> list[Array]:
        """Return the columns with ``indices``; an empty cell becomes NaN. Raises InputError for a malformed row."""
        self._check_quotes()
        if not self.body.strip():
            return [np.empty(0) for _ in indices]
        names = [str(index) for index in range(len(self.headings))]
        selected = [names[index] for index in indices]
        try:
            table = pyarrow.csv.read_csv(
                pa.py_buffer(self.body),
                # With several threads, pyarrow 26 once failed "for an unknown reason" on a busy machine.
                read_options=pyarrow.csv.ReadOptions(column_names=names, use_threads=False),
                parse_options=pyarrow.csv.ParseOptions(delimiter=self.delimiter),
                convert_options=pyarrow.csv.ConvertOptions(
                    include_columns=selected,
                    column_types=dict.fromkeys(selected, pa.float64()),
                    null_values=_MISSING_VALUES,
                    check_utf8=False,
                ),
            )
        except (pa.ArrowException, OSError, ValueError) as error:
            reason = str(error).splitlines()[0]
            raise InputError(f"trial file {self.source}: {self._find_error(indices) or reason}") from None
        return [table.column(name).to_numpy() for name in selected]

    def _check_quotes(self) -> None:
        # An open quote would silently turn the rest of the file into one cell.
        if b'"' not in self.body:
            return
        for number, line in self.iterate_lines():
            if line.count('"') % 2:
                raise InputError(
                    f"trial file {self.source}: line {number} opens a quote and does not close it; every row must "
                    "be one line"
                )

    def _find_error(self, indices: Sequence[int]) -> str | None:
        """Return the first error in a row as the end of a sentence, or None."""
        n_columns = len(self.headings)
        for number, line in self.iterate_lines():
            cells = next(csv.reader([line], delimiter=self.delimiter), [])
            if len(cells) != n_columns:
                has_comma = len(cells) > n_columns and self.delimiter == ","
                fix = "; write decimal points, not commas" if has_comma else ""
                return (
                    f"line {number} has {_format_cell_count(len(cells))}, but the heading has "
                    f"{_format_cell_count(n_columns)}{fix}"
                )
            for index in indices:
                cell_error = _describe_cell_error(cells[index].strip())
                if cell_error:
                    return f"column '{self.headings[index]}', line {number}: {cell_error}"
        return None


def parse_delimited_text(content: bytes, source: str) -> DelimitedText:
    """Return headings, delimiter and body of ``content``; raises InputError for anything but text with a heading."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(f"trial file {source} is UTF-16 text; save it as UTF-8")
    if b"\0" in content:
        raise InputError(f"trial file {source} is neither text nor Parquet nor a MAT-file; allowed: CSV, Parquet, .mat")
    lines.check_lines(content, TRIAL.describe(source))
    content = content.removeprefix(BOM)
    if not content.strip():
        raise InputError(f"trial file {source} is empty")
    blank = _match_bytes(_LEADING_BLANK_LINES, content, 0)
    line = _match_bytes(_FIRST_LINE, content, len(blank))
    try:
        text = line.decode("utf-8").strip("\r\n")
    except UnicodeDecodeError:
        raise InputError(f"trial file {source}: the heading line is not UTF-8 text; save the file as UTF-8") from None
    delimiter = max(DELIMITERS, key=text.count)
    lines.check_column_count(text.count(delimiter) + 1, TRIAL.describe(source))
    try:
        headings = [heading.strip() for heading in next(csv.reader([text], delimiter=delimiter, strict=True))]
    except csv.Error as error:
        raise InputError(f"trial file {source}: the heading line cannot be read: {error}") from None
    if all(_NUMBER.fullmatch(number) for number in _ANY_DELIMITER.split(text) if number):
        raise InputError(
            f"trial file {source} has no heading: the first line must name the columns, such as 'time [s]'"
        )
    first_line = len(blank.splitlines()) + 2
    return DelimitedText(source, tuple(headings), delimiter, content[len(blank) + len(line) :], first_line)


def _match_bytes(pattern: re.Pattern[bytes], content: bytes, start: int) -> bytes:
    match = pattern.match(content, start)
    return match[0] if match else b""


def _describe_cell_error(cell: str) -> str | None:
    if not cell:
        return None
    if _DECIMAL_COMMA.fullmatch(cell):
        return f"'{cell}' has a decimal comma; write decimal points"
    if not _NUMBER.fullmatch(cell):
        return f"'{cell[:40]}' is not a number; leave the cell of a missing sample empty"
    if math.isinf(float(cell)):
        return f"'{cell[:40]}' is too large"
    return None


def _format_cell_count(n_cells: int) -> str:
    return f"{n_cells} cell" if n_cells == 1 else f"{n_cells} cells"
