"""A path on the command line that is not empty, as it would be from a shell variable that is not set."""

from pathlib import Path
from typing import Any

import click


class NonEmptyPath(click.Path):
    """A path; the empty one is refused instead of meaning the current folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path that ``value`` is."""
        if not str(value):
            self.fail("the path is empty", param, ctx)
        return Path(str(value))
