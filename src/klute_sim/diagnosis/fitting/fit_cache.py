"""Fits that are finished, kept on the disk until the diagnosis is: an interrupted one goes on where it was."""

import contextlib
import hashlib
import os
import shutil
import sys
from functools import cache
from pathlib import Path

import numpy as np

from klute_sim.diagnosis.experiments.base import Array
from klute_sim.effects import catalogue

CACHE_VARIABLE = "KLUTE_SIM_CACHE"
"""Environment variable that names another place to keep them."""


def find_cache_folder() -> Path:
    """Where finished fits are kept, as the system has it."""
    if os.environ.get(CACHE_VARIABLE):
        return Path(os.environ[CACHE_VARIABLE])
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home()))) / "klute-sim" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "klute-sim"
    return Path(os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))) / "klute-sim"


@cache
def _hash_code() -> bytes:
    """Digest of all code that a fit depends on."""
    folder = Path(__file__).parents[2]
    parts = ("laws", "effects", "device", "gait", "datasets", "diagnosis")
    files = sorted(file for part in parts for file in (folder / part).rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files) + catalogue.read_user_source()).digest()


class FitCache:
    """Of one dataset. What cannot be kept (a full disk) is only not kept."""

    def __init__(self, dataset_digest: str) -> None:
        """``dataset`` is its digest."""
        self._folder = (
            find_cache_folder() / "diagnose" / hashlib.sha256(_hash_code() + dataset_digest.encode()).hexdigest()[:24]
        )

    def get(self, key: str) -> dict[str, Array] | None:
        """The arrays that were put for ``question``."""
        try:
            with np.load(self._path_of(key), allow_pickle=False) as kept:
                return {name: kept[name] for name in kept.files}
        except (OSError, ValueError, EOFError):
            return None

    def put(self, key: str, **arrays: Array) -> None:
        """Keep ``arrays``; whole or not at all."""
        file = self._path_of(key)
        fresh = file.with_suffix(f".{os.getpid()}.tmp")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with fresh.open("wb") as out:
                np.savez(out, **arrays)  # type: ignore[arg-type]
            fresh.replace(file)
        except OSError:
            with contextlib.suppress(OSError):
                fresh.unlink(missing_ok=True)

    def clear(self) -> None:
        """Remove what was kept: it has been used."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _path_of(self, key: str) -> Path:
        return self._folder / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.npz"
