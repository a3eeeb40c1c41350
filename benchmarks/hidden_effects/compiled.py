"""Cache of compiled functions that is invalidated when any of their source files changes."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

COMPILED_SOURCES = (
    "air.py",
    "air_space.py",
    "compiled.py",
    "damper.py",
    "joint_truth.py",
    "law.py",
    "rubber.py",
    "truth.py",
)
"""Files with compiled functions, which call each other."""
SOURCES_DIGEST = hashlib.sha256(
    b"".join((Path(__file__).parent / name).read_bytes() for name in COMPILED_SOURCES)
).hexdigest()[:12]


def cached_njit(function: Callable[..., Any]) -> Any:
    """Return ``function``, compiled at its first call; it releases Python's lock, so that others run beside it.

    Numba's cache detects only changes of the file of a function, not of the functions that it calls. The cache is
    looked up by name, so the name includes the digest of all files.
    """
    function.__qualname__ += f"_{SOURCES_DIGEST}"
    return numba.njit(cache=True, nogil=True)(function)
