"""Reading of the runs to compare: run folders and recording files, each with a label."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from klute_sim.datasets import unit_conversion
from klute_sim.datasets.trial_files import text
from klute_sim.errors import InputError
from klute_sim.files.limits import RECORDING
from klute_sim.files.lines import check_duration
from klute_sim.files.parquet import MAGIC as PARQUET_MAGIC
from klute_sim.files.reading import read_bytes
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording, split_heading

PARQUET_SUFFIXES = {".parquet", ".pq"}
"""Suffixes of Parquet files."""
GAIT_RECORDING_FILE = "recording.parquet"
"""Name of the recording in the folder of a gait run."""
PROVENANCE_TABLES = ("device", "controller", "options")
"""Keys of the provenance whose values are tables."""
MAX_LABEL_LENGTH = 40
"""Longest label [characters]."""


@dataclass(frozen=True)
class ComparedRun:
    """Recordings of a run folder or a recording file."""

    label: str
    """Label; runs with the same label are repeats."""
    path: Path
    """Path of the folder or file."""
    parts: Mapping[str, Recording]
    """Trial -> recording; a gait run or a file has one entry, with the label as key."""
    remarks: tuple[str, ...] = ()
    """Remarks for the user, one sentence each."""


def read_runs(specs: Sequence[str]) -> list[ComparedRun]:
    """Read the runs of ``specs``, each ``PATH`` or ``LABEL=PATH``.

    The default label is the name of the folder or file, made unique. Raises InputError for invalid recordings.
    """
    parsed_specs = [_parse_spec(spec) for spec in specs]
    labels = [label for label, _ in parsed_specs if label]
    runs = []
    for label, path in parsed_specs:
        if not label:
            label = _make_unique(_default_label(path), labels)
            labels.append(label)
        parts, remarks = _read_parts(path, label)
        runs.append(ComparedRun(label, path, parts, remarks))
    return runs


def _parse_spec(spec: str) -> tuple[str, Path]:
    label, equals, path = spec.partition("=")
    if not equals or Path(spec).exists():
        label, path = "", spec
    elif not (0 < len(label) <= MAX_LABEL_LENGTH and label.isprintable() and label.strip()):
        raise InputError(f"the label of {spec!r} is invalid; allowed: 1 to {MAX_LABEL_LENGTH} printable characters")
    if not path:
        raise InputError(f"the path of the run '{spec}' is empty; allowed: a run folder or a recording file")
    return label, Path(path)


def _default_label(path: Path) -> str:
    """Return the name of a folder, or of a file without suffix; ``recording.*`` gets the name of its folder."""
    resolved = path.resolve()
    name = resolved.name if path.is_dir() else resolved.stem
    if not path.is_dir() and name == "recording":
        name = resolved.parent.name
    return "".join(c if c.isprintable() else "?" for c in name)[:MAX_LABEL_LENGTH] or "run"


def _make_unique(base_label: str, existing: Sequence[str]) -> str:
    number, label = 1, base_label
    while label in existing:
        number += 1
        label = f"{base_label} ({number})"
    return label


def _read_parts(path: Path, label: str) -> tuple[dict[str, Recording], tuple[str, ...]]:
    if path.is_dir():
        if (path / GAIT_RECORDING_FILE).is_file():
            return {label: check_recording(_read_parquet(path / GAIT_RECORDING_FILE), path / GAIT_RECORDING_FILE)}, ()
        files = sorted(file for file in path.glob("*.parquet") if file.is_file())
        if not files:
            raise InputError(
                f"{path} is not a run folder: it contains no .parquet file; allowed: a folder of 'klute-sim gait' or "
                "'klute-sim bench', or a recording (.parquet, .csv)"
            )
        return {file.stem: check_recording(_read_parquet(file), file) for file in files}, ()
    if not path.exists():
        raise InputError(f"{path} does not exist; allowed: a run folder or a recording (.parquet, .csv)")
    content = read_bytes(path, RECORDING)
    if content.startswith(PARQUET_MAGIC) or path.suffix.lower() in PARQUET_SUFFIXES:
        return {label: check_recording(_read_parquet(path), path)}, ()
    recording, remarks = _read_csv(content, path)
    return {label: check_recording(recording, path)}, remarks


def _read_parquet(path: Path) -> Recording:
    try:
        recording = parquet.load_recording(path)
    except InputError as error:
        message = str(error)
        raise InputError(message if str(path) in message else f"recording {path}: {message}") from None
    provenance = recording.provenance
    is_valid = isinstance(provenance, dict) and all(
        isinstance(provenance.get(key) or {}, dict) for key in PROVENANCE_TABLES
    )
    if not is_valid:
        raise InputError(f"recording {path}: its provenance is invalid; pass a recording that klute-sim wrote")
    return recording


def _read_csv(content: bytes, path: Path) -> tuple[Recording, tuple[str, ...]]:
    file = text.parse_delimited_text(content, str(path))
    indices, ignored = [], []
    for index, heading in enumerate(file.headings):
        try:
            split_heading(heading)
        except InputError:
            ignored.append(heading)
        else:
            indices.append(index)
    if not indices:
        raise InputError(f"recording {path}: no column heading has the form 'name [unit]', such as 'force [N]'")
    columns = zip([file.headings[index] for index in indices], file.read_columns(indices), strict=True)
    try:
        recording = Recording.from_columns(columns)
    except InputError as error:
        raise InputError(f"recording {path}: {error}") from None
    if not ignored:
        return recording, ()
    names = ", ".join(f"'{heading}'" for heading in ignored)
    return recording, (f"{path}: columns whose headings do not have the form 'name [unit]' are ignored: {names}.",)


def _convert_time(recording: Recording, path: Path) -> Recording:
    unit = recording.units["time"]
    factor = unit_conversion.get_conversion_factor(unit, "s")
    if factor is None:
        raise InputError(f"recording {path}: time is in '{unit}'; allowed: {unit_conversion.EXAMPLE_UNITS['s']}")
    channels, units = dict(recording.channels), dict(recording.units)
    channels["time"], units["time"] = factor * channels["time"], "s"
    return Recording(channels, units, recording.provenance)


def check_recording(recording: Recording, path: Path) -> Recording:
    """Return ``recording`` with times in [s]; raise InputError unless they increase strictly."""
    time = recording["time"]
    if recording.units["time"] != "s":
        recording = _convert_time(recording, path)
        time = recording["time"]
    if len(time) < 2:
        raise InputError(f"recording {path} has {len(time)} sample{'s' * (len(time) != 1)}; at least 2 are needed")
    if not np.isfinite(time).all():
        raise InputError(f"recording {path}: time is missing in row {int(np.argmin(np.isfinite(time))) + 1}")
    check_duration(time, f"recording {path}")
    decreases = np.flatnonzero(np.diff(time) <= 0.0)
    if len(decreases):
        row = int(decreases[0]) + 2
        raise InputError(
            f"recording {path}: time must increase strictly; it does not at row {row} ({time[row - 1]:.6g} s)"
        )
    return recording
