"""What commands print with: results on stdout, progress and remarks on stderr."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

from rich.console import Console
from rich.progress import Progress


@cache
def console() -> Console:
    """For results; wide enough for every stride where nobody's terminal sets the width."""
    screen = Console(highlight=False)
    return screen if screen.is_terminal or "COLUMNS" in os.environ else Console(highlight=False, width=110)


@cache
def notes() -> Console:
    """For remarks that are no result."""
    return Console(stderr=True, highlight=False)


@contextmanager
def progress_bar(doing: str) -> Iterator[Callable[[float], None]]:
    """A bar on stderr, where that is a terminal, told the finished fraction; gone when done."""
    with Progress(console=notes(), transient=True, disable=not notes().is_terminal) as progress:
        task = progress.add_task(doing, total=1.0)
        yield lambda fraction: progress.update(task, completed=fraction)
