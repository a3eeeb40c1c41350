"""Control characters in files, names and paths never reach a terminal."""

import io
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

from klute_sim import cli
from klute_sim.cli import console as cli_console
from klute_sim.device.device import load_device, parse_device
from klute_sim.errors import InputError, KluteSimWarning, make_printable

EVIL = "a\x1b]0;title\x07\x1b[31mred\x9b2J\u202egnp\u2066x"


def is_safe(text: str) -> bool:
    return all(letter.isprintable() or letter in "\n\t" for letter in text)


def test_control_characters_are_replaced_and_other_text_is_kept() -> None:
    assert is_safe(make_printable(EVIL))
    assert make_printable("Å µ·m 腱\n\tx") == "Å µ·m 腱\n\tx"
    assert make_printable("a\rb\x00c") == "a\N{REPLACEMENT CHARACTER}b\N{REPLACEMENT CHARACTER}c"
    assert is_safe(str(InputError(EVIL)))


def test_console_replaces_control_characters_but_keeps_its_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    output = io.StringIO()
    console = cli_console._Console(file=output, force_terminal=True, width=80, color_system="standard", markup=False)
    table = Table(title=EVIL)
    table.add_column(EVIL)
    table.add_row(EVIL, style="red")
    for item in (EVIL, table):
        console.print(item, soft_wrap=isinstance(item, str))
    text = output.getvalue()
    assert "\x1b[31m" in text  # the colour of the row
    for code in ("\x1b]", "\x07", "\x9b", "\u202e", "\u2066"):
        assert code not in text
    assert isinstance(console, Console)


def test_warnings_are_printable(capsys: pytest.CaptureFixture[str]) -> None:
    cli._show_warning(KluteSimWarning(EVIL))
    assert is_safe(capsys.readouterr().err)


def test_device_name_is_one_line_of_printable_text() -> None:
    content = load_device("klute-3-4").content.decode()
    for name, message in (
        ('"a\\u001b[31m"', r"'name' contains the control character U\+001B; allowed: printable text"),
        ('"a\\u202e"', r"'name' contains the control character U\+202E"),
        ('"a\\nb"', r"'a\\nb' is refused; allowed: a name on one line of printable text"),
    ):
        with pytest.raises(InputError, match=message):
            parse_device(content.replace('"klute-3-4"', name).encode(), "x.toml")


@pytest.mark.slow
def test_files_are_shown_exactly_in_pipes_and_safely_on_terminals(tmp_path: Path) -> None:
    content = load_device("klute-3-4").content + "# \u202e\n".encode()
    (tmp_path / "x.toml").write_bytes(content)
    command = [sys.executable, "-m", "klute_sim", "device", str(tmp_path / "x.toml"), "--toml"]
    assert subprocess.run(command, capture_output=True, check=True).stdout == content
    leader, follower = pty.openpty()
    try:
        subprocess.run(command, stdout=follower, check=True)
        shown = os.read(leader, 1_000_000)
    finally:
        os.close(leader)
        os.close(follower)
    assert b"name = " in shown
    assert "\u202e".encode() not in shown
