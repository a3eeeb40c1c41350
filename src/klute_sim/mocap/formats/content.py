"""Size-limited reading of files from other programs."""

from dataclasses import dataclass
from pathlib import Path

from klute_sim.errors import InputError

MAX_BYTES = 512 * 1024 * 1024
"""Largest accepted file size [bytes]; an hour of 60 markers at 250 Hz takes about a third of it."""


@dataclass(frozen=True)
class FileContent:
    """Bytes of a file, with the file's name for error messages."""

    name: str
    """File name in error messages."""
    data: bytes
    """Raw content."""

    def decode(self) -> str:
        """Return the content as text; raise InputError for binary content."""
        if b"\0" in self.data:
            raise InputError(f"{self.name} is not a text file; allowed is UTF-8 text")
        try:
            return self.data.decode("utf-8-sig")
        except UnicodeDecodeError:
            # Only names of people and programs are affected: numbers are ASCII in both encodings.
            return self.data.decode("latin-1")


def read(path: str | Path) -> FileContent:
    """Read the file at ``path``.

    Raises InputError when the file cannot be read, is empty or exceeds :data:`MAX_BYTES`.
    """
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
