"""Reading of input files of any supported format, and their grouping into trials."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from klute_sim.datasets.trial_files import text
from klute_sim.errors import InputError
from klute_sim.files.lines import check_time_stamps
from klute_sim.files.parquet import open_parquet
from klute_sim.mocap.formats import c3d, content, storage, trc, visual3d
from klute_sim.mocap.formats.c3d import GaitEvent
from klute_sim.mocap.formats.content import FileContent
from klute_sim.mocap.formats.force_plates import ForcePlate
from klute_sim.mocap.formats.trc import Markers
from klute_sim.mocap.parsing import channel_names
from klute_sim.mocap.parsing.channel_names import split_unit, strip_unit
from klute_sim.mocap.parsing.mapping import ImportMapping
from klute_sim.types import Array

FileRole = Literal["angles", "markers", "loads", "moments", "events", "log"]
MAX_VALUE = 1e9
"""Largest accepted magnitude of a number in a column, whatever its unit."""
MAX_DISTANCE = 1e4
"""Largest accepted distance of a marker from the origin [m]."""
OPENSIM_STORAGE = "OpenSim storage"
"""File type of ``.mot`` and ``.sto``."""
N_CYCLE_ROWS = 101
"""Number of rows of a Visual3D export over the gait cycle, at every per cent; as frames they are no whole stride."""
FILE_SUFFIXES = (".c3d", ".mot", ".sto", ".trc", ".csv", ".tsv", ".txt", ".parquet")
"""Supported file name suffixes."""


@dataclass(frozen=True, eq=False)
class SourceFile:
    """One input file."""

    path: str
    """Path as the user wrote it."""
    file_type: str
    """Description of the format."""
    digest: str
    """SHA-256 of the content."""
    labels: tuple[str, ...] = ()
    """Column labels."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Label -> stated unit."""
    read_column: Callable[[str], Array] | None = None
    """Function from a label to the samples as written."""
    markers: Markers | None = None
    """Marker trajectories."""
    plates: tuple[ForcePlate, ...] = ()
    """Force plates."""
    software: str = ""
    """Name of the program that wrote the file."""
    folder: str = ""
    """Folder that distinguishes files of the same name."""
    time_offset: float = 0.0
    """Offset [s]; already added to the times of markers and plates, to be added to time columns."""
    events: tuple[GaitEvent, ...] = ()
    """Foot strikes and foot offs that the file lists."""
    frame_rate: float | None = None
    """Frame rate [Hz] that the user gave for a file that does not state its times; None for other files."""
    is_single_stride: bool = False
    """Whether the file holds one stride in % of the gait cycle, which is repeated as a recording over time."""

    @property
    def name(self) -> str:
        """File name with question marks for unprintable characters."""
        return "".join(c if c.isprintable() else "?" for c in (Path(self.folder) / Path(self.path).name).as_posix())

    def get_column(self, label: str) -> Array:
        """Return the samples of the column ``label``; raise InputError for implausibly large numbers."""
        assert self.read_column is not None
        samples = self.read_column(label)
        if (np.abs(samples) > MAX_VALUE).any():
            raise InputError(
                f"{self.path}: column '{label}' contains {np.nanmax(np.abs(samples)):.3g}; allowed are magnitudes up "
                f"to {MAX_VALUE:g}; is it a code for missing samples? Leave these cells empty"
            )
        return samples

    @property
    def time_label(self) -> str | None:
        """Label of the time column; None if there is none."""
        return next((label for label in self.labels if strip_unit(label).lower() in ("time", "timestamp")), None)

    def detect_roles(self, mapping: ImportMapping | None = None) -> set[FileRole]:
        """Return the kinds of data in the file; columns of ``mapping`` count as angles or as a prosthesis log."""
        if self.labels and {strip_unit(label).lower() for label in self.labels} <= channel_names.EVENT_LABELS:
            return {"events"}
        mapping = mapping or ImportMapping()
        roles: set[FileRole] = {"angles"} if mapping.get_column_names(prosthesis=False) & {*self.labels} else set()
        roles |= {"log"} if mapping.get_column_names(prosthesis=True) & {*self.labels} else set()
        for label in self.labels:
            parsed = channel_names.parse_channel_label(label)
            if parsed is not None and parsed.channel in channel_names.PROSTHESIS_CHANNELS:
                roles.add("log")
            elif parsed is not None and parsed.channel in channel_names.ANGLE_CHANNELS:
                roles.add("angles")
            elif parsed is not None and parsed.channel == channel_names.ANKLE_MOMENT:
                roles.add("moments")
            elif (parsed is not None and parsed.channel.startswith("grf")) or channel_names.parse_plate_label(label):
                roles.add("loads")
        if self.markers is not None:
            roles.add("markers")
        if self.plates:
            roles.add("loads")
        return roles

    def describe(self) -> dict[str, Any]:
        """Return a description of the file for the import log; JSON types only."""
        time = self.markers.time if self.markers is not None else None
        if time is None and self.time_label is not None:
            time = self.get_column(self.time_label)
        duration = float(time[-1] - time[0]) if time is not None and len(time) > 1 else 0.0
        return {
            "file": self.name,
            "type": self.file_type,
            "sha256": self.digest,
            "columns": len(self.labels),
            "markers": len(self.markers.positions) if self.markers is not None else 0,
            "force_plates": len(self.plates),
            "duration_s": round(duration, 4),
            "rate_hz": round((len(time) - 1) / duration, 3) if time is not None and duration > 0.0 else None,
            "content": sorted(self.detect_roles()),
        }


def read(path: str | Path, time_offset: float = 0.0, frame_rate: float | None = None) -> list[SourceFile]:
    """Read the recordings in the file at ``path`` and add ``time_offset`` [s] to their times.

    There is one, except in exports of Visual3D, whose times follow from ``frame_rate`` [Hz] if they state none. Raises
    InputError for unreadable files and unsupported formats.
    """
    file_sources = [_shift_time(source, time_offset) for source in _read_file(path, frame_rate)]
    for source in file_sources:
        _check_content(source, path)
    return file_sources


def _check_content(source: SourceFile, path: str | Path) -> None:
    positions = source.markers.positions if source.markers else {}
    for name, position in positions.items():
        if (np.abs(position) > MAX_DISTANCE).any():
            raise InputError(
                f"{path}: marker {name[:40]!r} is {np.nanmax(np.abs(position)):.3g} m away from the origin; check the "
                "unit, and leave the cells of hidden markers empty"
            )
    if source.markers is not None:
        check_time_stamps(source.markers.time, str(path))
    for name in (*source.labels, *positions):
        if not name.isprintable():  # terminals interpret control characters
            raise InputError(f"{path}: the name {name[:40]!r} contains unprintable characters")


def _shift_time(source: SourceFile, time_offset: float) -> SourceFile:
    markers = source.markers and replace(source.markers, time=source.markers.time + time_offset)
    plates = tuple(replace(plate, time=plate.time + time_offset) for plate in source.plates)
    events = tuple(replace(event, time=event.time + time_offset) for event in source.events)
    return replace(source, markers=markers, plates=plates, time_offset=time_offset, events=events)


def _read_file(path: str | Path, frame_rate: float | None) -> list[SourceFile]:
    suffix = Path(path).suffix.lower()
    if suffix not in FILE_SUFFIXES:
        raise InputError(f"{path}: the suffix '{suffix}' is not supported; allowed: {', '.join(FILE_SUFFIXES)}")
    file = content.read(path)
    digest = hashlib.sha256(file.data).hexdigest()
    if suffix in (".csv", ".tsv", ".txt") and visual3d.is_export(file.data):
        return _read_visual3d(file, digest, frame_rate)
    return [_read_single_recording(file, suffix, digest, path)]


def _read_single_recording(file: FileContent, suffix: str, digest: str, path: str | Path) -> SourceFile:
    if suffix in (".mot", ".sto"):
        columns = storage.parse(file)
        angle_unit = "deg" if columns.in_degrees else "rad"
        units = {label: _get_opensim_unit(label, angle_unit) for label in columns.columns}
        return SourceFile(
            file.name, OPENSIM_STORAGE, digest, tuple(columns.columns), units, columns.columns.__getitem__
        )
    if suffix == ".trc":
        return SourceFile(file.name, "markers (.trc)", digest, markers=trc.parse(file))
    if suffix == ".c3d":
        capture = c3d.read(path)
        return SourceFile(
            *(file.name, "C3D", digest),
            markers=capture.markers,
            plates=capture.plates,
            software=capture.software,
            events=capture.events,
        )
    if suffix == ".parquet":
        return _read_parquet(file, digest)
    table = text.parse_delimited_text(file.data, file.name)
    return SourceFile(
        *(file.name, "table", digest, table.headings, _parse_units(table.headings)),
        lambda label: table.read_columns([table.headings.index(label)])[0],
    )


def _read_visual3d(file: FileContent, digest: str, frame_rate: float | None) -> list[SourceFile]:
    """Return one source for each recording; its name follows that of the file if there are several."""
    recordings = visual3d.parse(file)
    file_sources = []
    for recording in recordings:
        heading, values, assumed_rate = "time [s]", recording.time, None
        if values is None and frame_rate is not None:
            values, assumed_rate = (recording.frames - 1.0) / frame_rate, frame_rate
        elif values is None and len(recording.frames) == N_CYCLE_ROWS:
            heading, values = "gait cycle [%]", np.linspace(0.0, 100.0, N_CYCLE_ROWS)
        if values is None:
            raise InputError(
                f"{file.name}: this Visual3D export states no times: pass its frame rate (--frame-rate HZ), or export "
                "the signal TIME with it"
            )
        columns = {heading: values, **recording.columns}
        name = file.name if len(recordings) == 1 else f"{file.name} ({recording.name})"
        units = _parse_units([heading])
        source = SourceFile(name, "Visual3D export", digest, tuple(columns), units, columns.__getitem__)
        file_sources.append(replace(source, frame_rate=assumed_rate))
    return file_sources


def _get_opensim_unit(label: str, angle_unit: str) -> str:
    """Return the unit of an OpenSim column: SI, with angles in ``angle_unit``; '' if the quantity is unknown."""
    parsed = channel_names.parse_channel_label(label)
    if parsed is None:
        return "s" if label == storage.TIME_COLUMN else ""
    if parsed.channel in channel_names.ANGLE_CHANNELS:
        return angle_unit
    return {channel_names.ANKLE_MOMENT: "N*m", channel_names.ANKLE_POWER: "W"}.get(parsed.channel, "")


def _read_parquet(file: FileContent, digest: str) -> SourceFile:
    table = open_parquet(file.data, file.name)
    labels = table.headings
    return SourceFile(
        *(file.name, "table (Parquet)", digest, labels, _parse_units(labels)),
        lambda label: table.read_column(labels.index(label)),
    )


def _parse_units(labels: Sequence[str]) -> dict[str, str]:
    return {label: unit for label in labels if (unit := split_unit(label)[1])}


def group_into_trials(
    sources: Sequence[SourceFile], mapping: ImportMapping | None = None, *, prosthesis: bool = False
) -> list[list[SourceFile]]:
    """Group files into trials in the given order; a file with data that the current trial has begins a new trial.

    With ``prosthesis``, a file with a prosthesis log counts as a log only; without, logs are ignored. Raises InputError
    for a file without usable data.
    """
    usable = "joint angle, ankle moment, ground reaction or marker"
    if prosthesis:
        usable = "marker, joint angle, ankle moment, ground reaction, pressure, force or muscle length"
    trials: list[list[SourceFile]] = []
    trial_roles: set[FileRole] = set()
    for source in sources:
        roles = source.detect_roles(mapping)
        if not prosthesis:
            roles -= {"log"}
        elif "log" in roles:
            roles = {"log"}
        if not roles:
            raise InputError(f"{source.path}: no {usable} was recognised; name its columns in a file for --map")
        if not trials or roles & trial_roles:
            trials.append([])
            trial_roles = set()
        trials[-1].append(source)
        trial_roles |= roles
    return trials
