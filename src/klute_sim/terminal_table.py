"""Tables of the terminal, all in one style."""

from collections.abc import Sequence
from typing import Any

from rich import box
from rich.table import Column, Table
from rich.text import Text

MAX_NAMES = 4
"""Maximum number of names that a sentence lists."""


def create_table(*headings: str, title: str = "", **options: Any) -> Table:
    """Return an empty table in the style of all tables: a line below the headings, no frame, the title at the left.

    ``headings`` are those of columns of text; others are added with ``add_column``. ``title`` is plain text: brackets
    in names are no markup. ``options`` are further options of :class:`rich.table.Table`.
    """
    return Table(
        *(Column(heading, overflow="fold") for heading in headings),  # a name without its end is no name
        title=Text(title) if title else None,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
        **options,
    )


def abbreviate(names: Sequence[str]) -> str:
    """Return ``names`` as an enumeration, of which the last are only counted if there are many."""
    n_omitted = len(names) - MAX_NAMES
    return ", ".join(names[:MAX_NAMES]) + (f" and {n_omitted} more" if n_omitted > 0 else "")
