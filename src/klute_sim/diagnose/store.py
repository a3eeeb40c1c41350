"""Fits that are finished, kept on the disk until the diagnosis is: an interrupted one goes on where it was."""

import contextlib
import hashlib
import os
import shutil
import sys
from functools import cache
from pathlib import Path

import numpy as np

from klute_sim.diagnose.experiment import Array
from klute_sim.effects import catalogue

FOLDER = "KLUTE_SIM_CACHE"
"""Environment variable that names another place to keep them."""


def place() -> Path:
    """Where finished fits are kept, as the system has it."""
    if os.environ.get(FOLDER):
        return Path(os.environ[FOLDER])
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home()))) / "klute-sim" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "klute-sim"
    return Path(os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))) / "klute-sim"


@cache
def _code() -> bytes:
    """Digest of all code that a fit depends on."""
    folder = Path(__file__).parents[1]
    parts = ("laws", "effects", "device", "dataset", "diagnose")
    files = sorted(file for part in parts for file in (folder / part).rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files) + catalogue.source()).digest()


class Store:
    """Of one dataset. What cannot be kept (a full disk) is only not kept."""

    def __init__(self, dataset: str) -> None:
        """``dataset`` is its digest."""
        self._folder = place() / "diagnose" / hashlib.sha256(_code() + dataset.encode()).hexdigest()[:24]

    def get(self, question: str) -> dict[str, Array] | None:
        """The arrays that were put for ``question``."""
        try:
            with np.load(self._file(question), allow_pickle=False) as kept:
                return {name: kept[name] for name in kept.files}
        except (OSError, ValueError, EOFError):
            return None

    def put(self, question: str, **arrays: Array) -> None:
        """Keep ``arrays``; whole or not at all."""
        file = self._file(question)
        fresh = file.with_suffix(f".{os.getpid()}.tmp")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with fresh.open("wb") as out:
                np.savez(out, **arrays)  # type: ignore[arg-type]
            fresh.replace(file)
        except OSError:
            with contextlib.suppress(OSError):
                fresh.unlink(missing_ok=True)

    def forget(self) -> None:
        """Remove what was kept: it has been used."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _file(self, question: str) -> Path:
        return self._folder / f"{hashlib.sha256(question.encode()).hexdigest()[:32]}.npz"
