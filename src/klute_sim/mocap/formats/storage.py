"""OpenSim storage files, ``.mot`` and ``.sto``: a header that ends with ``endheader``, column names, numbers.

Both suffixes denote the same format. ``inDegrees`` applies to rotational columns only; the file does not state which
columns are rotational.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from klute_sim.errors import InputError
from klute_sim.files.lines import check_column_count
from klute_sim.mocap.formats import content
from klute_sim.mocap.formats.content import FileContent
from klute_sim.types import Array

TIME_COLUMN = "time"
"""Label of the time column."""
HEADER_END = "endheader"
"""Line that ends the header."""
MAX_HEADER_LINES = 1000
"""Number of lines that are searched for the end of the header."""
ROWS_PER_BLOCK = 10_000
"""Number of rows that are parsed at once."""

_HEADER_ENTRY = re.compile(r"\s*(?P<key>\w+)\s*=\s*(?P<value>.*?)\s*")


@dataclass(frozen=True, eq=False)
class Storage:
    """Columns with a common time base."""

    columns: Mapping[str, Array]
    """Label -> samples as written, NaN where missing; the first column is the strictly increasing ``time`` [s]."""
    in_degrees: bool
    """Whether rotations are in degrees; radians otherwise."""
    name: str = ""
    """Title in the first line of the header."""
    header: Mapping[str, str] = field(default_factory=dict)
    """Other header entries, such as ``DataRate``."""

    @property
    def time(self) -> Array:
        """Sample times [s]."""
        return self.columns[TIME_COLUMN]


def read(path: str | Path) -> Storage:
    """Read the storage file at ``path``; raise InputError with the location of the first mistake."""
    return parse(content.read(path))


def parse(file: FileContent) -> Storage:
    """Parse the storage file ``file``; raise InputError with the location of the first mistake."""
    lines = file.read_lines()
    end = next((k for k, line in enumerate(lines[:MAX_HEADER_LINES]) if line.strip().lower() == HEADER_END), None)
    if end is None:
        raise InputError(f"{file.name} is not an OpenSim storage file: the line '{HEADER_END}' is missing")
    header = {m["key"]: m["value"] for m in map(_HEADER_ENTRY.fullmatch, lines[:end]) if m}
    first = next((k for k in range(end + 1, len(lines)) if lines[k].strip()), None)
    if first is None:
        raise InputError(f"{file.name} ends after the header: the line with the column names is missing")
    labels = _parse_labels(lines[first], file.name)
    check_column_count(len(labels), file.name)
    rows = [(number, line) for number, line in enumerate(lines[first + 1 :], first + 2) if line.strip()]
    table = parse_numbers(rows, len(labels), file.name)
    _check_counts(header, len(rows), len(labels), file.name)
    time = table[:, labels.index(TIME_COLUMN)]
    if len(time) < 2 or not np.all(np.diff(time) > 0.0):
        raise InputError(f"{file.name}: column '{TIME_COLUMN}' must increase strictly over two or more rows")
    columns = {TIME_COLUMN: time} | {label: table[:, k] for k, label in enumerate(labels)}
    return Storage(
        columns=columns,
        in_degrees=header.get("inDegrees", "no").lower() == "yes",
        name=lines[0].strip() if end > 0 and "=" not in lines[0] else "",
        header={key: value for key, value in header.items() if key not in ("nRows", "nColumns", "inDegrees")},
    )


def parse_numbers(rows: list[tuple[int, str]], n_columns: int, file_name: str) -> Array:
    """Parse ``rows`` (line number, text) of ``n_columns`` numbers each into a table; NaN marks a missing sample.

    Raises InputError with the line and the cell that is not a number.
    """
    if not rows:
        return np.empty((0, n_columns))
    # A list of cells takes ten times the memory of its numbers.
    blocks = [rows[start : start + ROWS_PER_BLOCK] for start in range(0, len(rows), ROWS_PER_BLOCK)]
    return np.concatenate([_parse_block(block, n_columns, file_name) for block in blocks])


def _parse_block(rows: list[tuple[int, str]], n_columns: int, file_name: str) -> Array:
    cells = [line.split() for _, line in rows]
    try:
        table = np.array(cells, dtype=np.float64)
        if table.shape == (len(rows), n_columns) and not np.isinf(table).any():
            return table
    except ValueError:
        pass
    for (number, _), row in zip(rows, cells, strict=True):
        if len(row) != n_columns:
            raise InputError(f"{file_name}: line {number} has {len(row)} numbers, but there are {n_columns} columns")
        for cell in row:
            try:
                finite = not np.isinf(float(cell))
            except ValueError:
                finite = False
            if not finite:
                raise InputError(f"{file_name}: line {number}: {cell[:40]!r} is not a finite number")
    raise InputError(f"{file_name}: the numbers cannot be read")


def _parse_labels(line: str, file_name: str) -> list[str]:
    labels = [label.strip() for label in line.strip().split("\t")] if "\t" in line else line.split()
    if TIME_COLUMN not in labels:
        raise InputError(f"{file_name}: column '{TIME_COLUMN}' is missing")
    duplicate = next((label for label in labels if labels.count(label) > 1), None)
    if duplicate is not None:
        raise InputError(f"{file_name}: column '{duplicate[:40]}' occurs twice")
    return labels


def _check_counts(header: Mapping[str, str], n_rows: int, n_columns: int, file_name: str) -> None:
    for key, count in (("nRows", n_rows), ("nColumns", n_columns), ("datarows", n_rows), ("datacolumns", n_columns)):
        declared = header.get(key)
        if declared is not None and content.differs_from_count(declared, count):
            raise InputError(
                f"{file_name}: the header states {key}={declared[:20]}, but there are {count}: the file is truncated "
                "or was edited"
            )


def write(storage: Storage, path: str | Path) -> None:
    """Write ``storage`` to ``path`` without loss of precision; raise InputError for invalid columns."""
    columns = {TIME_COLUMN: storage.time} | dict(storage.columns)
    for label, samples in columns.items():
        if not label or re.search(r"\s", label):
            raise InputError(f"column '{label}' cannot be written to a storage file: blanks are not allowed in names")
        if samples.shape != storage.time.shape:
            raise InputError(f"column '{label}' has shape {samples.shape}; 'time' has {storage.time.shape}")
    lines = [
        storage.name.splitlines()[0] if storage.name else Path(path).stem,
        *("version=1", f"nRows={len(storage.time)}", f"nColumns={len(columns)}"),
        f"inDegrees={'yes' if storage.in_degrees else 'no'}",
        *(f"{key}={value}" for key, value in storage.header.items() if key != "version"),
        *(HEADER_END, "\t".join(columns)),
        *("\t".join(repr(float(value)) for value in row) for row in zip(*columns.values(), strict=True)),
    ]
    Path(path).write_text("\n".join(lines) + "\n", "utf-8", newline="\n")
