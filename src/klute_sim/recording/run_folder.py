"""Run folders: everything of one run side by side, complete or not there at all.

Files are written into a folder beside the final one, which takes its name only when all of them are done: an
interrupt, an error or a full disk leaves nothing half-written.
"""

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from klute_sim.errors import InputError, KluteSimError

RUNS = Path("runs")
"""Where runs go when no folder is named."""


def choose(kind: str, wanted: str | Path | None) -> Path:
    """The folder a run of ``kind`` will fill: ``wanted``, or the next free ``runs/kind-NNN``.

    Raises InputError if something is already there or nothing can be written there; creates nothing.
    """
    if wanted is None:
        number = 1
        while (RUNS / f"{kind}-{number:03d}").exists():
            number += 1
        folder = RUNS / f"{kind}-{number:03d}"
    else:
        folder = Path(wanted)
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"output folder {folder} is not empty; name a new or an empty one")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"output folder {folder} is a file; name a new or an empty folder")
    ground = folder.absolute()
    while not ground.exists():
        ground = ground.parent
    if not (ground.is_dir() and os.access(ground, os.W_OK)):
        raise InputError(f"output folder {folder} cannot be written: no permission in {ground}")
    return folder


@contextmanager
def writing(folder: Path) -> Iterator[Path]:
    """A scratch folder to fill; on success it becomes ``folder``, on any failure it is removed.

    Raises KluteSimError when the disk is full or the place is not writable after all.
    """
    made = [parent for parent in folder.absolute().parents if not parent.exists()]
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    except OSError as error:
        raise InputError(f"output folder {folder} cannot be written: {error.strerror}") from None
    try:
        yield scratch
        scratch.chmod(0o755)  # a scratch folder is private until it is done
        if folder.is_dir():
            folder.rmdir()
        scratch.rename(folder)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise KluteSimError(f"the disk is full: {folder} was not written") from None
        raise KluteSimError(f"{folder} was not written: {error}") from None
    finally:
        if scratch.exists():
            shutil.rmtree(scratch, ignore_errors=True)
            for parent in made:
                with suppress(OSError):  # somebody else's run may be in it by now
                    parent.rmdir()
