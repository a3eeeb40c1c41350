"""Create run folders, which hold all files of a run or do not exist.

The folder is locked before the work starts, so that two simultaneous runs never use the same folder. Files are written
into a hidden folder inside it and move to their places when all of them are complete. An interrupt, an error or a full
disk therefore leaves no incomplete file. A killed process leaves only hidden folders, which the next run recognizes.
"""

import errno
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from klute_sim.errors import InputError, KluteSimError
from klute_sim.recording.folder_lock import LOCK_FILE_NAME, FolderInUseError, FolderLock

DEFAULT_RUNS_FOLDER = Path("runs")
"""Folder of runs without a requested folder."""
SCRATCH_FOLDER_NAME = ".unfinished"
"""Name of the folder that holds the files of an unfinished run."""
COMPLETE_FOLDER_NAME = ".complete"
"""Name of the folder that holds the complete files of a run while they move to their places."""
FULL_DISK_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Numbers of the errors that mean a full disk, a full quota or a limit on the size of files."""


class _OccupiedFolderError(InputError):
    """The folder holds something else."""


@contextmanager
def create_run_folder(kind: str, requested_folder: str | Path | None) -> Iterator[tuple[Path, Path]]:
    """Create the folder of a new run of ``kind``, and yield it with the scratch folder to fill.

    The folder is ``requested_folder``, or the next ``runs/kind-NNN``. On success the files of the scratch folder move
    into the folder of the run. On a failure everything that was created is removed. What a killed process left in the
    folder is removed, or moved to its place if it was complete.

    Raises InputError at once when the folder is not empty, is in use, or cannot be written. Raises KluteSimError when
    the disk is full.
    """
    lock, created = _reserve(kind, requested_folder)
    folder, scratch = lock.folder, lock.folder / SCRATCH_FOLDER_NAME
    try:
        scratch.mkdir()
        yield folder, scratch
        _move_files(scratch.rename(folder / COMPLETE_FOLDER_NAME))
        created.clear()
    except OSError as error:
        if error.errno in FULL_DISK_ERRNOS:
            raise KluteSimError(f"the disk is full: {folder} was not written") from None
        raise KluteSimError(f"{folder} was not written: {error}") from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        lock.release()
        _remove_created(created)


def create_persistent_folder(kind: str, requested_folder: str | Path | None) -> FolderLock:
    """Create a folder whose content survives an interrupt: ``requested_folder``, or ``runs/kind-NNN``.

    Returns its lock, which the caller releases. Raises InputError when the folder is not empty, is in use, or cannot be
    written.
    """
    return _reserve(kind, requested_folder)[0]


def _reserve(kind: str, requested_folder: str | Path | None) -> tuple[FolderLock, list[Path]]:
    """Return the lock of the empty folder of a new run, and the folders that were created for it."""
    created: list[Path] = []
    try:
        if requested_folder is not None:
            return _claim(Path(requested_folder), created), created
        number = 1
        while True:
            with suppress(_OccupiedFolderError, FolderInUseError):
                return _claim(DEFAULT_RUNS_FOLDER / f"{kind}-{number:03d}", created), created
            number += 1
    except OSError as error:
        _remove_created(created)
        raise InputError(
            f"output folder {requested_folder or DEFAULT_RUNS_FOLDER} cannot be written: {error.strerror}"
        ) from None
    except InputError:
        _remove_created(created)
        raise


def _claim(folder: Path, created: list[Path]) -> FolderLock:
    """Create ``folder`` if necessary, lock it, and remove what a killed process left there.

    The created folders are appended to ``created``. Raises FolderInUseError or _OccupiedFolderError.
    """
    for path in (*reversed(folder.parents), folder):
        if not path.exists():
            try:
                path.mkdir()
                created.append(path)
            except FileExistsError:
                if not path.exists():  # a broken link, not another run that was faster
                    raise
    if not folder.is_dir():
        raise _OccupiedFolderError(f"output folder {folder} is a file; name a new or an empty folder")
    _check_empty(folder)  # without a trace in the folder of somebody else
    lock = FolderLock(folder)
    try:
        if (folder / COMPLETE_FOLDER_NAME).is_dir():
            _move_files(folder / COMPLETE_FOLDER_NAME)
        _check_empty(folder)  # the last run may have finished meanwhile
        if (folder / SCRATCH_FOLDER_NAME).exists():
            if not lock.is_supported:
                raise _OccupiedFolderError(
                    f"output folder {folder} holds an unfinished run; if no process uses it, delete "
                    f"{folder / SCRATCH_FOLDER_NAME}"
                )
            shutil.rmtree(folder / SCRATCH_FOLDER_NAME)
    except BaseException:
        lock.release()
        raise
    return lock


def _check_empty(folder: Path) -> None:
    names = {entry.name for entry in folder.iterdir()}
    if names - {LOCK_FILE_NAME, SCRATCH_FOLDER_NAME} and COMPLETE_FOLDER_NAME not in names:
        raise _OccupiedFolderError(f"output folder {folder} is not empty; name a new or an empty one")


def _move_files(complete: Path) -> None:
    """Move the files in ``complete`` into the folder above it, and remove ``complete``."""
    for file in sorted(complete.iterdir()):
        file.rename(complete.parent / file.name)
    complete.rmdir()


def _remove_created(created: list[Path]) -> None:
    """Remove the created folders that are empty."""
    for folder in reversed(created):
        with suppress(OSError):
            folder.rmdir()
