"""Cache of finished fits on disk, so that an interrupted diagnosis resumes."""

import contextlib
import hashlib
import os
import shutil
import sys
from functools import cache
from pathlib import Path

import numpy as np

import klute_sim
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.files.limits import FIT
from klute_sim.files.npz import read_npz
from klute_sim.recording.atomic_file import replace_atomically
from klute_sim.types import Array

CACHE_VARIABLE = "KLUTE_SIM_CACHE"
"""Environment variable with the path of the cache folder."""
FIT_MODULES = (
    *("files", "laws", "effects", "device", "plant", "mechanism", "gait", "datasets", "plausibility", "diagnosis"),
    *("constants.py", "mask_runs.py", "parameters.py", "units.py"),
)
"""Packages and modules whose code determines the result of a fit."""


def find_cache_folder() -> Path:
    """Return the cache folder: that of :data:`CACHE_VARIABLE`, or the operating system's standard place."""
    if os.environ.get(CACHE_VARIABLE):
        return Path(os.environ[CACHE_VARIABLE])
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home()))) / "klute-sim" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "klute-sim"
    return Path(os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))) / "klute-sim"


@cache
def _hash_code() -> bytes:
    """Return the SHA-256 of all code that determines the result of a fit, user effects included."""
    root = Path(klute_sim.__file__).parent
    paths = [root / name for name in FIT_MODULES]
    files = sorted(file for path in paths for file in (path.rglob("*.py") if path.is_dir() else [path]))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files) + catalogue.read_user_source()).digest()


class FitCache:
    """Fits of one diagnosis. A fit that cannot be stored, for example on a full disk, is skipped."""

    def __init__(self, diagnosis_digest: str) -> None:
        """Open the cache of the diagnosis that ``diagnosis_digest`` identifies."""
        digest = hashlib.sha256(_hash_code() + diagnosis_digest.encode()).hexdigest()
        self._folder = find_cache_folder() / "diagnose" / digest[:24]

    def get(self, key: str) -> dict[str, Array] | None:
        """Return the arrays stored under ``key``, or None."""
        try:
            return {name: np.asarray(array) for name, array in read_npz(self._path_of(key), FIT).items()}
        except InputError:
            return None

    def put(self, key: str, **arrays: Array) -> None:
        """Store ``arrays`` under ``key``, completely or not at all."""
        with contextlib.suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            with replace_atomically(self._path_of(key)) as temporary:
                np.savez(temporary, **arrays)  # type: ignore[arg-type]

    def clear(self) -> None:
        """Delete all stored fits of this diagnosis."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _path_of(self, key: str) -> Path:
        return self._folder / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.npz"
