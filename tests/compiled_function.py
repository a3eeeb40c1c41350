"""Calls of compiled laws from Python: the package compiles them for calls from compiled code only."""

from collections.abc import Callable
from typing import Any

import numba


def make_callable(function: Any) -> Callable[..., Any]:
    """Return a compiled function that calls the compiled ``function`` and can be called from Python."""
    caller: Callable[..., Any] = numba.njit(lambda *arguments: function(*arguments), error_model="numpy")
    return caller
