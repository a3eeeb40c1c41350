"""Run the reader of a format in a separate process: its library may crash, hang or take any amount of memory.

A damaged file (one changed byte is enough) can crash a library that is written in C or C++. The crash then ends the
process instead of the user's. Other damaged files keep a library busy for ever, or make it ask for any amount of
memory; the processor time and the memory that the process may use therefore follow from the size of the file. An alarm
ends the process, and Linux ends it together with its parent, which may be killed.
"""

import ctypes
import io
import math
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from klute_sim.errors import InputError

MAX_MEMORY_BYTES = 2 * 1024**3
"""Largest address space of the process [bytes]."""
READING_TIME, MIN_READ_RATE = 3.0, 1e6
"""Processor time for a small file [s], and the lowest reading rate [bytes/s], which extends it (both assumed)."""
STARTUP_TIMEOUT = 15.0
"""Time limit for starting a library on a busy machine and reading a small file [s] (assumed)."""
PR_SET_PDEATHSIG = 1
"""Option of Linux's prctl: the signal that a process gets when its parent ends."""


class MemoryLimit(NamedTuple):
    """Memory that a process may use for reading a file, on top of what it has."""

    fixed: int
    """Memory for any file [bytes]."""
    per_file_byte: int
    """Memory for each byte of the file [bytes]."""


def run_isolated(
    module: str, arguments: list[str], n_bytes: int, description: str, format_name: str, content: bytes = b""
) -> bytes:
    """Return what ``python -m module ARGUMENTS SECONDS PARENT`` writes for a file of ``n_bytes``.

    ``content`` goes to its standard input.

    Raises InputError, with ``description`` and ``format_name``, when the process fails, crashes or takes too long.
    """
    timeout = STARTUP_TIMEOUT + n_bytes / MIN_READ_RATE
    # -P keeps Python from importing modules of the working folder.
    command = [sys.executable, "-P", "-m", module, *arguments, f"{timeout + 2:.0f}", str(os.getpid())]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    try:
        process = subprocess.run(
            command, input=content, capture_output=True, env=environment, timeout=timeout, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(
            f"{description} cannot be read as {format_name} within {timeout:.0f} s: the file is damaged"
        ) from None
    if process.returncode == -getattr(signal, "SIGXCPU", 0):
        raise InputError(f"{description} cannot be read as {format_name} in reasonable time: the file is damaged")
    if process.returncode == 0:
        return process.stdout
    lines = process.stderr.decode("utf-8", "replace").strip().splitlines()
    crash = f"the file is damaged, and the {format_name} library crashed"
    reason = lines[-1] if lines and process.returncode == 1 else crash
    raise InputError(f"{description} cannot be read as {format_name}: {''.join(c for c in reason if c.isprintable())}")


def read_and_reply(
    read: Callable[[], Mapping[str, Any]], load_library: Callable[[], object], n_bytes: int, memory: MemoryLimit
) -> None:
    """Write the arrays that ``read`` returns for a file of ``n_bytes`` to standard output, as NumPy ``.npz``.

    The process is limited after ``load_library``. The last two arguments of its command line are SECONDS and PARENT. On
    failure, the reason goes to standard error, and the exit code is 1.
    """
    seconds, parent = sys.argv[-2:]
    _end_with_parent(int(parent))
    if hasattr(signal, "alarm"):  # not available on Windows
        signal.alarm(int(seconds))
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # messages that the library prints must not mix with the result
    warnings.simplefilter("ignore")
    try:
        load_library()
        _limit_resources(n_bytes, memory)
        arrays = read()
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
    except Exception as error:  # libraries document no exception types
        sys.exit((str(error).splitlines() or [type(error).__name__])[0])
    output.write(buffer.getvalue())
    output.close()


def _end_with_parent(parent: int) -> None:
    """End this process when the process ``parent`` ends (Linux only), also while a library is busy."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it has ended before the call
        sys.exit("the parent process has ended")


def _limit_resources(n_bytes: int, memory: MemoryLimit) -> None:
    """Limit memory and processor time, where the system can, to what reading a file of ``n_bytes`` needs."""
    if sys.platform == "win32":
        return
    import resource

    seconds = math.ceil(time.process_time() + READING_TIME + n_bytes / MIN_READ_RATE)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, resource.getrlimit(resource.RLIMIT_CPU)[1]))
    limit = MAX_MEMORY_BYTES
    with suppress(OSError):  # Linux only
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        limit = min(limit, pages * resource.getpagesize() + memory.fixed + memory.per_file_byte * n_bytes)
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
