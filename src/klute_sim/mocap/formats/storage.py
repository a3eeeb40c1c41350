"""OpenSim's storage files, ``.mot`` and ``.sto``: a header that ends with ``endheader``, names, numbers.

Both endings are the same format. ``inDegrees`` speaks of the rotational columns only; nothing in the file says which
those are.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from klute_sim.errors import InputError
from klute_sim.mocap.formats import content
from klute_sim.mocap.formats.content import FileContent
from klute_sim.recording.recording import Array

TIME_COLUMN = "time"
HEADER_END = "endheader"
MAX_HEADER_LINES = 1000

_HEADER_ENTRY = re.compile(r"\s*(?P<key>\w+)\s*=\s*(?P<value>.*?)\s*")


@dataclass(frozen=True, eq=False)
class Storage:
    """Columns on one time base."""

    columns: Mapping[str, Array]
    """Label -> samples as written, NaN where missing; the first is ``time`` [s], rising strictly."""
    in_degrees: bool
    """Whether rotations are in degrees, otherwise in radians."""
    name: str = ""
    """First line of the header."""
    header: Mapping[str, str] = field(default_factory=dict)
    """Other entries of the header, such as ``DataRate``."""

    @property
    def time(self) -> Array:
        """[s]"""
        return self.columns[TIME_COLUMN]


def read(path: str | Path) -> Storage:
    """The storage file at ``path``; raises InputError with what is wrong, and where."""
    return parse(content.read(path))


def parse(file: FileContent) -> Storage:
    """The storage file in ``file``; raises InputError with what is wrong, and where."""
    lines = file.decode().splitlines()
    end = next((k for k, line in enumerate(lines[:MAX_HEADER_LINES]) if line.strip().lower() == HEADER_END), None)
    if end is None:
        raise InputError(f"{file.name} is no OpenSim storage file: there is no line '{HEADER_END}'")
    header = {m["key"]: m["value"] for m in map(_HEADER_ENTRY.fullmatch, lines[:end]) if m}
    first = next((k for k in range(end + 1, len(lines)) if lines[k].strip()), None)
    if first is None:
        raise InputError(f"{file.name} ends after the header: the line with the column names is missing")
    labels = _parse_labels(lines[first], file.name)
    rows = [(number, line) for number, line in enumerate(lines[first + 1 :], first + 2) if line.strip()]
    table = parse_numbers(rows, len(labels), file.name)
    _check_counts(header, len(rows), len(labels), file.name)
    time = table[:, labels.index(TIME_COLUMN)]
    if len(time) < 2 or not np.all(np.diff(time) > 0.0):
        raise InputError(f"{file.name}: column '{TIME_COLUMN}' must rise strictly over two or more rows")
    columns = {TIME_COLUMN: time} | {label: table[:, k] for k, label in enumerate(labels)}
    return Storage(
        columns=columns,
        in_degrees=header.get("inDegrees", "no").lower() == "yes",
        name=lines[0].strip() if end > 0 and "=" not in lines[0] else "",
        header={key: value for key, value in header.items() if key not in ("nRows", "nColumns", "inDegrees")},
    )


def parse_numbers(rows: list[tuple[int, str]], n_columns: int, file_name: str) -> Array:
    """``rows`` (line number, text) of ``width`` numbers each, as a table; NaN is a missing sample.

    Raises InputError with the line and the cell that is no number.
    """
    cells = [line.split() for _, line in rows]
    try:
        table = np.array(cells, dtype=np.float64)
        if table.shape == (len(rows), n_columns) and not np.isinf(table).any():
            return table
    except ValueError:
        pass
    if not rows:
        return np.empty((0, n_columns))
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
        raise InputError(f"{file_name}: there is no column '{TIME_COLUMN}'")
    twice = next((label for label in labels if labels.count(label) > 1), None)
    if twice is not None:
        raise InputError(f"{file_name}: column '{twice[:40]}' occurs twice")
    return labels


def _check_counts(header: Mapping[str, str], n_rows: int, n_columns: int, file_name: str) -> None:
    for key, count in (("nRows", n_rows), ("nColumns", n_columns), ("datarows", n_rows), ("datacolumns", n_columns)):
        said = header.get(key)
        if said is not None and said.isdecimal() and int(said) != count:
            raise InputError(
                f"{file_name}: the header says {key}={said}, but there are {count}: the file is cut or patched"
            )


def write(storage: Storage, path: str | Path) -> None:
    """Write ``storage`` to ``path``; numbers read back to the same bits. Raises InputError for unusable columns."""
    columns = {TIME_COLUMN: storage.time} | dict(storage.columns)
    for label, samples in columns.items():
        if not label or re.search(r"\s", label):
            raise InputError(f"column '{label}' cannot be named so in a storage file: no blanks are allowed")
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
