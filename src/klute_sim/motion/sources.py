"""Files as they lie there: what kind each is, what it holds, and which of them belong to one trial."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from klute_sim.dataset import text
from klute_sim.errors import InputError
from klute_sim.formats import c3d, content, storage, trc
from klute_sim.formats.c3d import Plate
from klute_sim.formats.content import Content
from klute_sim.formats.trc import Markers
from klute_sim.motion import names
from klute_sim.motion.mapping import Chosen
from klute_sim.recording.recording import Samples, split_heading

Role = Literal["angles", "markers", "loads", "moments", "events", "log"]
LARGEST = 1e9
"""Of any number in a column, whatever its unit."""
FARTHEST = 1e4
"""Of any marker or centre of pressure from the origin [m]."""
STORAGE = "OpenSim storage"
KINDS = (".c3d", ".mot", ".sto", ".trc", ".csv", ".tsv", ".txt", ".parquet")


@dataclass(frozen=True, eq=False)
class Source:
    """One file."""

    where: str
    kind: str
    digest: str
    """SHA-256."""
    labels: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    """Label -> unit, of the columns that have one."""
    fetch: Callable[[str], Samples] | None = None
    """The samples of a label's column, as written."""
    markers: Markers | None = None
    plates: tuple[Plate, ...] = ()
    software: str = ""
    folder: str = ""
    """Where several files are called the same, the folder that tells them apart."""
    shift: float = 0.0
    """What was added to the times of markers and plates [s], and is to be added to those in columns."""

    @property
    def name(self) -> str:
        """The file's name, with a question mark for what cannot be shown."""
        return "".join(c if c.isprintable() else "?" for c in (Path(self.folder) / Path(self.where).name).as_posix())

    def column(self, label: str) -> Samples:
        """The samples in the column ``label``; raises InputError for numbers that nothing in a laboratory has."""
        assert self.fetch is not None
        samples = self.fetch(label)
        if (np.abs(samples) > LARGEST).any():
            raise InputError(
                f"{self.where}: column '{label}' holds {np.nanmax(np.abs(samples)):.3g}, which is no measurement"
            )
        return samples

    @property
    def time_label(self) -> str | None:
        """The label of the column that holds time."""
        return next((label for label in self.labels if _bare(label).lower() in ("time", "timestamp")), None)

    def roles(self, chosen: Chosen | None = None) -> set[Role]:
        """What the file brings to a trial; labels ``chosen`` by the user count as angles, or as a prosthesis' log."""
        if self.labels and {_bare(label).lower() for label in self.labels} <= names.EVENTS:
            return {"events"}
        chosen = chosen or Chosen()
        found: set[Role] = {"angles"} if chosen.columns(prosthesis=False) & {*self.labels} else set()
        found |= {"log"} if chosen.columns(prosthesis=True) & {*self.labels} else set()
        for label in self.labels:
            meant = names.named(_bare(label))
            if meant is not None and meant.channel in names.PROSTHESIS:
                found.add("log")
            elif meant is not None and meant.channel in names.ANGLES:
                found.add("angles")
            elif meant is not None and meant.channel == names.MOMENT:
                found.add("moments")
            elif (meant is not None and meant.channel.startswith("grf")) or names.plate_column(label):
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
            time = self.column(self.time_label)
        seconds = float(time[-1] - time[0]) if time is not None and len(time) > 1 else 0.0
        return {
            "file": self.name,
            "kind": self.kind,
            "sha256": self.digest,
            "columns": len(self.labels),
            "markers": len(self.markers.positions) if self.markers is not None else 0,
            "force_plates": len(self.plates),
            "seconds": round(seconds, 4),
            "rate_hz": round((len(time) - 1) / seconds, 3) if time is not None and seconds > 0.0 else None,
            "holds": sorted(self.roles()),
        }


def _bare(label: str) -> str:
    """The label without a unit in brackets."""
    return label.split("[")[0].strip()


def read(path: str | Path, shift: float = 0.0) -> Source:
    """The file at ``path`` with ``shift`` [s] added to its times.

    Raises InputError for what cannot be read, and for a kind that is not known.
    """
    found = _shifted(_read(path), shift)
    for name, place in (found.markers.positions if found.markers else {}).items():
        if (np.abs(place) > FARTHEST).any():
            raise InputError(f"{path}: marker {name[:40]!r} is {np.nanmax(np.abs(place)):.3g} m away: a wrong unit?")
    for name in (*found.labels, *(found.markers.positions if found.markers else ())):
        if not name.isprintable():  # names are shown in terminals, which obey some characters
            raise InputError(f"{path}: the name {name[:40]!r} has characters that cannot be shown")
    return found


def _shifted(source: Source, by: float) -> Source:
    markers = source.markers and replace(source.markers, time=source.markers.time + by)
    plates = tuple(replace(plate, time=plate.time + by) for plate in source.plates)
    return replace(source, markers=markers, plates=plates, shift=by)


def _read(path: str | Path) -> Source:
    suffix = Path(path).suffix.lower()
    if suffix not in KINDS:
        raise InputError(f"{path}: a file that ends with '{suffix}' is not known; allowed: {', '.join(KINDS)}")
    file = content.read(path)
    digest = hashlib.sha256(file.data).hexdigest()
    if suffix in (".mot", ".sto"):
        found = storage.parse(file)
        rotation = "deg" if found.in_degrees else "rad"
        units = {label: _storage_unit(label, rotation) for label in found.columns}
        return Source(file.where, STORAGE, digest, tuple(found.columns), units, found.columns.__getitem__)
    if suffix == ".trc":
        return Source(file.where, "markers (.trc)", digest, markers=trc.parse(file))
    if suffix == ".c3d":
        capture = c3d.read(path)
        return Source(
            *(file.where, "C3D", digest), markers=capture.markers, plates=capture.plates, software=capture.software
        )
    if suffix == ".parquet":
        return _parquet(file, digest)
    table = text.parse(file.data, file.where)
    return Source(
        *(file.where, "table", digest, table.headings, _units(table.headings)),
        lambda label: table.columns([table.headings.index(label)])[0],
    )


def _storage_unit(label: str, rotation: str) -> str:
    """The format has no units; OpenSim's are SI, and degrees where the header says so."""
    meant = names.named(label)
    if meant is None:
        return "s" if label == storage.TIME else ""
    return rotation if meant.channel in names.ANGLES else {names.MOMENT: "N*m", names.POWER: "W"}.get(meant.channel, "")


def _parquet(file: Content, digest: str) -> Source:
    try:
        table = pq.read_table(pa.BufferReader(file.data))
    except (pa.ArrowException, OSError, ValueError) as error:
        raise InputError(f"{file.where} is no Parquet file: {str(error).splitlines()[0]}") from None

    def fetch(label: str) -> Samples:
        try:
            return np.asarray(table.column(label).cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)
        except (pa.ArrowException, ValueError) as error:
            reason = str(error).splitlines()[0]
            raise InputError(f"{file.where}: column '{label}' holds no numbers: {reason}") from None

    labels = tuple(table.column_names)
    return Source(file.where, "table (Parquet)", digest, labels, _units(labels), fetch)


def _units(labels: Sequence[str]) -> dict[str, str]:
    found = {}
    for label in labels:
        if "[" in label:
            try:
                found[label] = split_heading(label)[1]
            except InputError:
                found[label] = label[label.index("[") + 1 :].rstrip("] ")
    return found


def trials(sources: Sequence[Source], chosen: Chosen | None = None, *, prosthesis: bool = False) -> list[list[Source]]:
    """The files of each trial, in the order given: a new one begins where a file brings what the last already has.

    With a ``prosthesis``, a file with its own log is that, whatever else is in it; without one, a log is of no use.
    Raises InputError for a file that brings nothing.
    """
    lacking = "joint angle, ankle moment, ground reaction or marker"
    if prosthesis:
        lacking = "marker, joint angle, ankle moment, ground reaction, pressure, force or muscle length"
    found: list[list[Source]] = []
    have: set[Role] = set()
    for source in sources:
        roles = source.roles(chosen)
        if not prosthesis:
            roles -= {"log"}
        elif "log" in roles:
            roles = {"log"}
        if not roles:
            raise InputError(
                f"{source.where} holds nothing of use: no {lacking} was recognised; name its columns in a file for "
                "--map"
            )
        if not found or roles & have:
            found.append([])
            have = set()
        found[-1].append(source)
        have |= roles
    return found
