"""Consoles of the commands: results go to stdout, progress and remarks to stderr."""

import os
import sys
import textwrap
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, Protocol

import click
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import Progress
from rich.segment import Segment

from klute_sim.errors import make_printable

NON_TERMINAL_WIDTH_CHARS = 110
"""Width of tables where no terminal sets it [characters]."""
LOG_INTERVAL_S = 30.0
"""Time between two lines of progress in a log [s]; shorter commands write none."""


class _Console(Console):
    """On a terminal, wraps lines printed with ``soft_wrap`` between words; the terminal would break words.

    Elsewhere lines stay whole for programs that read them. A word, such as a path, is never broken. Control characters
    in the text, which come from names in files, are replaced.
    """

    def print(self, *objects: Any, **options: Any) -> None:
        """Print ``objects``, wrapped between words on a terminal."""
        if options.get("soft_wrap") and self.is_terminal:
            objects = tuple(_wrap_lines(item, self.width) if isinstance(item, str) else item for item in objects)
        super().print(*objects, **options)

    def on_broken_pipe(self) -> None:
        """Leave the error, which is being handled, to the command line; the method replaced here exits with code 1."""
        raise

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Yield the segments of ``renderable``; all output passes through here, before rich adds its own controls."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=make_printable(segment.text))


def write_text(text: str) -> None:
    """Write ``text`` to stdout: exactly, for files and programs, but without control characters on a terminal."""
    click.echo(make_printable(text) if sys.stdout.isatty() else text, nl=False)


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
    """Return the console for results; without a terminal it is wide enough for every table."""
    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else NON_TERMINAL_WIDTH_CHARS
    return _Console(width=width, highlight=False, markup=False, emoji=False)  # names and paths may contain markup


@cache
def stderr_console() -> Console:
    """Return the console for remarks and progress."""
    return _Console(stderr=True, highlight=False, markup=False, emoji=False)


class ProgressBar(Protocol):
    """A :data:`klute_sim.types.ProgressCallback` whose second argument may be left out."""

    def __call__(self, fraction: float, stage: str = ..., /) -> None:
        """Show the completed ``fraction`` and the current ``stage``."""


class ProgressLog:
    """A progress callback for a file in place of a terminal: one line for every :data:`LOG_INTERVAL_S`."""

    def __init__(self) -> None:
        """Begin to count the time."""
        self._start = self._last = time.monotonic()

    def __call__(self, fraction: float, stage: str, /) -> None:
        """Print the time since the start and the ``stage``, unless the last line is younger than the interval."""
        now = time.monotonic()
        if now - self._last >= LOG_INTERVAL_S:
            self._last = now
            stderr_console().print(f"{now - self._start:.0f} s: {stage}", soft_wrap=True)


@contextmanager
def progress_bar(description: str) -> Iterator[ProgressBar]:
    """Yield a progress callback that draws a bar on a terminal, which disappears at the end, or writes a log."""
    if not stderr_console().is_terminal:
        log = ProgressLog()

        def write(fraction: float, stage: str = description, /) -> None:
            log(fraction, f"{stage}, {100.0 * fraction:.0f} %")

        yield write
        return
    with Progress(console=stderr_console(), transient=True) as progress:
        task = progress.add_task(description, total=1.0)

        def update(fraction: float, stage: str = description, /) -> None:
            progress.update(task, completed=fraction, description=stage)

        yield update
