"""Visual3D's ASCII exports: five heading rows, then one row per frame with its number first, separated by tabs.

The heading rows hold, for each column, the recording (a C3D file), the signal, its type, its folder and, after
``ITEM``, its component. An export may hold several recordings side by side. It states times only if a signal of them
was exported, and no rate.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.errors import InputError
from klute_sim.files.lines import check_column_count
from klute_sim.mocap.formats.content import FileContent
from klute_sim.types import Array

N_HEADING_ROWS = 5
"""Number of heading rows."""
ITEM = "ITEM"
"""First cell of the last heading row."""
TIME_SIGNALS = ("TIME", "ANALOGTIME", "DERIVEDTIME")
"""Signals with times [s], one for each rate."""
ROWS_PER_BLOCK = 10_000
"""Number of rows that are parsed at once."""


@dataclass(frozen=True, eq=False)
class ExportedRecording:
    """Signals of one recording in an export."""

    name: str
    """Name of the file that Visual3D had read."""
    frames: Array
    """Frame numbers (n,), from 1 at the start of the recording."""
    time: Array | None
    """Times (n,) [s]; None if no signal of times was exported."""
    columns: Mapping[str, Array]
    """``SIGNAL.X`` and so on -> samples (n,), NaN where missing."""


def is_export(data: bytes) -> bool:
    """Return whether ``data`` begins with the heading rows of an export."""
    lines = re.split(rb"\r\n|\r|\n", data, maxsplit=N_HEADING_ROWS)
    return len(lines) >= N_HEADING_ROWS and lines[N_HEADING_ROWS - 1].split(b"\t")[0].strip() == ITEM.encode()


def parse(file: FileContent) -> list[ExportedRecording]:
    """Parse the recordings of ``file``; raise InputError with the location of the first mistake."""
    lines = file.read_lines()
    headings = [[cell.strip() for cell in line.split("\t")] for line in lines[:N_HEADING_ROWS]]
    n_columns = max((k for row in headings for k, cell in enumerate(row) if cell), default=0)
    check_column_count(1 + n_columns, file.name)
    for number, row in enumerate(headings, 1):
        row += [""] * (1 + n_columns - len(row))
        if number in (1, 2, N_HEADING_ROWS) and not all(row[1 : 1 + n_columns]):
            empty = row.index("", 1)
            raise InputError(
                f"{file.name}: heading row {number} of the Visual3D export is empty in column {1 + empty}; file, "
                "signal and component of every column are needed"
            )
    rows = [(number, line) for number, line in enumerate(lines[N_HEADING_ROWS:], N_HEADING_ROWS + 1) if line.strip()]
    if n_columns == 0 or not rows:
        raise InputError(f"{file.name}: the Visual3D export contains no samples")
    blocks = [rows[start : start + ROWS_PER_BLOCK] for start in range(0, len(rows), ROWS_PER_BLOCK)]
    table = np.concatenate([_parse_block(block, 1 + n_columns, file.name) for block in blocks])
    if not np.all(np.diff(table[:, 0]) == 1.0) or not table[0, 0] >= 1.0:
        raise InputError(f"{file.name}: the first column of the Visual3D export must count the frames: 1, 2, 3 ...")
    paths = headings[0][1 : 1 + n_columns]
    return [_select_recording(path, headings, table, file.name) for path in dict.fromkeys(paths)]


def _parse_block(rows: Sequence[tuple[int, str]], n_cells: int, file_name: str) -> Array:
    cells = []
    for number, line in rows:
        row = [cell.strip() or "nan" for cell in line.split("\t")]
        while len(row) > n_cells and row[-1] == "nan":
            row.pop()
        if len(row) > n_cells:
            raise InputError(f"{file_name}: line {number} has {len(row)} cells; the heading rows have {n_cells}")
        cells.append(row + ["nan"] * (n_cells - len(row)))
    try:
        table = np.array(cells, dtype=np.float64)
        if not np.isinf(table).any():
            return table
    except ValueError:
        pass
    for (number, _), row in zip(rows, cells, strict=True):
        for cell in row:
            if not _is_number(cell):
                raise InputError(
                    f"{file_name}: line {number}: {cell[:40]!r} is not a finite number; leave the cell of a missing "
                    "sample empty"
                )
    raise InputError(f"{file_name}: the numbers cannot be read")


def _is_number(cell: str) -> bool:
    try:
        return not np.isinf(float(cell))
    except ValueError:
        return False


def _select_recording(path: str, headings: Sequence[Sequence[str]], table: Array, file_name: str) -> ExportedRecording:
    """Return the recording with ``path`` in the first heading row, without the rows after its end."""
    name = re.split(r"[/\\]", path)[-1]
    indices = [k for k, other in enumerate(headings[0]) if k > 0 and other == path]
    ends = {k: int(np.flatnonzero(np.isfinite(table[:, k]))[-1]) + 1 for k in indices if np.isfinite(table[:, k]).any()}
    n_rows = max(ends.values(), default=0)
    if n_rows == 0:
        raise InputError(f"{file_name}: the signals of '{name}' contain no numbers")
    columns: dict[str, Array] = {}
    times: dict[str, Array] = {}
    for k in indices:
        signal, component = headings[1][k], headings[N_HEADING_ROWS - 1][k]
        target, label = (times, signal) if signal in TIME_SIGNALS else (columns, f"{signal}.{component}")
        if label in target:
            raise InputError(
                f"{file_name}: '{label}' of '{name}' occurs twice (folders and types differ); export one of them"
            )
        target[label] = table[:n_rows, k]
    # Signals of a lower rate end in earlier rows, after a whole fraction of them.
    short = next((k for k, end in ends.items() if end < n_rows and n_rows % end == 0), None)
    if len(times) > 1 or short is not None:
        example = "" if short is None else f" ('{headings[1][short]}' has {ends[short]} samples, others have {n_rows})"
        raise InputError(
            f"{file_name}: the signals of '{name}' have different rates{example}; export those of each rate into a "
            "file of its own, with its signal of times"
        )
    return ExportedRecording(name, table[:n_rows, 0], next(iter(times.values()), None), columns)
