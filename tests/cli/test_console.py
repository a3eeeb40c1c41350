"""Line wrapping of sentences, and progress, on a terminal and elsewhere."""

import io

import pytest

from klute_sim.cli import console
from klute_sim.cli.console import _Console

SENTENCE = "Some words that are longer than the terminal is wide: /a/path/that/is/longer/than/that.csv"


def print_sentence(*, terminal: bool) -> list[str]:
    file = io.StringIO()
    _Console(file=file, width=20, force_terminal=terminal, color_system=None).print(SENTENCE, soft_wrap=True)
    return file.getvalue().splitlines()


def test_lines_wrap_between_words_on_a_terminal_only() -> None:
    lines = [line.rstrip() for line in print_sentence(terminal=True)]
    assert lines[0] == "Some words that are"
    assert lines[-1] == "/a/path/that/is/longer/than/that.csv"
    assert " ".join(lines) == SENTENCE
    assert print_sentence(terminal=False) == [SENTENCE]


def test_progress_is_logged_where_no_terminal_shows_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    times = iter([0.0, 10.0, 31.0, 40.0, 62.0])
    monkeypatch.setattr(console.time, "monotonic", lambda: next(times))
    console.stderr_console.cache_clear()
    with console.progress_bar("sweeping") as progress:
        for fraction in (0.1, 0.3, 0.4):
            progress(fraction)
        progress(0.6, "writing")
    console.stderr_console.cache_clear()
    assert capsys.readouterr().err.splitlines() == ["31 s: sweeping, 30 %", "62 s: writing, 60 %"]
