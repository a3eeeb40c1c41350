"""A note on the terminal that code is compiled: the first run after an installation takes longer than the others."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

NOTICE_DELAY_S = 2.0
"""Time after which a compilation is announced [s]; loading from the cache is faster."""
NOTICE = "klute-sim: compiling the laws; this takes up to a minute, once after an installation or a change."
"""What is written."""


@contextmanager
def announce_slow_compilation() -> Iterator[None]:
    """Write :data:`NOTICE` to a terminal, once per process, if what is inside takes longer than a moment."""
    timer = threading.Timer(NOTICE_DELAY_S, _write_notice)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@cache
def _write_notice() -> None:
    if sys.stderr is not None and sys.stderr.isatty():
        print(NOTICE, file=sys.stderr, flush=True)
