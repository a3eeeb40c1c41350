"""Delimited text: a heading line, then numbers, separated by comma, semicolon or tab.

Numbers have decimal points, or decimal commas where no comma separates cells.

The fast reader's errors are vague; after one, the text is searched line by line to name the line and the cell.
"""

import csv
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv

from klute_sim.datasets.trial_files.heading import NUMBER, find_heading
from klute_sim.errors import InputError
from klute_sim.files import lines
from klute_sim.files.limits import TRIAL
from klute_sim.types import Array

BOM = b"\xef\xbb\xbf"
"""Byte order mark of UTF-8."""
_ZIP = b"PK\x03\x04"
"""Beginning of a ZIP archive, which .xlsx and .ods files are."""
UTF16_BOMS = (b"\xff\xfe", b"\xfe\xff")
"""Byte order marks of UTF-16, which spreadsheet programs call Unicode text."""

_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(([.,' \u00a0\u202f])\d{3})+([.,]\d*)?")
_CERTAIN_DECIMAL_COMMA = (
    r"^\s*[+-]?((0\d*|\d{4,})?,\d*([eE][+-]?\d+)?|\d*,(\d{0,2}|\d{4,})([eE][+-]?\d+)?|\d*,\d+[eE][+-]?\d+)\s*$"
)
"""A number with a comma that cannot separate thousands, for RE2."""
_CLOCK_TIME = re.compile(
    r"(?=\d)(\d{1,4}([-./])\d{1,2}\2\d{1,4}[T ]*)?(\d{1,2}:\d{2}(:\d{2}([.,]\d*)?)?)?\s*"
    r"(Z|[+-]\d{2}:?\d{2}|[AaPp][Mm])?"
)
"""A time of day, a date or both."""
_TIME_NAME = re.compile(r"time\b", re.IGNORECASE)
_MISSING_VALUES = [" " * width for width in range(33)]
"""Empty cells, with or without padding by blanks."""
_EMPTY_CELLS = b" \t,;"
"""Bytes of a row in which all cells are empty."""
_COMMENT_STARTS = (b"#", b"%", b"//")
"""Beginnings of a comment below the rows."""
_ERRORS = (pa.ArrowException, OSError, ValueError)


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
    heading_line: int
    """Line number of the heading."""
    has_unexpected_preamble: bool = False
    """Whether there is text above the heading although nothing says so."""

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
        try:
            return self._parse_columns(indices, ".")
        except _ERRORS as error:
            reason = str(error).splitlines()[0]
        if self.delimiter != "," and b"," in self.body:
            try:
                columns = self._parse_columns(indices, ",")
            except _ERRORS:
                pass
            else:
                self._check_decimal_commas(indices)
                return columns
        raise InputError(f"trial file {self.source}: {self._find_error(indices) or reason}")

    def _parse_columns(self, indices: Sequence[int], decimal_mark: str) -> list[Array]:
        options = pyarrow.csv.ConvertOptions(
            column_types=dict.fromkeys(map(str, indices), pa.float64()),
            null_values=_MISSING_VALUES,
            decimal_point=decimal_mark,
        )
        return [column.to_numpy() for column in self._parse(indices, options)]

    def _parse(self, indices: Sequence[int], options: pyarrow.csv.ConvertOptions) -> list[Any]:
        names = [str(index) for index in range(len(self.headings))]
        options.include_columns = [names[index] for index in indices]
        options.check_utf8 = False
        table = pyarrow.csv.read_csv(
            pa.py_buffer(self.body),
            # With several threads, pyarrow 26 once failed "for an unknown reason" on a busy machine.
            read_options=pyarrow.csv.ReadOptions(column_names=names, use_threads=False),
            parse_options=pyarrow.csv.ParseOptions(delimiter=self.delimiter),
            convert_options=options,
        )
        return [table.column(name) for name in options.include_columns]

    @cached_property
    def _has_certain_decimal_comma(self) -> bool:
        """Whether a number in any column has a comma that cannot separate thousands, as that of ``1,234`` can."""
        indices = range(len(self.headings))
        options = pyarrow.csv.ConvertOptions(column_types=dict.fromkeys(map(str, indices), pa.binary()))
        return any(
            pyarrow.compute.any(pyarrow.compute.match_substring_regex(column, _CERTAIN_DECIMAL_COMMA)).as_py()
            for column in self._parse(indices, options)
        )

    def _check_decimal_commas(self, indices: Sequence[int]) -> None:
        """Raise InputError for commas in the columns with ``indices`` if all in the file may separate thousands."""
        if self._has_certain_decimal_comma:
            return
        for number, line in self.iterate_lines():
            cells = next(csv.reader([line], delimiter=self.delimiter), [])
            for index in indices:
                if "," in cells[index]:
                    raise InputError(
                        f"trial file {self.source}: column '{self.headings[index]}', line {number}: "
                        f"'{cells[index].strip()}' may have a decimal comma or separate thousands; write decimal points"
                    )

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
        decimal_marks: dict[str, str] = {}
        for number, line in self.iterate_lines():
            try:
                cells = next(csv.reader([line], delimiter=self.delimiter), [])
            except csv.Error as error:
                return f"line {number} cannot be read: {error}"
            if [cell.strip() for cell in cells] == list(self.headings):
                return f"line {number} repeats the heading; delete it, or write each recording into its own file"
            if len(cells) != n_columns:
                fix = ""
                if len(cells) < n_columns:
                    fix = "; complete the row, or delete it if it is no sample"
                elif self.delimiter == ",":
                    fix = "; write decimal points, not commas, or separate cells by semicolons"
                return (
                    f"line {number} has {_format_cell_count(len(cells))}, but the heading (line {self.heading_line}) "
                    f"has {_format_cell_count(n_columns)}{fix}"
                )
            for index in indices:
                cell = cells[index].strip()
                cell_error = _describe_cell_error(cell, self.headings[index], allows_comma=self.delimiter != ",")
                if cell_error:
                    return f"column '{self.headings[index]}', line {number}: {cell_error}"
                mark = "," if "," in cell else "." if "." in cell else ""
                if mark:
                    decimal_marks.setdefault(mark, f"'{cell}' (line {number})")
                if len(decimal_marks) == 2:
                    both = " and ".join(decimal_marks.values())
                    return f"decimal commas and decimal points are mixed: {both}; use one of them in the whole file"
        return None


def parse_delimited_text(
    content: bytes,
    source: str,
    heading_row: int | None = None,
    is_known: Callable[[str], bool] = lambda heading: False,
) -> DelimitedText:
    """Return headings, delimiter and body of ``content``; raises InputError for anything but text with a heading.

    ``heading_row`` is the line of the heading; without it, the line with most headings that satisfy ``is_known``.
    """
    if content.startswith(UTF16_BOMS):
        try:
            content = content.decode("utf-16").encode()
        except UnicodeError:
            raise InputError(f"trial file {source} is damaged UTF-16 text; save it as UTF-8") from None
    if content.startswith(_ZIP):
        raise InputError(f"trial file {source} is a spreadsheet or an archive; save the sheet as CSV")
    if b"\0" in content:
        raise InputError(
            f"trial file {source} is neither text nor Parquet nor a MAT-file; allowed: CSV (UTF-8, or UTF-16 with a "
            "byte order mark), Parquet and .mat"
        )
    lines.check_lines(content, TRIAL.describe(source))
    content = content.removeprefix(BOM)
    if not content.strip():
        raise InputError(f"trial file {source} is empty")
    heading = find_heading(content, source, heading_row, is_known)
    body = _remove_empty_end(content[heading.n_bytes :])
    has_remark = heading.has_preamble and heading_row is None
    headings = _fit_headings(heading.cells, body, heading.delimiter)
    return DelimitedText(source, headings, heading.delimiter, body, heading.first_row_line, heading.line, has_remark)


def _fit_headings(headings: tuple[str, ...], body: bytes, delimiter: str) -> tuple[str, ...]:
    """Return ``headings`` with as many cells as the first row, if one at the end is empty or a comment of LabVIEW."""
    first = next((line for line in lines.iterate_lines(body) if line), b"").decode("utf-8", errors="replace")
    n_delimiters = first.count(delimiter)
    if n_delimiters == len(headings) and first.endswith(delimiter):
        return (*headings, "")
    if len(headings) > 1 and n_delimiters == len(headings) - 2 and headings[-1] in ("", "Comment"):
        return headings[:-1]
    return headings


def _remove_empty_end(body: bytes) -> bytes:
    """Return ``body`` without rows of empty cells, as spreadsheets write them, and comments at its end."""
    end = len(body)
    while end > 0:
        start = max(body.rfind(b"\n", 0, end), body.rfind(b"\r", 0, end)) + 1
        row = body[start:end].strip(_EMPTY_CELLS)
        if row and not row.lstrip(b'"').startswith(_COMMENT_STARTS):
            break
        end = start - 1
    return body[: max(end, 0)]


def _describe_cell_error(cell: str, heading: str, *, allows_comma: bool) -> str | None:
    if not cell:
        return None
    has_decimal_comma = _DECIMAL_COMMA.fullmatch(cell) is not None
    if has_decimal_comma and (allows_comma or re.search(_CERTAIN_DECIMAL_COMMA, cell)):
        if allows_comma:
            return None
        return f"'{cell}' has a decimal comma; write decimal points, or separate the cells by semicolons or tabs"
    if _THOUSANDS.fullmatch(cell) and not NUMBER.fullmatch(cell):
        may_be_decimal = "may have a decimal comma or separate thousands; write decimal points"
        reason = may_be_decimal if has_decimal_comma else "separates thousands; write digits without separators"
        return f"'{cell}' {reason}"
    if not NUMBER.fullmatch(cell):
        if _CLOCK_TIME.fullmatch(cell):
            return (
                f"'{cell[:40]}' is a date or a time of day, which cannot be read; write seconds as a number, or state "
                'the sampling rate under [columns], such as time = "row / 100 [s]" for 100 samples a second'
            )
        if _TIME_NAME.match(heading):
            return (
                f"'{cell[:40]}' is not a number; every row needs a time as a number, such as seconds; delete rows that "
                "are no samples"
            )
        return f"'{cell[:40]}' is not a number; leave the cell of a missing sample empty"
    if math.isinf(float(cell)):
        return f"'{cell[:40]}' is too large"
    return None


def _format_cell_count(n_cells: int) -> str:
    return f"{n_cells} cell" if n_cells == 1 else f"{n_cells} cells"
