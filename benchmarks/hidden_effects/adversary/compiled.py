"""Compilation of the adversary's functions, with a cache that is invalidated when any of their files changes."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

SOURCES_DIGEST = hashlib.sha256(
    b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py")))
).hexdigest()[:12]


def compile_cached(function: Callable[..., Any]) -> Any:
    """Return ``function``, compiled at its first call.

    Numba's cache knows only the file of a function, not those of the functions that it calls, so the name under which
    the result is stored includes a digest of all files of this folder.
    """
    function.__qualname__ += f"_{SOURCES_DIGEST}"
    return numba.njit(cache=True)(function)
