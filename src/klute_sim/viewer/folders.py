"""What kinds of folders there are to look at, and where the rerun recording of each is, or how it is made."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pyarrow as pa

from klute_sim.errors import InputError
from klute_sim.gait import reference_folder


class FolderKind(NamedTuple):
    """A kind of folder."""

    name: str
    marker_file: str
    """The file by which it is known."""
    rrd_file: str
    builder_module: str
    """Module beside this one whose ``remake`` makes the recording of the folder's files; '' if only the command that
    made the folder could."""
    source_files: tuple[str, ...] = ()
    """Files that the recording is older than when it has to be made anew."""
    started_file: str = ""
    """The file by which one is known that is not finished."""


FOLDER_KINDS = (
    FolderKind("gait run", "recording.parquet", "recording.rrd", "gait", ("recording.parquet",)),
    FolderKind("bench run", "protocol.toml", "recording.rrd", "bench", ("summary.json",)),
    FolderKind("comparison", "comparison.json", "comparison.rrd", ""),
    FolderKind("diagnosis", "verdict.json", "recording.rrd", ""),
    FolderKind("sweep", "sweep.parquet", "sweep.rrd", "sweep", ("sweep.parquet",), "sweep.json"),
    FolderKind("tuning", "tried.csv", "tuning.rrd", "tuning", ("tuning.json", "tried.csv"), "tune.json"),
    FolderKind(
        "training",
        "learning_curve.csv",
        "training.rrd",
        "training",
        ("learning_curve.csv", "summary.json"),
        "config.toml",
    ),
)


def detect_folder_kind(folder: Path) -> FolderKind:
    """What ``folder`` is; raises InputError if it is nothing to look at."""
    for kind in FOLDER_KINDS:
        if (folder / kind.marker_file).is_file():
            return kind
    for kind in FOLDER_KINDS:
        if kind.started_file and (folder / kind.started_file).is_file():
            raise InputError(
                f"{folder} is a {kind.name} without {kind.marker_file}: let the command that began it finish"
            )
    if (folder / reference_folder.METADATA_FILE).is_file():
        raise InputError(
            f"{folder} is a reference, which has no view; its strides are shown by 'klute-sim compare {folder}', and a "
            f"walk on it by 'klute-sim gait --reference {folder}'"
        )
    names = ", ".join(f"{kind.name} ({kind.marker_file})" for kind in FOLDER_KINDS)
    raise InputError(f"{folder} is no folder that can be viewed; those are: {names}")


@contextmanager
def ensure_recording(path: Path) -> Iterator[Path]:
    """The .rrd file of the folder ``path`` (or ``path`` itself), made if it can be.

    One that is missing, or older than what it is made of, is made: in the folder, or where that cannot be
    written to, in a temporary one. Raises InputError if there is none to be had and MissingExtraError without rerun.
    """
    if path.is_file() and path.suffix == ".rrd":
        yield path
        return
    if not path.is_dir():
        raise InputError(f"{path} is no .rrd file" if path.exists() else f"no run folder {path}")
    kind = detect_folder_kind(path)
    file = path / kind.rrd_file
    if not kind.builder_module:
        if not file.is_file():
            raise InputError(
                f"{path} has no {kind.rrd_file}: the {kind.name} was made without the extra 'rerun', without its "
                "report, or had nothing to show; install the extra and make it again"
            )
        yield file
    elif _is_up_to_date(kind, file):
        yield file
    elif os.access(path, os.W_OK):
        _rebuild(kind, path, file)
        yield file
    else:
        with tempfile.TemporaryDirectory() as scratch:
            _rebuild(kind, path, Path(scratch) / kind.rrd_file)
            yield Path(scratch) / kind.rrd_file


def _is_up_to_date(kind: FolderKind, file: Path) -> bool:
    """Whether there is a ``file`` and nothing that it is made of is newer."""
    sources = [file.with_name(name) for name in kind.source_files]
    newest = max((each.stat().st_mtime_ns for each in sources if each.is_file()), default=0)
    return file.is_file() and newest <= file.stat().st_mtime_ns


def _rebuild(kind: FolderKind, folder: Path, file: Path) -> None:
    try:
        import_module(f"klute_sim.viewer.layouts.{kind.builder_module}").rebuild_recording(folder, file)
    except (KeyError, TypeError, ValueError, OSError, pa.ArrowException) as error:
        raise InputError(f"{folder} is a {kind.name} that cannot be shown: {type(error).__name__}: {error}") from None
