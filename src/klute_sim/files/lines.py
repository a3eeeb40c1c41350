"""Checks of text tables before they are parsed: lines, columns and cells; and small CSV tables."""

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from klute_sim.errors import InputError
from klute_sim.files.limits import MAX_COLUMNS, MAX_DURATION, MAX_LINE_BYTES, MAX_LINES, FileKind
from klute_sim.files.reading import read_text
from klute_sim.types import Array

MAX_IRREGULARITY = 30.0
"""Largest ratio of the duration to the number of samples times their median interval (assumed)."""

_LINE = re.compile(rb"([^\r\n]*)(?:\r\n|\r|\n|\Z)")


def check_lines(content: bytes, description: str) -> None:
    """Raise InputError when ``content`` has too many lines, a line that is too long or too many columns."""
    if content.count(b"\n") + content.count(b"\r") > 2 * MAX_LINES:
        raise InputError(f"{description} has more than {MAX_LINES:,} lines; split or decimate it")
    start = 0
    while len(content) - start > MAX_LINE_BYTES:
        end = max(
            content.rfind(b"\n", start, start + MAX_LINE_BYTES), content.rfind(b"\r", start, start + MAX_LINE_BYTES)
        )
        if end < 0:
            raise InputError(
                f"{description} has a line of more than {MAX_LINE_BYTES:,} bytes; write one line for each sample"
            )
        start = end + 1


def check_column_count(n_columns: int, description: str) -> None:
    """Raise InputError when a table has too many columns."""
    if n_columns > MAX_COLUMNS:
        raise InputError(f"{description} has {n_columns} columns; allowed: up to {MAX_COLUMNS}")


def check_duration(time: Array, description: str) -> None:
    """Raise InputError when the finite values of ``time`` [s] span more than :data:`MAX_DURATION`.

    One wrong time stamp would otherwise make a simulation of years.
    """
    finite = time[np.isfinite(time)]
    duration = float(np.ptp(finite)) if len(finite) else 0.0
    if duration > MAX_DURATION:
        raise InputError(
            f"{description}: time spans {duration:.6g} s; allowed: up to {MAX_DURATION:g} s for one recording; are "
            "the times in milliseconds (ms)? Otherwise look for a wrong time stamp"
        )


def check_time_stamps(time: Array, description: str) -> None:
    """Raise InputError when increasing times [s] span too long because of one wrong time stamp.

    Times in other units than seconds also span long, but regularly; the checks of plausibility name their unit.
    """
    if len(time) > 2 and np.ptp(time) > MAX_IRREGULARITY * len(time) * float(np.median(np.diff(time))):
        check_duration(time, description)


def iterate_lines(content: bytes) -> Iterator[bytes]:
    """Yield the lines of ``content`` one by one, without line ends."""
    for match in _LINE.finditer(content):
        if match.end() == match.start():  # the empty match at the end of the content
            return
        yield match[1]


def read_csv_rows(text: str, description: str) -> list[tuple[int, list[str]]]:
    """Return number and cells of the rows of a small CSV table; empty rows are skipped.

    Raises InputError when ``text`` is not CSV.
    """
    check_lines(text.encode("utf-8", "replace"), description)
    try:
        rows = [(number, row) for number, row in enumerate(csv.reader(io.StringIO(text)), start=1) if row]
    except csv.Error as error:
        raise InputError(f"{description} is not a CSV file: {error}") from None
    for _, row in rows[:1]:
        check_column_count(len(row), description)
    return rows


def read_csv_records(path: str | Path, kind: FileKind) -> list[dict[str, str]]:
    """Return the rows of a CSV table with a heading, by the names of the columns.

    Raises InputError when the file cannot be read, is not CSV or has a row that is shorter or longer than the heading.
    """
    description = kind.describe(path)
    rows = read_csv_rows(read_text(path, kind), description)
    heading = rows[0][1] if rows else []
    for number, row in rows:
        if len(row) != len(heading):
            raise InputError(f"{description}: row {number} has {len(row)} cells, the heading {len(heading)}")
    return [dict(zip(heading, row, strict=True)) for _, row in rows[1:]]
