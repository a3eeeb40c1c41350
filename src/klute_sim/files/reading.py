"""Open a file that a user gave: a regular file of limited size, and nothing that blocks or never ends."""

import os
import stat
from pathlib import Path

from klute_sim.errors import InputError
from klute_sim.files.limits import MB, FileKind

_FILE_TYPES = {
    stat.S_IFIFO: "a FIFO (named pipe)",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


class MissingFileError(InputError):
    """There is no file at the path."""


def read_bytes(path: str | Path, kind: FileKind) -> bytes:
    """Return the content of the file at ``path``, whose ``kind`` sets the largest size and the name in errors.

    Raises MissingFileError when there is no such file, and InputError when it cannot be read, is not a regular file or
    is too large.
    """
    description = kind.describe(path)
    try:
        _check_status(os.stat(path), description, kind)  # before opening: a FIFO blocks, and a tape rewinds
        with open(path, "rb", opener=_open_without_blocking) as file:
            status = os.fstat(file.fileno())
            _check_status(status, description, kind)
            content = file.read(status.st_size + 1)
    except FileNotFoundError:
        raise MissingFileError(f"{description} cannot be read: No such file or directory") from None
    except OSError as error:
        raise InputError(f"{description} cannot be read: {error.strerror}") from None
    except ValueError:  # a NUL in the path
        raise InputError(f"{description} cannot be read: the path contains a null character") from None
    if len(content) > status.st_size:  # such as /proc, whose files state no size
        raise InputError(f"{description} cannot be read: it is longer than the system states; copy it first")
    return content


def _open_without_blocking(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _check_status(status: os.stat_result, description: str, kind: FileKind) -> None:
    file_type = stat.S_IFMT(status.st_mode)
    if file_type == stat.S_IFDIR:
        raise InputError(f"{description} cannot be read: Is a directory; give a file")
    if file_type != stat.S_IFREG:
        name = _FILE_TYPES.get(file_type, "no regular file")
        raise InputError(f"{description} cannot be read: it is {name}; give a regular file")
    if status.st_size > kind.max_bytes:
        raise InputError(f"{description} has {status.st_size / MB:.7g} MB; allowed: up to {kind.max_bytes / MB:.4g} MB")


def read_text(path: str | Path, kind: FileKind) -> str:
    """Return the text (UTF-8, with or without byte order mark) of the file at ``path``; see :func:`read_bytes`.

    Raises InputError, too, when the content is not UTF-8.
    """
    return decode_text(read_bytes(path, kind), kind.describe(path))


def decode_text(content: bytes, description: str) -> str:
    """Return ``content`` as text; ``description`` names the file in errors."""
    try:
        return content.decode("utf-8-sig")  # spreadsheet programs begin a file with a byte order mark
    except UnicodeDecodeError:
        raise NotTextError(f"{description} cannot be read: not a UTF-8 text file") from None


class NotTextError(InputError):
    """A file that should hold text does not."""
