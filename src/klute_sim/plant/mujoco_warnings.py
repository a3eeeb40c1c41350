"""MuJoCo's own warnings, which it prints and writes to ``MUJOCO_LOG.TXT`` in the current folder."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

_lock = threading.Lock()
_n_contexts = 0
"""Number of open :func:`silence_warnings` in all threads."""


@contextmanager
def silence_warnings() -> Iterator[None]:
    """Drop MuJoCo's warnings for the duration, where the caller reads ``data.warning`` and reports them in its words.

    A handler of other code stays in place. Contexts of several threads may overlap.
    """
    global _n_contexts
    with _lock:
        if _n_contexts == 0 and mujoco.get_mju_user_warning() is None:
            mujoco.set_mju_user_warning(_ignore)
        _n_contexts += 1
    try:
        yield
    finally:
        with _lock:
            _n_contexts -= 1
            if _n_contexts == 0 and mujoco.get_mju_user_warning() is _ignore:
                mujoco.set_mju_user_warning(None)


def _ignore(message: str) -> None:
    pass
