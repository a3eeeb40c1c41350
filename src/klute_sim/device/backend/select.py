"""Which installation of the law runs: compiled, or the same source as plain Python."""

import warnings
from collections.abc import Callable

from klute_sim.errors import InputError, KluteSimWarning

BACKENDS = ("auto", "compiled", "python")
"""What can be asked for; *auto* is compiled where that is possible."""


def select_backend(backend: str, find_incompatibility: Callable[[], str]) -> str:
    """``compiled`` or ``python``, as asked for and possible; ``obstacle`` says why compiled is not, or ''.

    Warns (KluteSimWarning) when *auto* has to be ``python``; raises InputError when ``compiled`` is impossible.
    """
    if backend not in BACKENDS:
        raise InputError(f"law is '{backend}'; allowed: {', '.join(BACKENDS)}")
    if backend == "python":
        return backend
    reason = find_incompatibility()
    if not reason:
        return "compiled"
    if backend == "compiled":
        raise InputError(f"there is no compiled law: {reason}; the law 'python' runs without")
    warnings.warn(f"{reason}: the law runs as Python, which is slower", KluteSimWarning, stacklevel=3)
    return "python"
