"""Sections of the options in the help of a command.

``section`` stands as a heading above the decorators of its options::

    @click.command("gait", cls=Command)
    @section("Model")
    @common.DEVICE_OPTION
    @section("Output")
    @common.json_option()
"""

from collections.abc import Callable
from typing import Any, Literal

import click

SectionTitle = Literal[
    "Input",
    "Processing",
    "Model",
    "Muscle",
    "Actuator",
    "Damper and tendon",
    "Subject",
    "Conditions",
    "Simulation",
    "Comparison",
    "Fit",
    "Dataset",
    "Objective",
    "Search",
    "Training",
    "Output",
]
"""Titles that commands use, so that the same kind of option has the same heading everywhere."""
HELP_TITLE: SectionTitle = "Output"
"""Section of ``--help``."""
MAX_OPTION_CHARS = 30
"""Width to which options are padded, so that the descriptions of all sections begin in one column [characters]."""


def section(title: SectionTitle) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Put the options of the decorators below this one, up to the next heading, under ``title``."""

    def assign(function: Callable[..., Any]) -> Callable[..., Any]:
        titles = function.__dict__.setdefault("section_titles", {})
        for parameter in function.__dict__["__click_params__"]:  # click collects them here, from the last to the first
            titles.setdefault(parameter.name, title)
        return function

    return assign


class Command(click.Command):
    """A command whose help shows the options in sections; options of equal titles are one section."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the sections."""
        titles = self.callback.__dict__["section_titles"]
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and isinstance(parameter, click.Option):
                sections.setdefault(titles.get(parameter.name, HELP_TITLE), []).append(record)
        longest = max(len(option) for records in sections.values() for option, _ in records)
        width = min(longest, MAX_OPTION_CHARS)
        for title, records in sections.items():
            with formatter.section(title):
                formatter.write_dl([(option.ljust(width), text) for option, text in records])


class Group(Command, click.Group):
    """A command with options and with commands of its own."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the sections, then the commands."""
        Command.format_options(self, ctx, formatter)
        self.format_commands(ctx, formatter)
