"""What commands print with: results on stdout, progress and remarks on stderr."""

import os
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from rich.console import Console
from rich.progress import Progress


class _Console(Console):
    """On a terminal, breaks lines printed with ``soft_wrap`` between words; the terminal would break them inside words.

    Elsewhere they stay whole, for what reads them; a word, such as a path, is never broken.
    """

    def print(self, *objects: Any, **options: Any) -> None:
        """See :class:`rich.console.Console`."""
        if options.get("soft_wrap") and self.is_terminal:
            objects = tuple(_wrap_lines(one, self.width) if isinstance(one, str) else one for one in objects)
        super().print(*objects, **options)


def _wrap_lines(text: str, width: int) -> str:
    lines = []
    for line in text.split("\n"):
        indent = line[: len(line) - len(line.lstrip())]
        lines.append(
            textwrap.fill(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
        )
    return "\n".join(lines)


@cache
def stdout_console() -> Console:
    """For results; wide enough for every stride where nobody's terminal sets the width."""
    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else 110
    return _Console(width=width, highlight=False, markup=False, emoji=False)  # names and paths are the user's own


@cache
def stderr_console() -> Console:
    """For remarks that are no result."""
    return _Console(stderr=True, highlight=False, markup=False, emoji=False)


@contextmanager
def progress_bar(description: str) -> Iterator[Callable[[float], None]]:
    """A bar on stderr, where that is a terminal, told the finished fraction; gone when done."""
    with Progress(console=stderr_console(), transient=True, disable=not stderr_console().is_terminal) as progress:
        task = progress.add_task(description, total=1.0)
        yield lambda fraction: progress.update(task, completed=fraction)
