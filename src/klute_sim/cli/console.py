"""What commands print with: results on stdout, progress and remarks on stderr."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

from rich.console import Console
from rich.progress import Progress


@cache
def console() -> Console:
    """For results; wide enough for every stride where nobody's terminal sets the width."""
    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 110
    return Console(width=width, highlight=False, markup=False, emoji=False)  # names and paths are the user's own


@cache
def notes() -> Console:
    """For remarks that are no result."""
    return Console(stderr=True, highlight=False, markup=False, emoji=False)


@contextmanager
def progress_bar(doing: str) -> Iterator[Callable[[float], None]]:
    """A bar on stderr, where that is a terminal, told the finished fraction; gone when done."""
    with Progress(console=notes(), transient=True, disable=not notes().is_terminal) as progress:
        task = progress.add_task(doing, total=1.0)
        yield lambda fraction: progress.update(task, completed=fraction)
