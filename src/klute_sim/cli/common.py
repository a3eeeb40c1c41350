"""Options that several commands have, each said once."""

from collections.abc import Callable
from typing import Any

import click

from klute_sim.cli.given_path import GivenPath


class Number(click.types.FloatParamType):
    """A number; what is not one is refused with the unit that is meant."""

    def __init__(self, unit: str = "") -> None:
        """In ``unit``; '' where there is none."""
        self.unit = unit

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number that ``value`` is."""
        try:
            return float(value)
        except ValueError:
            mend = f"; write the number alone, in {self.unit}" if self.unit else ""
            self.fail(f"'{value}' is not a number{mend}", param, ctx)


Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

DEVICE = click.option(
    "--device",
    "device_name",
    default=None,
    metavar="NAME|FILE",
    help="Preset or device file.  [default: klute-1-1-4-pair]",
)
STEP = click.option(
    "--step", "step_ms", type=Number("ms"), default=0.5, show_default=True, metavar="MS", help="Time step [ms]."
)
MASS = click.option("--mass", type=Number("kg"), default=75.0, show_default=True, metavar="KG", help="Body mass [kg].")


def _no_height(context: click.Context, option: click.Parameter, given: str | None) -> None:
    if given is not None:
        raise click.UsageError("there is no option --height; how tall somebody is goes with --stature")


NO_HEIGHT = click.option("--height", hidden=True, expose_value=False, callback=_no_height)
"""For who looks for ``--stature`` under another name."""
CATALOGUE = click.option(
    "--catalogue",
    type=GivenPath(),
    default=None,
    metavar="FILE",
    help="Python file with effects of your own, EFFECTS = [...]. The file is run: use only what you trust.",
)


def out(kind: str, what: str) -> Decorator:
    """``--out`` of a command whose folder appears whole: by default the next ``runs/KIND-NNN``."""
    text = f"New or empty folder for {what}.  [default: runs/{kind}-NNN]"
    return click.option("--out", type=GivenPath(), default=None, metavar="FOLDER", help=text)


def growing(kind: str, what: str) -> Decorator:
    """``--out`` of a command whose folder grows, so that it can be interrupted."""
    text = f"Folder for {what}; one that was begun there by the same command goes on.  [default: runs/{kind}-NNN]"
    return click.option("--out", type=GivenPath(), default=None, metavar="FOLDER", help=text)


def as_json(instead_of: str = "the table") -> Decorator:
    """``--json``."""
    return click.option("--json", "as_json", is_flag=True, help=f"Print one JSON object instead of {instead_of}.")


def strides(whose: str) -> Decorator:
    """``--strides``."""
    return click.option("--strides", type=int, default=5, show_default=True, help=f"{whose}.")


def jobs(words: str = "Processes.  [default: 0, one per core]", *, default: int | None = 0) -> Decorator:
    """``--jobs``; a ``default`` of None tells whether it was given."""
    return click.option("--jobs", type=click.IntRange(0, 256), default=default, metavar="N", help=words)
