"""Render the summary of a result (rich tables and sentences) as text or on a console."""

import io
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import TypeAlias

from rich.console import Console
from rich.table import Table

TEXT_WIDTH_CHARS = 110
"""Width of a summary where no terminal sets it [characters]."""

Summary: TypeAlias = Iterable[Table | str]
"""Tables and sentences in the order in which a reader sees them."""


class Printable(ABC):
    """A result that prints its summary, in a terminal and in a notebook."""

    @abstractmethod
    def format_summary(self) -> Summary:
        """Yield the tables and sentences of the summary."""

    def __str__(self) -> str:
        """Return the summary that the terminal shows."""
        return render_text(self.format_summary())

    def _repr_html_(self) -> str:
        from klute_sim.report.run_page import render_summary

        return render_summary(self.format_summary())


def render_text(summary: Summary, width: int = TEXT_WIDTH_CHARS) -> str:
    """Return ``summary`` as plain text of at most ``width`` characters per table row; sentences stay on one line."""
    buffer = io.StringIO()
    # In a notebook, a console of rich displays its output instead of writing it, unless it is told otherwise.
    console = Console(file=buffer, width=width, highlight=False, markup=False, emoji=False, force_jupyter=False)
    print_summary(console, summary)
    return buffer.getvalue().rstrip("\n")


def print_summary(console: Console, summary: Summary) -> None:
    """Print ``summary`` on ``console``."""
    for item in summary:
        console.print(item, soft_wrap=isinstance(item, str))
