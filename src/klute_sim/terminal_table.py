"""Tables of the terminal, all in one style."""

from typing import Any

from rich import box
from rich.table import Column, Table
from rich.text import Text


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
