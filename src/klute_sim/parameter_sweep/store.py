"""The result folder of a sweep: its plan, and one file per finished case, written as soon as the case is finished."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from klute_sim.errors import InputError, KluteSimError
from klute_sim.files.json import read_json
from klute_sim.files.limits import RESULT
from klute_sim.parameter_sweep.evaluate import METRIC_COLUMNS, CaseResult
from klute_sim.parameter_sweep.joint_metrics import JOINT_METRIC_COLUMNS
from klute_sim.parameter_sweep.walk_metrics import WALK_METRIC_COLUMNS
from klute_sim.recording.atomic_file import is_temporary, remove_temporary_files, write_atomically
from klute_sim.recording.folder_lock import LOCK_FILE_NAME, FolderLock
from klute_sim.recording.run_folder import DEFAULT_RUNS_FOLDER, FULL_DISK_ERRNOS, create_persistent_folder

RESULTS_FOLDER = "cases"
"""Name of the folder that holds the results of the finished cases."""


class ResultStore:
    """The results of one sweep or search on disk; every file appears complete or not at all."""

    def __init__(self, folder: Path) -> None:
        """Use ``folder``, which holds or will hold the results of one sweep."""
        self.folder = folder

    def get(self, key: str) -> CaseResult | None:
        """Return the result of the case with this ``key``; None when there is none or its file is damaged."""
        try:
            content = read_json(self._result_path(key), RESULT)
            result = CaseResult(dict(content["metrics"]), content["failure"])
        except (InputError, ValueError, KeyError, TypeError):
            return None
        known = METRIC_COLUMNS, WALK_METRIC_COLUMNS, JOINT_METRIC_COLUMNS
        return result if result.failure or tuple(result.metrics) in known else None

    def put(self, key: str, result: CaseResult) -> None:
        """Write the result of the case with this ``key``; raises KluteSimError when it cannot be written."""
        with self.translate_write_errors():
            content = {"metrics": dict(result.metrics), "failure": result.failure}
            write_atomically(self._result_path(key), json.dumps(content, allow_nan=False))

    @contextmanager
    def translate_write_errors(self) -> Iterator[None]:
        """Raise KluteSimError with one sentence in place of an OSError."""
        try:
            yield
        except OSError as error:
            is_full = error.errno in FULL_DISK_ERRNOS
            reason = "the disk is full" if is_full else f"{self.folder} cannot be written ({error.strerror or error})"
            raise KluteSimError(
                f"{reason}: finished cases are kept; the same command with --out {self.folder} continues"
            ) from None

    def lock(self) -> FolderLock:
        """Lock the folder for the process that adds results; raises InputError when another one does that."""
        with self.translate_write_errors():
            return FolderLock(self.folder)

    def list_search_files(self, kind: str) -> list[str]:
        """Return the names of the plan of a search of this ``kind`` and of its cases, where they exist."""
        return [name for name in (f"{kind}.json", RESULTS_FOLDER) if (self.folder / name).exists()]

    def _result_path(self, key: str) -> Path:
        return self.folder / RESULTS_FOLDER / f"{key}.json"


def open_store(folder: str | Path | None, description: dict[str, Any], kind: str) -> ResultStore:
    """Open the store in ``folder``, new or started earlier with the same ``description`` (JSON types).

    The file ``kind.json`` in the folder holds the description. ``folder`` None means the next ``runs/kind-NNN``.

    Raises InputError when the folder holds something else, is in use, or cannot be written.
    """
    plan_file, requested = f"{kind}.json", None if folder is None else Path(folder)
    try:
        if requested is None:
            with create_persistent_folder(kind, None) as lock:
                return _initialize_store(lock.folder, plan_file, description)
        if requested.exists() and not requested.is_dir():
            raise InputError(f"output folder {requested} is a file; name a folder")
        requested.mkdir(parents=True, exist_ok=True)
        if not (requested / plan_file).exists():
            _check_empty(requested, kind)  # without a trace in the folder of somebody else
        with FolderLock(requested):
            if (requested / plan_file).exists():
                _check_same_plan(requested, plan_file, description)
                (requested / RESULTS_FOLDER).mkdir(exist_ok=True)
                remove_temporary_files(requested)
                remove_temporary_files(requested / RESULTS_FOLDER)
                return ResultStore(requested)
            return _initialize_store(requested, plan_file, description)
    except OSError as error:
        raise InputError(
            f"output folder {requested or DEFAULT_RUNS_FOLDER} cannot be written: {error.strerror}"
        ) from None


def _check_empty(folder: Path, kind: str) -> None:
    """Raise InputError if ``folder`` holds more than what a process leaves that is killed before it stores the plan."""
    results = folder / RESULTS_FOLDER
    has_results = results.exists() and not (results.is_dir() and not any(results.iterdir()))
    names = {entry.name for entry in folder.iterdir() if not is_temporary(entry.name)}
    if has_results or names - {LOCK_FILE_NAME, RESULTS_FOLDER}:
        raise InputError(f"output folder {folder} is not empty and holds no {kind}; name a new or an empty one")


def _initialize_store(folder: Path, plan_file: str, description: dict[str, Any]) -> ResultStore:
    remove_temporary_files(folder)
    (folder / RESULTS_FOLDER).mkdir(exist_ok=True)
    write_atomically(folder / plan_file, json.dumps(description, indent=2))  # last: it marks the folder as complete
    return ResultStore(folder)


def _check_same_plan(folder: Path, plan_file: str, description: dict[str, Any]) -> None:
    """Raise InputError unless ``plan_file`` in ``folder`` holds ``description``."""
    kind = Path(plan_file).stem
    try:
        stored = read_json(folder / plan_file, RESULT)
        different = [name for name, value in json.loads(json.dumps(description)).items() if stored.get(name) != value]
    except (InputError, AttributeError):
        raise InputError(f"{folder / plan_file} is not the plan of a {kind}; name a new or an empty folder") from None
    if different:
        names = ", ".join(name.split("_")[0] for name in different)
        raise InputError(f"output folder {folder} holds another {kind} (other {names}); name a new or an empty one")
