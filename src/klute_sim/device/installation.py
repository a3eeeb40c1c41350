"""Which installation of the law runs: compiled, or the same source as plain Python."""

import warnings
from collections.abc import Callable

from klute_sim.errors import InputError, KluteSimWarning

LAWS = ("auto", "compiled", "python")
"""What can be asked for; *auto* is compiled where that is possible."""


def choose(law: str, obstacle: Callable[[], str]) -> str:
    """``compiled`` or ``python``, as asked for and possible; ``obstacle`` says why compiled is not, or ''.

    Warns (KluteSimWarning) when *auto* has to be ``python``; raises InputError when ``compiled`` is impossible.
    """
    if law not in LAWS:
        raise InputError(f"law is '{law}'; allowed: {', '.join(LAWS)}")
    if law == "python":
        return law
    reason = obstacle()
    if not reason:
        return "compiled"
    if law == "compiled":
        raise InputError(f"there is no compiled law: {reason}; the law 'python' runs without")
    warnings.warn(f"{reason}: the law runs as Python, which is slower", KluteSimWarning, stacklevel=3)
    return "python"
