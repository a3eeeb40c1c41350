"""Tab completion of names, and the sections and width of the help."""

from collections.abc import Iterator

import click
import pytest
from click.shell_completion import BashComplete

from klute_sim.bench.protocols.library import list_protocols
from klute_sim.cli import COMMANDS, HELP_SECTIONS, group
from klute_sim.device.device import list_presets
from klute_sim.effects.catalogue import get_effects
from tests.command_line import run


def complete(words: str) -> list[str]:
    """Return what the shell offers for the last of ``words``."""
    *before, incomplete = words.split(" ")
    shell = BashComplete(group, {}, "klute-sim", "_KLUTE_SIM_COMPLETE")
    return [item.value for item in shell.get_completions(before, incomplete) if item.type != "file"]


@pytest.mark.parametrize("command", ["gait --device", "walk --device", "device", "sweep --device", "plan"])
def test_devices_are_completed(command: str) -> None:
    assert complete(f"{command} klute-1-1") == [name for name in list_presets() if name.startswith("klute-1-1")]
    assert complete(f"{command} no-such") == []


def test_effects_protocols_and_scenes_are_completed() -> None:
    seals = [name for name in get_effects() if name.startswith("seal")]
    assert seals
    assert complete("effects seal") == complete("diagnose data --only seal") == seals
    assert complete("bench iso") == [name for name in list_protocols() if name.startswith("iso")]
    assert complete("bench isometric klute-3-4-p") == ["klute-3-4-pair"]
    assert complete("plan klute-3-4-pair --only ramp") == ["ramps"]
    assert complete("play w") == ["walk"]
    assert complete("ga") == ["gait"]


def test_help_has_every_command_in_one_section() -> None:
    text = run("--help").stdout
    for title, commands in HELP_SECTIONS.items():
        assert f"\n{title}:\n" in text
        for name in commands:
            assert text.count(f"\n  {name} ") == 1, name
    assert sum(len(commands) for commands in HELP_SECTIONS.values()) == len(COMMANDS)


def list_helps(command: click.Command, context: click.Context) -> Iterator[tuple[str, str]]:
    """Yield path and help of ``command`` and of all its subcommands, for a terminal of 80 columns."""
    yield context.command_path, command.get_help(context)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            subcommand = command.get_command(context, name)
            assert subcommand is not None
            yield from list_helps(subcommand, click.Context(subcommand, context, name))


def test_help_of_every_command_fits_into_80_columns() -> None:
    helps = dict(list_helps(group, click.Context(group, info_name="klute-sim", terminal_width=80)))
    assert {f"klute-sim {name}" for name in COMMANDS} < set(helps)
    long_lines = {path: [line for line in text.splitlines() if len(line) > 80] for path, text in helps.items()}
    assert {path: lines for path, lines in long_lines.items() if lines} == {}
