"""Marker trajectory files, ``.trc``: five header lines, then frame, time and three coordinates per marker."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from klute_sim.errors import InputError
from klute_sim.files.lines import check_column_count
from klute_sim.mocap.formats import content
from klute_sim.mocap.formats.content import FileContent
from klute_sim.types import Array

LENGTH_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
"""Length unit in the file -> metres."""
N_HEADER_LINES = 5
"""Number of header lines."""


@dataclass(frozen=True, eq=False)
class Markers:
    """Marker trajectories in the laboratory frame."""

    time: Array
    """Strictly increasing sample times (n,) [s]."""
    positions: Mapping[str, Array]
    """Marker name -> positions (n, 3) [m]; NaN where the marker was hidden."""


def read(path: str | Path) -> Markers:
    """Read the markers of the file at ``path``; raise InputError with the location of the first mistake."""
    return parse(content.read(path))


def parse(file: FileContent) -> Markers:
    """Parse the markers of ``file``; raise InputError with the location of the first mistake."""
    file_name, lines = file.name, file.read_lines()
    if len(lines) < N_HEADER_LINES + 2 or not lines[0].startswith("PathFileType"):
        raise InputError(f"{file_name} is not a .trc file: it must start with 'PathFileType' and five header lines")
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    unit = header.get("Units", "").lower()
    if unit not in LENGTH_UNITS:
        raise InputError(f"{file_name}: Units is '{unit[:20]}'; allowed: {', '.join(LENGTH_UNITS)}")
    names = [name.strip() for name in lines[3].split("\t") if name.strip()][2:]
    declared = header.get("NumMarkers", "")
    if not names or content.differs_from_count(declared, len(names)):
        raise InputError(f"{file_name}: NumMarkers is {declared[:20] or 'missing'}, but {len(names)} markers are named")
    duplicate = next((name for name in names if names.count(name) > 1), None)
    if duplicate is not None:
        raise InputError(f"{file_name}: marker '{duplicate[:40]}' occurs twice")
    check_column_count(2 + 3 * len(names), file_name)
    rows = [(number, line) for number, line in enumerate(lines[N_HEADER_LINES:], N_HEADER_LINES + 1) if line.strip()]
    frames = header.get("NumFrames", "")
    if content.differs_from_count(frames, len(rows)):
        raise InputError(
            f"{file_name}: NumFrames is {frames[:20]}, but there are {len(rows)} rows: the file is truncated or was "
            "edited"
        )
    table = np.array([_parse_row(number, line, 2 + 3 * len(names), file_name) for number, line in rows])
    time = table[:, 1]
    if len(time) < 2 or not np.all(np.diff(time) > 0.0):
        raise InputError(f"{file_name}: column Time must increase strictly over two or more rows")
    positions = LENGTH_UNITS[unit] * table[:, 2:].reshape(len(rows), len(names), 3)
    return Markers(time, {name: positions[:, k] for k, name in enumerate(names)})


def _parse_row(line_number: int, line: str, n_cells: int, file_name: str) -> list[float]:
    """Parse one row; empty and missing trailing cells are NaN (hidden markers)."""
    cells = line.rstrip("\r\n").split("\t")
    while len(cells) > n_cells and not cells[-1].strip():
        cells.pop()
    if len(cells) > n_cells:
        raise InputError(
            f"{file_name}: line {line_number} has {len(cells)} cells; the header names markers for {n_cells}"
        )
    values = [np.nan] * n_cells
    for index, cell in enumerate(cells):
        if not cell.strip():
            continue
        try:
            values[index] = float(cell)
        except ValueError:
            values[index] = np.inf
        if np.isinf(values[index]):
            raise InputError(f"{file_name}: line {line_number}: {cell.strip()[:40]!r} is not a finite number")
    return values


def write(markers: Markers, path: str | Path) -> None:
    """Write ``markers`` to ``path`` in metres without loss of precision; raise InputError for invalid names."""
    names, count = list(markers.positions), len(markers.time)
    for name in names:
        if not name or name != name.strip() or not name.isprintable():
            raise InputError(f"marker '{name}' cannot be written to a .trc file: names must be one line without tabs")
    rate = f"{(count - 1) / (markers.time[-1] - markers.time[0]):.6g}" if count > 1 else "1"
    keys = ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"]
    keys += ["OrigDataRate", "OrigDataStartFrame", "OrigNumFrames"]
    values = (rate, rate, str(count), str(len(names)), "m", rate, "1", str(count))
    axes = [f"{axis}{k}" for k in range(1, len(names) + 1) for axis in "XYZ"]
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{Path(path).name}",
        "\t".join(keys),
        "\t".join(values),
        "Frame#\tTime\t" + "\t\t\t".join(names),
        "\t\t" + "\t".join(axes),
    ]
    for frame, time in enumerate(markers.time):
        cells = [repr(float(v)) if np.isfinite(v) else "" for name in names for v in markers.positions[name][frame]]
        lines.append("\t".join([str(frame + 1), repr(float(time)), *cells]))
    Path(path).write_text("\n".join(lines) + "\n", "utf-8", newline="\n")
