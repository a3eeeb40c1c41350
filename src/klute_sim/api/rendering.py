"""Render the summary of a result (rich tables and sentences) as text, as HTML, or on a console."""

import io
from abc import ABC, abstractmethod
from collections.abc import Iterable
from html import escape
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
        return render_html(self.format_summary())


def render_text(summary: Summary, width: int = TEXT_WIDTH_CHARS) -> str:
    """Return ``summary`` as plain text of at most ``width`` characters per table row; sentences stay on one line."""
    buffer = io.StringIO()
    print_summary(Console(file=buffer, width=width, highlight=False, markup=False, emoji=False), summary)
    return buffer.getvalue().rstrip("\n")


def print_summary(console: Console, summary: Summary) -> None:
    """Print ``summary`` on ``console``."""
    for item in summary:
        console.print(item, soft_wrap=isinstance(item, str))


def render_html(summary: Summary) -> str:
    """Return ``summary`` as HTML for a notebook."""
    return f"<pre>{escape(render_text(summary))}</pre>"
