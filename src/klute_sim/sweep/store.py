"""A sweep's folder: what was planned, and every finished walk as a file of its own, there as soon as it is done."""

import errno
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from klute_sim.errors import InputError, KluteSimError
from klute_sim.recording.run_folder import RUNS
from klute_sim.sweep.walk import HEADINGS, Walked

WALKS = "walks"
"""The folder of the finished walks."""


class Store:
    """The folder of one sweep. Files appear in it whole or not at all, and finished walks stay."""

    def __init__(self, folder: Path) -> None:
        """``folder`` holds, or will hold, one sweep."""
        self.folder = folder

    def get(self, key: str) -> Walked | None:
        """The finished walk of that ``key``; None where there is none, or where the disk has lost it."""
        try:
            kept = json.loads(self._file(key).read_text("utf-8"))
            found = Walked(dict(kept["outcomes"]), kept["failure"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return found if found.failure or tuple(found.outcomes) == HEADINGS else None

    def put(self, key: str, walked: Walked) -> None:
        """Keep a finished walk; raises KluteSimError when it cannot be."""
        with self.writing():
            kept = {"outcomes": dict(walked.outcomes), "failure": walked.failure}
            write(self._file(key), json.dumps(kept, allow_nan=False))

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Turns what the disk refuses into one sentence: KluteSimError."""
        try:
            yield
        except OSError as error:
            full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
            reason = "the disk is full" if full else f"{self.folder} cannot be written ({error.strerror})"
            raise KluteSimError(
                f"{reason}: what was walked so far is kept, and the same command with --out {self.folder} goes on there"
            ) from None

    def _file(self, key: str) -> Path:
        return self.folder / WALKS / f"{key}.json"


def write(file: Path, text: str) -> None:
    """Write ``text`` to ``file``, whole or not at all."""
    fresh = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        fresh.write_text(text, "utf-8")
        fresh.replace(file)
    finally:
        fresh.unlink(missing_ok=True)


def open_folder(wanted: Path | None, described: dict[str, Any], kind: str) -> Store:
    """The store of what is ``described`` in the folder ``wanted``, new or begun before.

    None: in the next ``runs/kind-NNN``. What is described is kept in ``kind.json``.

    Raises InputError if something else is there or nothing can be written there.
    """
    plan = f"{kind}.json"
    try:
        if wanted is None:
            return _begin(_next(kind), plan, described)
        if wanted.exists() and not wanted.is_dir():
            raise InputError(f"output folder {wanted} is a file; name a folder")
        if (wanted / plan).exists():
            _refuse_other(wanted, plan, described)
            return Store(wanted)
        if wanted.is_dir() and any(wanted.iterdir()):
            raise InputError(f"output folder {wanted} is not empty and holds no {kind}; name a new or an empty one")
        wanted.mkdir(parents=True, exist_ok=True)
        return _begin(wanted, plan, described)
    except OSError as error:
        raise InputError(f"output folder {wanted or RUNS} cannot be written: {error.strerror}") from None


def _next(kind: str) -> Path:
    """The next free ``runs/kind-NNN``, made."""
    number = 1
    while True:
        folder = RUNS / f"{kind}-{number:03d}"
        with suppress(FileExistsError):
            folder.mkdir(parents=True)
            return folder
        number += 1


def _begin(folder: Path, plan: str, described: dict[str, Any]) -> Store:
    (folder / WALKS).mkdir(exist_ok=True)
    write(folder / plan, json.dumps(described, indent=2))  # last: a folder that holds it is complete
    return Store(folder)


def _refuse_other(folder: Path, plan: str, described: dict[str, Any]) -> None:
    """Raise InputError unless what the file ``plan`` in ``folder`` holds is what is ``described``."""
    try:
        there = json.loads((folder / plan).read_text("utf-8"))
        different = [name for name, value in json.loads(json.dumps(described)).items() if there.get(name) != value]
    except (ValueError, AttributeError):
        raise InputError(f"{folder / plan} is no plan of a {Path(plan).stem}; name a new or an empty folder") from None
    if different:
        what = ", ".join(name.split("_")[0] for name in different)
        raise InputError(
            f"output folder {folder} holds another {Path(plan).stem} (other {what}); name a new or an empty one"
        )
