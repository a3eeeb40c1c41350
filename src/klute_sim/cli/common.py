"""Options that several commands have, each said once."""

from collections.abc import Callable
from typing import Any

import click

from klute_sim.cli.nonempty_path import NonEmptyPath


class NumberWithUnit(click.types.FloatParamType):
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

DEVICE_OPTION = click.option(
    "--device",
    "device_name",
    default=None,
    metavar="NAME|FILE",
    help="Preset or device file.  [default: klute-1-1-4-pair]",
)
TIME_STEP_OPTION = click.option(
    "--step", "step_ms", type=NumberWithUnit("ms"), default=0.5, show_default=True, metavar="MS", help="Time step [ms]."
)
MASS_OPTION = click.option(
    "--mass", type=NumberWithUnit("kg"), default=75.0, show_default=True, metavar="KG", help="Body mass [kg]."
)


def _reject_height(context: click.Context, option: click.Parameter, value: str | None) -> None:
    if value is not None:
        raise click.UsageError("there is no option --height; how tall somebody is goes with --stature")


REJECT_HEIGHT_OPTION = click.option("--height", hidden=True, expose_value=False, callback=_reject_height)
"""For who looks for ``--stature`` under another name."""
CATALOGUE_OPTION = click.option(
    "--catalogue",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="Python file with effects of your own, EFFECTS = [...]. The file is run: use only what you trust.",
)


def out_option(kind: str, content: str) -> Decorator:
    """``--out`` of a command whose folder appears whole: by default the next ``runs/KIND-NNN``."""
    text = f"New or empty folder for {content}.  [default: runs/{kind}-NNN]"
    return click.option("--out", type=NonEmptyPath(), default=None, metavar="FOLDER", help=text)


def resumable_out_option(kind: str, content: str) -> Decorator:
    """``--out`` of a command whose folder grows, so that it can be interrupted."""
    text = f"Folder for {content}; one that was begun there by the same command goes on.  [default: runs/{kind}-NNN]"
    return click.option("--out", type=NonEmptyPath(), default=None, metavar="FOLDER", help=text)


def json_option(replaced_output: str = "the table") -> Decorator:
    """``--json``."""
    return click.option("--json", "as_json", is_flag=True, help=f"Print one JSON object instead of {replaced_output}.")


def strides_option(help_text: str) -> Decorator:
    """``--strides``."""
    return click.option("--strides", type=int, default=5, show_default=True, help=f"{help_text}.")


def jobs_option(help_text: str = "Processes.  [default: 0, one per core]", *, default: int | None = 0) -> Decorator:
    """``--jobs``; a ``default`` of None tells whether it was given."""
    return click.option("--jobs", type=click.IntRange(0, 256), default=default, metavar="N", help=help_text)
