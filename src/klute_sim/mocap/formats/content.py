"""The bytes of a file that somebody else wrote: bounded, and refused in one sentence."""

from dataclasses import dataclass
from pathlib import Path

from klute_sim.errors import InputError

MAX_BYTES = 512 * 1024 * 1024
"""Larger files are refused: an hour of 60 markers at 250 Hz is about a third of it."""


@dataclass(frozen=True)
class FileContent:
    """A file's bytes and its name for errors."""

    name: str
    data: bytes

    def decode(self) -> str:
        """As text; raises InputError where it is none."""
        if b"\0" in self.data:
            raise InputError(f"{self.name} is not a text file; allowed is UTF-8 text")
        try:
            return self.data.decode("utf-8-sig")
        except UnicodeDecodeError:
            return self.data.decode("latin-1")  # names of people and programs; numbers are ASCII either way


def read(path: str | Path) -> FileContent:
    """The file at ``path``; raises InputError when it cannot be read, is empty or larger than any trial."""
    try:
        size = Path(path).stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"{path} has {size / 2**20:.0f} MiB; allowed are {MAX_BYTES // 2**20} MiB")
        data = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    if not data.strip():
        raise InputError(f"{path} is empty")
    return FileContent(str(path), data)
