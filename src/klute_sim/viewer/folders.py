"""Kinds of folders that the viewer can show, and how to find or make the recording of each."""

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
    """A kind of folder with results."""

    name: str
    """Name of the kind in messages."""
    marker_file: str
    """Name of the file that identifies the kind."""
    rrd_file: str
    """Name of the viewer recording."""
    builder_module: str
    """Module of :mod:`klute_sim.viewer.layouts` whose ``rebuild_recording`` rebuilds the recording from the files of
    the folder; '' if only the command that wrote the folder can make it.
    """
    source_files: tuple[str, ...] = ()
    """Names of the files that the recording is made from; a recording older than these is rebuilt."""
    started_file: str = ""
    """Name of the file that identifies an unfinished folder of this kind."""


FOLDER_KINDS = (
    FolderKind("walk", "walker.toml", "recording.rrd", "walk", ("recording.parquet",)),
    FolderKind("gait run", "recording.parquet", "recording.rrd", "gait", ("recording.parquet",)),
    FolderKind("bench run", "protocol.toml", "recording.rrd", "bench", ("summary.json",)),
    FolderKind("comparison", "comparison.json", "comparison.rrd", ""),
    FolderKind("diagnosis", "verdict.json", "recording.rrd", ""),
    FolderKind("sweep", "sweep.parquet", "sweep.rrd", "sweep", ("sweep.parquet",), "sweep.json"),
    FolderKind(
        "tuning",
        "walk_evaluations.csv",
        "tuning.rrd",
        "one_objective",
        ("tuning.json", "walk_evaluations.csv"),
        "tune-walk.json",
    ),
    FolderKind(
        "tuning",
        "joint_evaluations.csv",
        "tuning.rrd",
        "one_objective",
        ("tuning.json", "joint_evaluations.csv"),
        "tune-joint.json",
    ),
    FolderKind("tuning", "evaluations.csv", "tuning.rrd", "tuning", ("tuning.json", "evaluations.csv"), "tune.json"),
    FolderKind(
        "training",
        "learning_curve.csv",
        "training.rrd",
        "training",
        ("learning_curve.csv", "summary.json"),
        "config.toml",
    ),
    FolderKind("joint run", "results.csv", "recording.rrd", "joint", ("summary.json",)),
)


ASSESSMENT_FILE, PAGE_FILE = "assessment.json", "index.html"
"""Results and page of a folder of ``klute-sim assess``."""


def detect_folder_kind(folder: Path) -> FolderKind:
    """Return the kind of ``folder``.

    Raises InputError if the viewer cannot show it.
    """
    for kind in FOLDER_KINDS:
        if (folder / kind.marker_file).is_file():
            return kind
    for kind in FOLDER_KINDS:
        if kind.started_file and (folder / kind.started_file).is_file():
            raise InputError(
                f"{folder} is an unfinished {kind.name} (no {kind.marker_file}); let its command finish first"
            )
    if (folder / reference_folder.METADATA_FILE).is_file():
        raise InputError(
            f"{folder} is a gait reference, which has no view; plot its strides with 'klute-sim compare {folder}', or "
            f"simulate a gait on it with 'klute-sim gait --reference {folder}'"
        )
    if (folder / ASSESSMENT_FILE).is_file():
        raise InputError(f"{folder} is an assessment, which has no view; open {folder / PAGE_FILE} in a browser")
    names = ", ".join(f"{kind.name} ({kind.marker_file})" for kind in FOLDER_KINDS)
    raise InputError(f"cannot view {folder}: it is not a folder of results; allowed: {names}")


@contextmanager
def ensure_recording(path: Path) -> Iterator[Path]:
    """Provide the .rrd file of the folder ``path``, or ``path`` itself if it is an .rrd file.

    A recording that is missing or outdated is made in the folder or, if that is read-only, in a temporary folder.
    Raises InputError if there is no recording and none can be made, and MissingExtraError without rerun.
    """
    if path.is_file() and path.suffix == ".rrd":
        yield path
        return
    if not path.is_dir():
        raise InputError(
            f"{path} is neither a folder nor an .rrd file" if path.exists() else f"folder {path} does not exist"
        )
    kind = detect_folder_kind(path)
    file = path / kind.rrd_file
    if not kind.builder_module:
        if not file.is_file():
            raise InputError(
                f"{path} has no {kind.rrd_file}: the {kind.name} was written without the extra 'rerun', without a "
                "report, or had nothing to show; install the extra and run its command again"
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
    """Return whether ``file`` exists and is not older than its source files."""
    sources = [file.with_name(name) for name in kind.source_files]
    newest = max((source.stat().st_mtime_ns for source in sources if source.is_file()), default=0)
    return file.is_file() and newest <= file.stat().st_mtime_ns


def _rebuild(kind: FolderKind, folder: Path, file: Path) -> None:
    try:
        import_module(f"klute_sim.viewer.layouts.{kind.builder_module}").rebuild_recording(folder, file)
    except (AttributeError, KeyError, TypeError, ValueError, OSError, pa.ArrowException) as error:
        raise InputError(f"cannot view the {kind.name} {folder}: {type(error).__name__}: {error}") from None
