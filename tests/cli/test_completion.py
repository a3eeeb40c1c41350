"""Tab completion of names, and the sections of the help."""

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
    assert max(map(len, text.splitlines())) <= 90
