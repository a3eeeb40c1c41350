"""The help shows the options of a command in sections."""

from collections.abc import Iterator

import click
import pytest

from klute_sim.cli import COMMANDS, bench_joint, group
from klute_sim.cli.option_sections import Command, Group, section

MAX_FLAT_OPTIONS = 6
"""Largest number of options that need no sections."""


def list_commands() -> Iterator[click.Command]:
    yield bench_joint.command
    for name in COMMANDS:
        command = group.get_command(click.Context(group), name)
        assert command is not None
        yield command
        if isinstance(command, click.Group):
            yield from command.commands.values()


def list_options(command: click.Command) -> list[click.Option]:
    return [p for p in command.params if isinstance(p, click.Option) and not p.hidden]


@pytest.mark.parametrize("command", [*list_commands()], ids=lambda command: command.name)
def test_many_options_are_in_sections(command: click.Command) -> None:
    options = list_options(command)
    if not isinstance(command, Command):
        assert len(options) <= MAX_FLAT_OPTIONS
        return
    titles = command.callback.__dict__["section_titles"]
    assert {option.name for option in options} <= set(titles)
    shown = [
        line[:-1] for line in command.get_help(click.Context(command)).splitlines() if line[:-1] in titles.values()
    ]
    assert shown == list(dict.fromkeys(titles[option.name] for option in options))
    assert shown[-1] == "Output"
    assert len(shown) > 1


def test_descriptions_of_all_sections_begin_in_one_column() -> None:
    @click.group("try", cls=Group, invoke_without_command=True)
    @click.argument("name", metavar="NAME")
    @section("Model")
    @click.option("--x", is_flag=True, help="First.")
    @section("Output")
    @click.option("--longer", is_flag=True, help="Second.")
    @section("Model")
    @click.option("--y", is_flag=True, help="Third.")
    def command(name: str, x: bool, longer: bool, y: bool) -> None:
        """Do nothing."""

    @command.command("more")
    def more() -> None:
        """Do more."""

    text = command.get_help(click.Context(command))
    assert text.endswith(
        "Model:\n"
        "  --x       First.\n"
        "  --y       Third.\n\n"
        "Output:\n"
        "  --longer  Second.\n"
        "  --help    Show this message and exit.\n\n"
        "Commands:\n"
        "  more  Do more."
    )
