"""What commands print with: results on stdout, progress and remarks on stderr."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

from rich.console import Console
from rich.progress import Progress


@cache
def console() -> Console:
    """For results."""
    return Console(highlight=False)


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
