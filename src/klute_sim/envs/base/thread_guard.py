"""Refusal of simultaneous use: MuJoCo does not protect a simulation from a second thread and would end the process."""

import threading
from typing import Any

from klute_sim.envs.base.errors import ConcurrentUseError


class ThreadGuard:
    """Context that one thread at a time can enter; a copy guards another object and is free."""

    def __init__(self) -> None:
        """Create a free guard."""
        self._lock = threading.Lock()

    def __enter__(self) -> None:
        """Enter; raises ConcurrentUseError at once when the guard is taken, because waiting would hide the mistake."""
        if not self._lock.acquire(blocking=False):
            raise ConcurrentUseError(
                "the environment is used by two threads at the same time; give each thread its own, from "
                "gymnasium.make or copy.deepcopy"
            )

    def __exit__(self, *exception: object) -> None:
        """Leave."""
        self._lock.release()

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how to create the guard of a copy."""
        return ThreadGuard, ()
