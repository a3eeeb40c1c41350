"""Lock an output folder, so that one process at a time writes into it.

The operating system holds the lock and releases it when the process ends, however it ends. The lock file itself means
nothing: a killed process leaves it behind, and the next process takes it over.
"""

import errno
import os
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from klute_sim.errors import InputError

LOCK_FILE_NAME = ".klute-sim.lock"
"""Name of the lock file in an output folder; it holds the number of the process."""
_UNSUPPORTED_ERRNOS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL)
_LOCKED_BYTE = 1 << 20  # beyond the content, because Windows refuses to read locked bytes


class FolderInUseError(InputError):
    """Another process, or another call in this process, writes into the folder."""


def lock_folder(folder: Path) -> "FolderLock":
    """Return the lock of the existing ``folder``; raises InputError when it is in use or cannot be written."""
    try:
        return FolderLock(folder)
    except OSError as error:
        raise InputError(f"output folder {folder} cannot be written: {error.strerror}") from None


class FolderLock:
    """The lock of an output folder, held until :meth:`release` or the end of the process; a context manager."""

    def __init__(self, folder: Path) -> None:
        """Lock the existing ``folder``.

        Raises FolderInUseError at once when it is locked, and OSError when it cannot be written.
        """
        self.folder, self._path = folder, folder / LOCK_FILE_NAME
        self.is_supported = True
        """Whether the file system of the folder has locks; without them the folder is not protected."""
        while True:
            self._descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
            try:
                self._lock()
                if self._is_current():
                    os.ftruncate(self._descriptor, 0)
                    os.write(self._descriptor, str(os.getpid()).encode())
                    return
            except BaseException:
                os.close(self._descriptor)
                raise
            os.close(self._descriptor)

    def release(self) -> None:
        """Remove the lock file and release the lock."""
        if os.name == "nt":  # an open file cannot be removed there
            os.close(self._descriptor)
        with suppress(OSError):
            self._path.unlink()
        if os.name != "nt":
            os.close(self._descriptor)

    def __enter__(self) -> "FolderLock":
        """Return the lock, which is held already."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Release the lock."""
        self.release()

    def _lock(self) -> None:
        try:
            _lock_file(self._descriptor)
        except OSError as error:
            if error.errno in _UNSUPPORTED_ERRNOS:
                self.is_supported = False
                return
            os.lseek(self._descriptor, 0, os.SEEK_SET)
            holder = os.read(self._descriptor, 20).decode(errors="replace")
            process = f"process {holder}" if holder.isdigit() else "another process"
            raise FolderInUseError(
                f"output folder {self.folder} is in use by {process}; wait until it has ended, or name another folder"
            ) from None

    def _is_current(self) -> bool:
        """Return whether the locked file is still in the folder: its last holder may have removed it meanwhile."""
        try:
            return os.path.samestat(os.fstat(self._descriptor), os.stat(self._path))
        except FileNotFoundError:
            return False


if os.name == "nt":
    import msvcrt

    def _lock_file(descriptor: int) -> None:
        os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        os.lseek(descriptor, 0, os.SEEK_SET)

else:
    import fcntl

    def _lock_file(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
