"""Select the backend of the device model: compiled, or the same source as plain Python."""

import warnings
from collections.abc import Callable
from functools import cache

from klute_sim.errors import InputError, KluteSimWarning

BACKENDS = ("auto", "compiled", "python")
"""Backends that a caller can request; *auto* is *compiled* where that is available."""


def select_backend(backend: str, find_incompatibility: Callable[[], str]) -> str:
    """Return ``"compiled"`` or ``"python"`` for the requested ``backend``.

    ``find_incompatibility`` returns the reason why the compiled backend is not available, or ''.

    Warns (KluteSimWarning) when *auto* falls back to Python. Raises InputError for an unknown backend, or when
    ``"compiled"`` is requested but not available.
    """
    if backend not in BACKENDS:
        raise InputError(f"backend is '{backend}'; allowed: {', '.join(BACKENDS)}")
    if backend == "python":
        return backend
    reason = find_incompatibility()
    if not reason:
        return "compiled"
    if backend == "compiled":
        raise InputError(f"the compiled backend is not available: {reason}; the backend 'python' runs without it")
    warnings.warn(f"{reason}: the python backend runs instead, which is slower", KluteSimWarning, stacklevel=3)
    return "python"


@cache
def explain_missing_compiler() -> str:
    """Return the reason why numba cannot be imported, or ''."""
    try:
        import numba  # noqa: F401
    except ImportError as error:
        return f"numba cannot be imported ({error})"
    return ""
