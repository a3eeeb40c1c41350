"""Parameter types and options that several commands share."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click


class NonEmptyPath(click.Path):
    """A path; the empty string, as from an unset shell variable, is refused instead of naming the current folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return ``value`` as a path."""
        if not str(value):
            self.fail("the path is empty", param, ctx)
        return Path(str(value))


class NumberWithUnit(click.types.FloatParamType):
    """A number; the error for anything else names the unit."""

    def __init__(self, unit: str = "") -> None:
        """Expect a number in ``unit``; an empty string means a pure number."""
        self.unit = unit

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return ``value`` as a number."""
        try:
            return float(value)
        except ValueError:
            hint = f"; write the number alone, in {self.unit}" if self.unit else ""
            self.fail(f"'{value}' is not a number{hint}", param, ctx)


Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

DEVICE_OPTION = click.option(
    "--device",
    "device_name",
    default="klute-1-1-4-pair",
    show_default=True,
    metavar="NAME|FILE",
    help="Device: name of a preset, or a device file.",
)
TIME_STEP_OPTION = click.option(
    "--step",
    "step_ms",
    type=NumberWithUnit("ms"),
    default=0.5,
    show_default=True,
    metavar="MS",
    help="Time step [ms].",
)
MASS_OPTION = click.option(
    "--mass", type=NumberWithUnit("kg"), default=75.0, show_default=True, metavar="KG", help="Body mass [kg]."
)


def _reject_height(context: click.Context, option: click.Parameter, value: str | None) -> None:
    if value is not None:
        raise click.UsageError("there is no option --height; the option for body height is --stature")


REJECT_HEIGHT_OPTION = click.option("--height", hidden=True, expose_value=False, callback=_reject_height)
"""Hidden option that points users who look for ``--height`` to ``--stature``."""
ACCEPT_OPTION = click.option(
    "--accept",
    multiple=True,
    metavar="NAME",
    help="Implausible property of the files that is right, as the error names it; may be repeated.  [default: none]",
)
CATALOGUE_OPTION = click.option(
    "--catalogue",
    type=NonEmptyPath(),
    default=None,
    metavar="FILE",
    help="Python file that registers your own effects. Its code is executed: use only files that you trust.  "
    "[default: the file that the variable KLUTE_SIM_CATALOGUE names]",
)


def out_option(kind: str, content: str) -> Decorator:
    """Return ``--out`` of a command that writes its folder at once; the default is the next ``runs/KIND-NNN``."""
    text = f"New or empty folder for {content}.  [default: runs/{kind}-NNN]"
    return click.option("--out", type=NonEmptyPath(), default=None, metavar="FOLDER", help=text)


def resumable_out_option(kind: str, content: str) -> Decorator:
    """Return ``--out`` of a command that stores results as they finish and can be resumed."""
    text = (
        f"Folder for {content}. After an interrupt, the same command with this folder resumes.  "
        f"[default: runs/{kind}-NNN]"
    )
    return click.option("--out", type=NonEmptyPath(), default=None, metavar="FOLDER", help=text)


def json_option(replaced_output: str = "the table") -> Decorator:
    """Return ``--json``."""
    return click.option("--json", "as_json", is_flag=True, help=f"Print one JSON object instead of {replaced_output}.")


def strides_option(help_text: str) -> Decorator:
    """Return ``--strides``."""
    return click.option("--strides", type=int, default=5, show_default=True, metavar="N", help=f"{help_text}.")


def jobs_option(
    help_text: str = "Number of worker processes; 0: one per core.  [default: 0]", *, default: int | None = 0
) -> Decorator:
    """Return ``--jobs``; with ``default`` None the command can tell whether the option was given."""
    return click.option("--jobs", type=click.IntRange(0, 256), default=default, metavar="N", help=help_text)
