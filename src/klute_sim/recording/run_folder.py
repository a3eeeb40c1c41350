"""Create run folders, which hold all files of a run or do not exist.

The folder is reserved before the work starts, so that two simultaneous runs never use the same folder. Files are
written into a hidden folder inside it and move to their places when all of them are complete. An interrupt, an error or
a full disk therefore leaves no incomplete file.
"""

import errno
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from klute_sim.errors import InputError, KluteSimError

DEFAULT_RUNS_FOLDER = Path("runs")
"""Folder of runs without a requested folder."""
SCRATCH_FOLDER_NAME = ".unfinished"
"""Name of the folder that holds the files of an unfinished run."""


@contextmanager
def create_run_folder(kind: str, requested_folder: str | Path | None) -> Iterator[tuple[Path, Path]]:
    """Create the folder of a new run of ``kind``, and yield it with the scratch folder to fill.

    The folder is ``requested_folder``, or the next ``runs/kind-NNN``. On success the files of the scratch folder move
    into the folder of the run. On a failure everything that was created is removed.

    Raises InputError at once when the folder is not empty or cannot be written. Raises KluteSimError when the disk is
    full.
    """
    created: list[Path] = []
    try:
        folder = _reserve_next(kind, created) if requested_folder is None else _reserve(Path(requested_folder), created)
    except OSError as error:
        _remove_created(created)
        raise InputError(
            f"output folder {requested_folder or DEFAULT_RUNS_FOLDER} cannot be written: {error.strerror}"
        ) from None
    scratch = folder / SCRATCH_FOLDER_NAME
    try:
        yield folder, scratch
        for file in sorted(scratch.iterdir()):
            file.rename(folder / file.name)
        scratch.rmdir()
        created.clear()
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise KluteSimError(f"the disk is full: {folder} was not written") from None
        raise KluteSimError(f"{folder} was not written: {error}") from None
    finally:
        _remove_created(created)


def create_persistent_folder(kind: str, requested_folder: str | Path | None) -> Path:
    """Create and return a folder whose content survives an interrupt: ``requested_folder``, or ``runs/kind-NNN``.

    Raises InputError when the folder is not empty or cannot be written.
    """
    created: list[Path] = []
    try:
        folder = _reserve_next(kind, created) if requested_folder is None else _reserve(Path(requested_folder), created)
        (folder / SCRATCH_FOLDER_NAME).rmdir()
    except OSError as error:
        _remove_created(created)
        raise InputError(
            f"output folder {requested_folder or DEFAULT_RUNS_FOLDER} cannot be written: {error.strerror}"
        ) from None
    return folder


def _reserve_next(kind: str, created: list[Path]) -> Path:
    number = 1
    while True:
        folder = DEFAULT_RUNS_FOLDER / f"{kind}-{number:03d}"
        if not folder.exists():
            with suppress(FileExistsError):  # another run was faster
                _create_folder(folder, created)
                return folder
        number += 1


def _reserve(folder: Path, created: list[Path]) -> Path:
    if folder.is_dir():
        if any(folder.iterdir()):
            raise InputError(f"output folder {folder} is not empty; name a new or an empty one")
        (folder / SCRATCH_FOLDER_NAME).mkdir()
        created.append(folder / SCRATCH_FOLDER_NAME)
    elif folder.exists():
        raise InputError(f"output folder {folder} is a file; name a new or an empty folder")
    else:
        _create_folder(folder, created)
    return folder


def _create_folder(folder: Path, created: list[Path]) -> None:
    """Create ``folder``, its missing parents and its scratch folder; append all of them to ``created``."""
    missing = [parent for parent in folder.parents if not parent.exists()]
    for parent in reversed(missing):
        parent.mkdir(exist_ok=True)
        created.append(parent)
    folder.mkdir()
    created.append(folder)
    (folder / SCRATCH_FOLDER_NAME).mkdir()
    created.append(folder / SCRATCH_FOLDER_NAME)


def _remove_created(created: list[Path]) -> None:
    """Remove the created folders: the scratch folder with its files, the others if they are empty."""
    for folder in reversed(created):
        if folder.name == SCRATCH_FOLDER_NAME:
            shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):
            folder.rmdir()
