"""What is compared: run folders and recording files, each under a label."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from klute_sim.datasets import quantity, text
from klute_sim.errors import InputError
from klute_sim.recording import parquet
from klute_sim.recording.recording import Recording, split_heading

PARQUET_SUFFIXES = {".parquet", ".pq"}
GAIT_RECORDING_FILE = "recording.parquet"
"""Of a gait run."""
PROVENANCE_TABLES = ("device", "controller", "options")
"""Of the provenance: tables that are looked into."""
MAX_LABEL_LENGTH = 40
"""Characters."""


@dataclass(frozen=True)
class ComparedRun:
    """A run folder or a recording file."""

    label: str
    """What it is called; runs with the same label are repeats."""
    path: Path
    parts: Mapping[str, Recording]
    """Trial -> recording; of a gait run or a file there is one, under its label."""
    remarks: tuple[str, ...] = ()
    """What the user should know, one sentence each."""


def read_runs(specs: Sequence[str]) -> list[ComparedRun]:
    """Read the runs that ``words`` name: ``PATH`` or ``LABEL=PATH``.

    Without a label it is the folder's or the file's name, made different if two are alike. Raises InputError for what
    is no recording.
    """
    named = [_parse_spec(word) for word in specs]
    taken = [label for label, _ in named if label]
    runs = []
    for label, path in named:
        if not label:
            label = _make_unique(_default_label(path), taken)
            taken.append(label)
        parts, remarks = _read_parts(path, label)
        runs.append(ComparedRun(label, path, parts, remarks))
    return runs


def _parse_spec(spec: str) -> tuple[str, Path]:
    label, equals, path = spec.partition("=")
    if not equals or Path(spec).exists():
        label, path = "", spec
    elif not (0 < len(label) <= MAX_LABEL_LENGTH and label.isprintable() and label.strip()):
        raise InputError(f"the label of {spec!r} is not usable; allowed: 1 to {MAX_LABEL_LENGTH} printable characters")
    if not path:
        raise InputError(f"the path of the run '{spec}' is empty; allowed: a run folder or a recording file")
    return label, Path(path)


def _default_label(path: Path) -> str:
    """Of a folder its name, of a file that without its ending; a file ``recording.*`` is called as its folder."""
    whole = path.resolve()
    name = whole.name if path.is_dir() else whole.stem
    if not path.is_dir() and name == "recording":
        name = whole.parent.name
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
            return {label: _check_recording(_read_parquet(path / GAIT_RECORDING_FILE), path / GAIT_RECORDING_FILE)}, ()
        files = sorted(file for file in path.glob("*.parquet") if file.is_file())
        if not files:
            raise InputError(
                f"{path} is no run folder: it has no .parquet file; allowed: a folder that 'klute-sim gait' or 'bench' "
                "made, or a recording (.parquet, .csv)"
            )
        return {file.stem: _check_recording(_read_parquet(file), file) for file in files}, ()
    if not path.exists():
        raise InputError(f"no run {path}; allowed: a run folder or a recording (.parquet, .csv)")
    try:
        with path.open("rb") as file:
            magic = file.read(4)
        if magic == b"PAR1" or path.suffix.lower() in PARQUET_SUFFIXES:
            return {label: _check_recording(_read_parquet(path), path)}, ()
        recording, remarks = _read_csv(path.read_bytes(), path)
    except OSError as error:
        raise InputError(f"recording {path} cannot be read: {error.strerror}") from None
    return {label: _check_recording(recording, path)}, remarks


def _read_parquet(path: Path) -> Recording:
    try:
        recording = parquet.read(path)
    except InputError as error:
        said = str(error)
        raise InputError(said if str(path) in said else f"recording {path}: {said}") from None
    except ValueError:
        raise InputError(f"recording {path}: its provenance is no JSON text; allowed: what klute-sim wrote") from None
    known = recording.provenance
    if not (isinstance(known, dict) and all(isinstance(known.get(key) or {}, dict) for key in PROVENANCE_TABLES)):
        raise InputError(f"recording {path}: its provenance is not of a recording; allowed: what klute-sim wrote")
    return recording


def _read_csv(content: bytes, path: Path) -> tuple[Recording, tuple[str, ...]]:
    file = text.parse_delimited_text(content, str(path))
    wanted, ignored = [], []
    for place, heading in enumerate(file.headings):
        try:
            split_heading(heading)
        except InputError:
            ignored.append(heading)
        else:
            wanted.append(place)
    if not wanted:
        raise InputError(f"recording {path}: no column is of the form 'name [unit]', such as 'force [N]'")
    columns = zip([file.headings[place] for place in wanted], file.read_columns(wanted), strict=True)
    try:
        recording = Recording.from_columns(columns)
    except InputError as error:
        raise InputError(f"recording {path}: {error}") from None
    if not ignored:
        return recording, ()
    names = ", ".join(f"'{heading}'" for heading in ignored)
    return recording, (f"{path}: columns that are not of the form 'name [unit]' are left out: {names}.",)


def _convert_time(recording: Recording, path: Path) -> Recording:
    unit = recording.units["time"]
    factor = quantity.get_conversion_factor(unit, "s")
    if factor is None:
        raise InputError(f"recording {path}: time is in '{unit}'; allowed: {quantity.EXAMPLE_UNITS['s']}")
    channels, units = dict(recording.channels), dict(recording.units)
    channels["time"], units["time"] = factor * channels["time"], "s"
    return Recording(channels, units, recording.provenance)


def _check_recording(recording: Recording, path: Path) -> Recording:
    """``recording`` with a clock [s] that rises; raises InputError otherwise."""
    time = recording["time"]
    if recording.units["time"] != "s":
        recording = _convert_time(recording, path)
        time = recording["time"]
    if len(time) < 2:
        raise InputError(f"recording {path} has {len(time)} sample{'s' * (len(time) != 1)}; at least 2 are needed")
    if not np.isfinite(time).all():
        raise InputError(f"recording {path}: a time is missing in row {int(np.argmin(np.isfinite(time))) + 1}")
    falls = np.flatnonzero(np.diff(time) <= 0.0)
    if len(falls):
        row = int(falls[0]) + 2
        raise InputError(f"recording {path}: time does not rise in row {row} ({time[row - 1]:.6g} s); it must")
    return recording
