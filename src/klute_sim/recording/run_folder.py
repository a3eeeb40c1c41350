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

RUNS = Path("runs")
"""Where runs go when no folder is named."""
UNFINISHED = ".unfinished"


@contextmanager
def new(kind: str, wanted: str | Path | None) -> Iterator[tuple[Path, Path]]:
    """The folder of a new run of ``kind`` and the scratch folder to fill: ``wanted``, or the next ``runs/kind-NNN``.

    On success the scratch folder's files move into the run's folder; on any failure everything made here is removed.
    Raises InputError at once if something is already there or nothing can be written there, and KluteSimError when
    the disk is full.
    """
    made: list[Path] = []
    try:
        folder = _reserve_next(kind, made) if wanted is None else _reserve(Path(wanted), made)
    except OSError as error:
        _remove(made)
        raise InputError(f"output folder {wanted or RUNS} cannot be written: {error.strerror}") from None
    scratch = folder / UNFINISHED
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
        _remove(made)


def lasting(kind: str, wanted: str | Path | None) -> Path:
    """A new folder for work that is kept when it is interrupted: ``wanted``, or the next ``runs/kind-NNN``.

    Raises InputError if something is already there or nothing can be written there.
    """
    made: list[Path] = []
    try:
        folder = _reserve_next(kind, made) if wanted is None else _reserve(Path(wanted), made)
        (folder / UNFINISHED).rmdir()
    except OSError as error:
        _remove(made)
        raise InputError(f"output folder {wanted or RUNS} cannot be written: {error.strerror}") from None
    return folder


def _reserve_next(kind: str, made: list[Path]) -> Path:
    number = 1
    while True:
        folder = RUNS / f"{kind}-{number:03d}"
        if not folder.exists():
            with suppress(FileExistsError):  # another run was faster
                _make(folder, made)
                return folder
        number += 1


def _reserve(folder: Path, made: list[Path]) -> Path:
    if folder.is_dir():
        if any(folder.iterdir()):
            raise InputError(f"output folder {folder} is not empty; name a new or an empty one")
        (folder / UNFINISHED).mkdir()
        made.append(folder / UNFINISHED)
    elif folder.exists():
        raise InputError(f"output folder {folder} is a file; name a new or an empty folder")
    else:
        _make(folder, made)
    return folder


def _make(folder: Path, made: list[Path]) -> None:
    """Make ``folder``, what is missing above it and the scratch folder in it; all of them are noted in ``made``."""
    above = [parent for parent in folder.parents if not parent.exists()]
    for parent in reversed(above):
        parent.mkdir(exist_ok=True)
        made.append(parent)
    folder.mkdir()
    made.append(folder)
    (folder / UNFINISHED).mkdir()
    made.append(folder / UNFINISHED)


def _remove(made: list[Path]) -> None:
    """Remove what was made: the scratch folder whole, the others if nobody else has put something there."""
    for folder in reversed(made):
        if folder.name == UNFINISHED:
            shutil.rmtree(folder, ignore_errors=True)
        with suppress(OSError):
            folder.rmdir()
