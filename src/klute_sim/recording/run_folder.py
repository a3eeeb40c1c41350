"""Run folders: everything of one run side by side, complete or not there at all.

The folder is reserved before the work starts, so that two runs at a time never want the same one, and files are
written into a hidden folder inside it. They move to their places when all of them are done: an interrupt, an error
or a full disk leaves nothing half-written.
"""

import errno
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from klute_sim.errors import InputError, KluteSimError

DEFAULT_RUNS_FOLDER = Path("runs")
"""Where runs go when no folder is named."""
SCRATCH_FOLDER_NAME = ".unfinished"


@contextmanager
def create_run_folder(kind: str, requested_folder: str | Path | None) -> Iterator[tuple[Path, Path]]:
    """The folder of a new run of ``kind`` and the scratch folder to fill: ``wanted``, or the next ``runs/kind-NNN``.

    On success the scratch folder's files move into the run's folder; on any failure everything made here is removed.
    Raises InputError at once if something is already there or nothing can be written there, and KluteSimError when
    the disk is full.
    """
    made: list[Path] = []
    try:
        folder = _reserve_next(kind, made) if requested_folder is None else _reserve(Path(requested_folder), made)
    except OSError as error:
        _remove_created(made)
        raise InputError(
            f"output folder {requested_folder or DEFAULT_RUNS_FOLDER} cannot be written: {error.strerror}"
        ) from None
    scratch = folder / SCRATCH_FOLDER_NAME
    try:
        yield folder, scratch
        for file in sorted(scratch.iterdir()):
            file.rename(folder / file.name)
        scratch.rmdir()
        made.clear()
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise KluteSimError(f"the disk is full: {folder} was not written") from None
        raise KluteSimError(f"{folder} was not written: {error}") from None
    finally:
        _remove_created(made)


def create_persistent_folder(kind: str, requested_folder: str | Path | None) -> Path:
    """A new folder for work that is kept when it is interrupted: ``wanted``, or the next ``runs/kind-NNN``.

    Raises InputError if something is already there or nothing can be written there.
    """
    made: list[Path] = []
    try:
        folder = _reserve_next(kind, made) if requested_folder is None else _reserve(Path(requested_folder), made)
        (folder / SCRATCH_FOLDER_NAME).rmdir()
    except OSError as error:
        _remove_created(made)
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
    """Make ``folder``, what is missing above it and the scratch folder in it; all of them are noted in ``made``."""
    above = [parent for parent in folder.parents if not parent.exists()]
    for parent in reversed(above):
        parent.mkdir(exist_ok=True)
        created.append(parent)
    folder.mkdir()
    created.append(folder)
    (folder / SCRATCH_FOLDER_NAME).mkdir()
    created.append(folder / SCRATCH_FOLDER_NAME)


def _remove_created(created: list[Path]) -> None:
    """Remove what was made: the scratch folder whole, the others if nobody else has put something there."""
    for folder in reversed(created):
        if folder.name == SCRATCH_FOLDER_NAME:
            shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):
            folder.rmdir()
