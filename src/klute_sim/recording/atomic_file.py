"""Write files that appear complete or not at all, also when the process is killed or the disk is full."""

import os
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_TEMPORARY_PATTERN = re.compile(r"\.\d+-\d+\..+")


@contextmanager
def replace_atomically(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; its file replaces ``path`` at the end, and disappears after an error.

    The temporary path has the suffix of ``path``, from which some writers choose the format.
    """
    temporary = path.with_name(f".{os.getpid()}-{threading.get_ident()}.{path.name}")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        with suppress(OSError):  # absent after a successful write
            temporary.unlink(missing_ok=True)


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write ``content``, text as UTF-8, to ``path``."""
    with replace_atomically(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def is_temporary(name: str) -> bool:
    """Return whether a file of this ``name`` is the temporary file of :func:`replace_atomically`."""
    return _TEMPORARY_PATTERN.fullmatch(name) is not None


def remove_temporary_files(folder: Path) -> None:
    """Remove the temporary files that killed processes left in ``folder``, which no other process may use."""
    for file in folder.iterdir():
        if is_temporary(file.name):
            file.unlink(missing_ok=True)
