"""A sweep's folder: what was planned, and every finished walk as a file of its own, there as soon as it is done."""

import errno
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from klute_sim.errors import InputError, KluteSimError
from klute_sim.parameter_sweep.evaluate import METRIC_COLUMNS, CaseResult
from klute_sim.recording.run_folder import DEFAULT_RUNS_FOLDER

RESULTS_FOLDER = "walks"
"""The folder of the finished walks."""


class ResultStore:
    """The folder of one sweep. Files appear in it whole or not at all, and finished walks stay."""

    def __init__(self, folder: Path) -> None:
        """``folder`` holds, or will hold, one sweep."""
        self.folder = folder

    def get(self, key: str) -> CaseResult | None:
        """The finished walk of that ``key``; None where there is none, or where the disk has lost it."""
        try:
            kept = json.loads(self._result_path(key).read_text("utf-8"))
            found = CaseResult(dict(kept["outcomes"]), kept["failure"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return found if found.failure or tuple(found.metrics) == METRIC_COLUMNS else None

    def put(self, key: str, result: CaseResult) -> None:
        """Keep a finished walk; raises KluteSimError when it cannot be."""
        with self.translate_write_errors():
            kept = {"outcomes": dict(result.metrics), "failure": result.failure}
            write_atomically(self._result_path(key), json.dumps(kept, allow_nan=False))

    @contextmanager
    def translate_write_errors(self) -> Iterator[None]:
        """Turns what the disk refuses into one sentence: KluteSimError."""
        try:
            yield
        except OSError as error:
            full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
            reason = "the disk is full" if full else f"{self.folder} cannot be written ({error.strerror})"
            raise KluteSimError(
                f"{reason}: what was walked so far is kept, and the same command with --out {self.folder} goes on there"
            ) from None

    def _result_path(self, key: str) -> Path:
        return self.folder / RESULTS_FOLDER / f"{key}.json"


def write_atomically(path: Path, text: str) -> None:
    """Write ``text`` to ``file``, whole or not at all."""
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        fresh.write_text(text, "utf-8")
        fresh.replace(path)
    finally:
        fresh.unlink(missing_ok=True)


def open_store(folder: Path | None, description: dict[str, Any], kind: str) -> ResultStore:
    """The store of what is ``described`` in the folder ``wanted``, new or begun before.

    None: in the next ``runs/kind-NNN``. What is described is kept in ``kind.json``.

    Raises InputError if something else is there or nothing can be written there.
    """
    plan = f"{kind}.json"
    try:
        if folder is None:
            return _initialize_store(_make_next_folder(kind), plan, description)
        if folder.exists() and not folder.is_dir():
            raise InputError(f"output folder {folder} is a file; name a folder")
        if (folder / plan).exists():
            _check_same_plan(folder, plan, description)
            return ResultStore(folder)
        if folder.is_dir() and any(folder.iterdir()):
            raise InputError(f"output folder {folder} is not empty and holds no {kind}; name a new or an empty one")
        folder.mkdir(parents=True, exist_ok=True)
        return _initialize_store(folder, plan, description)
    except OSError as error:
        raise InputError(f"output folder {folder or DEFAULT_RUNS_FOLDER} cannot be written: {error.strerror}") from None


def _make_next_folder(kind: str) -> Path:
    """The next free ``runs/kind-NNN``, made."""
    number = 1
    while True:
        folder = DEFAULT_RUNS_FOLDER / f"{kind}-{number:03d}"
        with suppress(FileExistsError):
            folder.mkdir(parents=True)
            return folder
        number += 1


def _initialize_store(folder: Path, plan_file: str, description: dict[str, Any]) -> ResultStore:
    (folder / RESULTS_FOLDER).mkdir(exist_ok=True)
    write_atomically(folder / plan_file, json.dumps(description, indent=2))  # last: a folder that holds it is complete
    return ResultStore(folder)


def _check_same_plan(folder: Path, plan_file: str, description: dict[str, Any]) -> None:
    """Raise InputError unless what the file ``plan`` in ``folder`` holds is what is ``described``."""
    try:
        there = json.loads((folder / plan_file).read_text("utf-8"))
        different = [name for name, value in json.loads(json.dumps(description)).items() if there.get(name) != value]
    except (ValueError, AttributeError):
        raise InputError(
            f"{folder / plan_file} is no plan of a {Path(plan_file).stem}; name a new or an empty folder"
        ) from None
    if different:
        what = ", ".join(name.split("_")[0] for name in different)
        raise InputError(
            f"output folder {folder} holds another {Path(plan_file).stem} (other {what}); name a new or an empty one"
        )
