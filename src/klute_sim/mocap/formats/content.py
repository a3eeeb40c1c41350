"""Reading of files from other programs: bytes, text and lines within limits."""

import re
from dataclasses import dataclass
from pathlib import Path

from klute_sim.errors import InputError
from klute_sim.files.limits import MOTION
from klute_sim.files.lines import check_lines
from klute_sim.files.reading import read_bytes


@dataclass(frozen=True)
class FileContent:
    """Bytes of a file, with the file's name for error messages."""

    name: str
    """File name in error messages."""
    data: bytes
    """Raw content."""

    def read_lines(self) -> list[str]:
        """Return the lines of the text without line ends; raise InputError for binary content and too many lines."""
        if b"\0" in self.data:
            raise InputError(f"{self.name} is not a text file; allowed is UTF-8 text")
        check_lines(self.data, self.name)
        try:
            text = self.data.decode("utf-8-sig")
        except UnicodeDecodeError:
            # Only names of people and programs are affected: numbers are ASCII in both encodings.
            text = self.data.decode("latin-1")
        return re.split(r"\r\n|\r|\n", text)


def read(path: str | Path) -> FileContent:
    """Read the file at ``path``; raise InputError when it cannot be read, is empty or is too large."""
    data = read_bytes(path, MOTION)
    if not data.strip():
        raise InputError(f"{path} is empty")
    return FileContent(str(path), data)


def differs_from_count(declared: str, count: int) -> bool:
    """Return whether ``declared`` is a whole number other than ``count``.

    They are compared as text, because Python converts only numbers of up to 4300 digits.
    """
    return declared.isascii() and declared.isdecimal() and (declared.lstrip("0") or "0") != str(count)
