"""Files as they lie there: what kind each is, what it holds, and which of them belong to one trial."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.datasets import text
from klute_sim.errors import InputError
from klute_sim.mocap.formats import c3d, content, storage, trc
from klute_sim.mocap.formats.c3d import ForcePlate
from klute_sim.mocap.formats.content import FileContent
from klute_sim.mocap.formats.trc import Markers
from klute_sim.mocap.parsing import channel_names
from klute_sim.mocap.parsing.mapping import ImportMapping
from klute_sim.recording.recording import Array, split_heading

FileRole = Literal["angles", "markers", "loads", "moments", "events", "log"]
MAX_VALUE = 1e9
"""Of any number in a column, whatever its unit."""
MAX_DISTANCE = 1e4
"""Of any marker or centre of pressure from the origin [m]."""
OPENSIM_STORAGE = "OpenSim storage"
FILE_SUFFIXES = (".c3d", ".mot", ".sto", ".trc", ".csv", ".tsv", ".txt", ".parquet")


@dataclass(frozen=True, eq=False)
class SourceFile:
    """One file."""

    path: str
    file_type: str
    digest: str
    """SHA-256."""
    labels: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    """Label -> unit, of the columns that have one."""
    read_column: Callable[[str], Array] | None = None
    """The samples of a label's column, as written."""
    markers: Markers | None = None
    plates: tuple[ForcePlate, ...] = ()
    software: str = ""
    folder: str = ""
    """Where several files are called the same, the folder that tells them apart."""
    time_offset: float = 0.0
    """What was added to the times of markers and plates [s], and is to be added to those in columns."""

    @property
    def name(self) -> str:
        """The file's name, with a question mark for what cannot be shown."""
        return "".join(c if c.isprintable() else "?" for c in (Path(self.folder) / Path(self.path).name).as_posix())

    def get_column(self, label: str) -> Array:
        """The samples in the column ``label``; raises InputError for numbers that nothing in a laboratory has."""
        assert self.read_column is not None
        samples = self.read_column(label)
        if (np.abs(samples) > MAX_VALUE).any():
            raise InputError(
                f"{self.path}: column '{label}' holds {np.nanmax(np.abs(samples)):.3g}, which is no measurement"
            )
        return samples

    @property
    def time_label(self) -> str | None:
        """The label of the column that holds time."""
        return next((label for label in self.labels if _strip_unit(label).lower() in ("time", "timestamp")), None)

    def roles(self, mapping: ImportMapping | None = None) -> set[FileRole]:
        """What the file brings to a trial; labels ``chosen`` by the user count as angles, or as a prosthesis' log."""
        if self.labels and {_strip_unit(label).lower() for label in self.labels} <= channel_names.EVENT_LABELS:
            return {"events"}
        mapping = mapping or ImportMapping()
        found: set[FileRole] = {"angles"} if mapping.column_names(prosthesis=False) & {*self.labels} else set()
        found |= {"log"} if mapping.column_names(prosthesis=True) & {*self.labels} else set()
        for label in self.labels:
            meant = channel_names.parse_channel_label(_strip_unit(label))
            if meant is not None and meant.channel in channel_names.PROSTHESIS_CHANNELS:
                found.add("log")
            elif meant is not None and meant.channel in channel_names.ANGLE_CHANNELS:
                found.add("angles")
            elif meant is not None and meant.channel == channel_names.ANKLE_MOMENT:
                found.add("moments")
            elif (meant is not None and meant.channel.startswith("grf")) or channel_names.parse_plate_label(label):
                found.add("loads")
        if self.markers is not None:
            found.add("markers")
        if self.plates:
            found.add("loads")
        return found

    def describe(self) -> dict[str, Any]:
        """What the file is, for the report."""
        time = self.markers.time if self.markers is not None else None
        if time is None and self.time_label is not None:
            time = self.get_column(self.time_label)
        seconds = float(time[-1] - time[0]) if time is not None and len(time) > 1 else 0.0
        return {
            "file": self.name,
            "kind": self.file_type,
            "sha256": self.digest,
            "columns": len(self.labels),
            "markers": len(self.markers.positions) if self.markers is not None else 0,
            "force_plates": len(self.plates),
            "seconds": round(seconds, 4),
            "rate_hz": round((len(time) - 1) / seconds, 3) if time is not None and seconds > 0.0 else None,
            "holds": sorted(self.roles()),
        }


def _strip_unit(label: str) -> str:
    """The label without a unit in brackets."""
    return label.split("[")[0].strip()


def read(path: str | Path, time_offset: float = 0.0) -> SourceFile:
    """The file at ``path`` with ``shift`` [s] added to its times.

    Raises InputError for what cannot be read, and for a kind that is not known.
    """
    found = _shift_time(_read_file(path), time_offset)
    for name, place in (found.markers.positions if found.markers else {}).items():
        if (np.abs(place) > MAX_DISTANCE).any():
            raise InputError(f"{path}: marker {name[:40]!r} is {np.nanmax(np.abs(place)):.3g} m away: a wrong unit?")
    for name in (*found.labels, *(found.markers.positions if found.markers else ())):
        if not name.isprintable():  # names are shown in terminals, which obey some characters
            raise InputError(f"{path}: the name {name[:40]!r} has characters that cannot be shown")
    return found


def _shift_time(source: SourceFile, time_offset: float) -> SourceFile:
    markers = source.markers and replace(source.markers, time=source.markers.time + time_offset)
    plates = tuple(replace(plate, time=plate.time + time_offset) for plate in source.plates)
    return replace(source, markers=markers, plates=plates, time_offset=time_offset)


def _read_file(path: str | Path) -> SourceFile:
    suffix = Path(path).suffix.lower()
    if suffix not in FILE_SUFFIXES:
        raise InputError(f"{path}: a file that ends with '{suffix}' is not known; allowed: {', '.join(FILE_SUFFIXES)}")
    file = content.read(path)
    digest = hashlib.sha256(file.data).hexdigest()
    if suffix in (".mot", ".sto"):
        found = storage.parse(file)
        rotation = "deg" if found.in_degrees else "rad"
        units = {label: _get_opensim_unit(label, rotation) for label in found.columns}
        return SourceFile(file.name, OPENSIM_STORAGE, digest, tuple(found.columns), units, found.columns.__getitem__)
    if suffix == ".trc":
        return SourceFile(file.name, "markers (.trc)", digest, markers=trc.parse(file))
    if suffix == ".c3d":
        capture = c3d.read(path)
        return SourceFile(
            *(file.name, "C3D", digest), markers=capture.markers, plates=capture.plates, software=capture.software
        )
    if suffix == ".parquet":
        return _read_parquet(file, digest)
    table = text.parse_delimited_text(file.data, file.name)
    return SourceFile(
        *(file.name, "table", digest, table.headings, _parse_units(table.headings)),
        lambda label: table.read_columns([table.headings.index(label)])[0],
    )


def _get_opensim_unit(label: str, angle_unit: str) -> str:
    """The format has no units; OpenSim's are SI, and degrees where the header says so."""
    meant = channel_names.parse_channel_label(label)
    if meant is None:
        return "s" if label == storage.TIME_COLUMN else ""
    return (
        angle_unit
        if meant.channel in channel_names.ANGLE_CHANNELS
        else {channel_names.ANKLE_MOMENT: "N*m", channel_names.ANKLE_POWER: "W"}.get(meant.channel, "")
    )


def _read_parquet(file: FileContent, digest: str) -> SourceFile:
    try:
        table = pq.read_table(pa.BufferReader(file.data))
    except (pa.ArrowException, OSError, ValueError) as error:
        raise InputError(f"{file.name} is no Parquet file: {str(error).splitlines()[0]}") from None

    def fetch(label: str) -> Array:
        try:
            return np.asarray(table.column(label).cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)
        except (pa.ArrowException, ValueError) as error:
            reason = str(error).splitlines()[0]
            raise InputError(f"{file.name}: column '{label}' holds no numbers: {reason}") from None

    labels = tuple(table.column_names)
    return SourceFile(file.name, "table (Parquet)", digest, labels, _parse_units(labels), fetch)


def _parse_units(labels: Sequence[str]) -> dict[str, str]:
    found = {}
    for label in labels:
        if "[" in label:
            try:
                found[label] = split_heading(label)[1]
            except InputError:
                found[label] = label[label.index("[") + 1 :].rstrip("] ")
    return found


def group_into_trials(
    sources: Sequence[SourceFile], mapping: ImportMapping | None = None, *, prosthesis: bool = False
) -> list[list[SourceFile]]:
    """The files of each trial, in the order given: a new one begins where a file brings what the last already has.

    With a ``prosthesis``, a file with its own log is that, whatever else is in it; without one, a log is of no use.
    Raises InputError for a file that brings nothing.
    """
    lacking = "joint angle, ankle moment, ground reaction or marker"
    if prosthesis:
        lacking = "marker, joint angle, ankle moment, ground reaction, pressure, force or muscle length"
    found: list[list[SourceFile]] = []
    have: set[FileRole] = set()
    for source in sources:
        roles = source.roles(mapping)
        if not prosthesis:
            roles -= {"log"}
        elif "log" in roles:
            roles = {"log"}
        if not roles:
            raise InputError(
                f"{source.path} holds nothing of use: no {lacking} was recognised; name its columns in a file for --map"
            )
        if not found or roles & have:
            found.append([])
            have = set()
        found[-1].append(source)
        have |= roles
    return found
