"""Machine code that is kept on the disk, and made anew when any of the files that it comes from has changed."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

COMPILED_SOURCES = ("air.py", "compiled.py", "law.py", "truth.py")
"""Every file with compiled functions: they call each other."""
SOURCES_DIGEST = hashlib.sha256(
    b"".join((Path(__file__).parent / name).read_bytes() for name in COMPILED_SOURCES)
).hexdigest()[:12]


def cached_njit(function: Callable[..., Any]) -> Any:
    """``function``, compiled when first called.

    Numba's cache only notices changes of the file that a function is in, not of those whose functions it calls.
    What it keeps is found by name, so the name says what all of them were.
    """
    function.__qualname__ += f"_{SOURCES_DIGEST}"
    return numba.njit(cache=True)(function)
