"""Marker trajectories, ``.trc``: five heading lines, then frame, time and three coordinates per marker."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from klute_sim.errors import InputError
from klute_sim.mocap.formats import content
from klute_sim.mocap.formats.content import FileContent
from klute_sim.recording.recording import Array

LENGTH_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
"""Unit in the header -> metres."""
N_HEADER_LINES = 5


@dataclass(frozen=True, eq=False)
class Markers:
    """Positions in the laboratory's frame."""

    time: Array
    """[s], rising strictly."""
    positions: Mapping[str, Array]
    """Name -> (n, 3) [m], NaN where the marker was not seen."""


def read(path: str | Path) -> Markers:
    """The markers in the file at ``path``; raises InputError with what is wrong, and where."""
    return parse(content.read(path))


def parse(file: FileContent) -> Markers:
    """The markers in ``file``; raises InputError with what is wrong, and where."""
    where, lines = file.name, file.decode().splitlines()
    if len(lines) < N_HEADER_LINES + 2 or not lines[0].startswith("PathFileType"):
        raise InputError(f"{where} is no .trc file: it must begin with 'PathFileType', with five heading lines")
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    unit = header.get("Units", "").lower()
    if unit not in LENGTH_UNITS:
        raise InputError(f"{where}: Units is '{unit[:20]}'; allowed: {', '.join(LENGTH_UNITS)}")
    names = [name.strip() for name in lines[3].split("\t") if name.strip()][2:]
    said = header.get("NumMarkers", "")
    if not names or (said.isdecimal() and int(said) != len(names)):
        raise InputError(f"{where}: NumMarkers is {said[:20] or 'missing'}, but {len(names)} markers are named")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"{where}: marker '{twice[:40]}' occurs twice")
    rows = [(number, line) for number, line in enumerate(lines[N_HEADER_LINES:], N_HEADER_LINES + 1) if line.strip()]
    frames = header.get("NumFrames", "")
    if frames.isdecimal() and int(frames) != len(rows):
        raise InputError(f"{where}: NumFrames is {frames}, but there are {len(rows)} rows: the file is cut or patched")
    table = np.array([_parse_row(number, line, 2 + 3 * len(names), where) for number, line in rows])
    time = table[:, 1]
    if len(time) < 2 or not np.all(np.diff(time) > 0.0):
        raise InputError(f"{where}: the column Time must rise strictly over two or more rows")
    places = LENGTH_UNITS[unit] * table[:, 2:].reshape(len(rows), len(names), 3)
    return Markers(time, {name: places[:, k] for k, name in enumerate(names)})


def _parse_row(line_number: int, line: str, n_cells: int, file_name: str) -> list[float]:
    """The numbers of one row; empty cells, at the end left out too, are markers that were not seen."""
    cells = line.rstrip("\r\n").split("\t")
    while len(cells) > n_cells and not cells[-1].strip():
        cells.pop()
    if len(cells) > n_cells:
        raise InputError(f"{file_name}: line {line_number} has {len(cells)} cells; there are markers for {n_cells}")
    found = [np.nan] * n_cells
    for place, cell in enumerate(cells):
        if not cell.strip():
            continue
        try:
            found[place] = float(cell)
        except ValueError:
            found[place] = np.inf
        if np.isinf(found[place]):
            raise InputError(f"{file_name}: line {line_number}: {cell.strip()[:40]!r} is not a finite number")
    return found


def write(markers: Markers, path: str | Path) -> None:
    """Write ``markers`` to ``path`` in metres; numbers read back to the same bits."""
    names, count = list(markers.positions), len(markers.time)
    for name in names:
        if not name or name != name.strip() or not name.isprintable():
            raise InputError(f"marker '{name}' cannot be named so in a .trc file: one line without tabs is allowed")
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
