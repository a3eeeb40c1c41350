"""The folder of a training: its files, and who may use it."""

from pathlib import Path

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


def open_training_folder(folder: str | Path | None) -> FolderLock:
    """Return the lock of the folder of a training: ``folder``, or None for the next ``runs/train-NNN``.

    ``folder`` is new, empty, or holds a training, perhaps one that was killed.

    Raises InputError when the folder holds something else, is in use, or cannot be written.
    """
    path = None if folder is None else Path(folder)
    if path is None or not _holds_training(path):
        return create_persistent_folder("train", path)
    lock = lock_folder(path)
    remove_temporary_files(path)
    return lock


def _holds_training(folder: Path) -> bool:
    """Return whether ``folder`` holds nothing but a training, perhaps unfinished."""
    if not (folder / CONFIG_FILE).is_file():
        return False
    names = {entry.name for entry in folder.iterdir() if not is_temporary(entry.name)}
    if CHECKPOINT_FILE in names:
        return True
    return names <= {LOCK_FILE_NAME, CONFIG_FILE, PROGRESS_FILE, LEARNING_CURVE_FILE}
