"""The folder of a training: its files, and who may use it."""

from pathlib import Path

from klute_sim.errors import InputError
from klute_sim.recording.atomic_file import is_temporary, remove_temporary_files
from klute_sim.recording.folder_lock import LOCK_FILE_NAME, FolderLock, lock_folder
from klute_sim.recording.run_folder import create_persistent_folder

CONFIG_FILE, CHECKPOINT_FILE, PROGRESS_FILE, LEARNING_CURVE_FILE = (
    "config.toml",
    "checkpoint.zip",
    "progress.json",
    "learning_curve.csv",
)
"""Files of a training folder, except its results."""


def create_training_folder(folder: str | Path | None, config: bytes) -> FolderLock:
    """Return the lock of a new training folder: ``folder``, new or empty, or None for the next ``runs/train-NNN``.

    ``folder`` may also hold a training with the configuration file ``config`` that was killed before it stored a
    checkpoint.

    Raises InputError when the folder holds something else, is in use, or cannot be written.
    """
    path = None if folder is None else Path(folder)
    if path is None or not _holds_training(path):
        return create_persistent_folder("train", path)
    lock = lock_folder(path)
    try:
        if (path / CHECKPOINT_FILE).exists() or _read_config(path) != config:
            raise InputError(
                f"output folder {path} holds a training: resume it with --resume and without --seed and --config, or "
                "name a new or an empty folder"
            )
        remove_temporary_files(path)
    except BaseException:
        lock.release()
        raise
    return lock


def lock_training_folder(folder: Path) -> FolderLock:
    """Return the lock of the ``folder`` of a training to resume.

    Raises InputError when there is no training, when it is in use, or when the folder cannot be written.
    """
    if not (folder / PROGRESS_FILE).exists():
        raise InputError(f"there is no training to resume in {folder}: it has no {PROGRESS_FILE}")
    lock = lock_folder(folder)
    remove_temporary_files(folder)
    return lock


def _holds_training(folder: Path) -> bool:
    """Return whether ``folder`` holds nothing but a training, perhaps unfinished."""
    if not (folder / CONFIG_FILE).is_file():
        return False
    names = {entry.name for entry in folder.iterdir() if not is_temporary(entry.name)}
    if CHECKPOINT_FILE in names:
        return True
    return names <= {LOCK_FILE_NAME, CONFIG_FILE, PROGRESS_FILE, LEARNING_CURVE_FILE}


def _read_config(folder: Path) -> bytes:
    return (folder / CONFIG_FILE).read_bytes()
