"""Sentences on a terminal."""

import io

from klute_sim.cli.console import _Console

SENTENCE = "Some words that are longer than the terminal is wide: /a/path/that/is/longer/than/that.csv"


def printed(*, terminal: bool) -> list[str]:
    file = io.StringIO()
    _Console(file=file, width=20, force_terminal=terminal, color_system=None).print(SENTENCE, soft_wrap=True)
    return file.getvalue().splitlines()


def test_a_terminal_gets_lines_that_end_between_words_and_a_file_whole_ones() -> None:
    lines = [line.rstrip() for line in printed(terminal=True)]
    assert lines[0] == "Some words that are"
    assert lines[-1] == "/a/path/that/is/longer/than/that.csv"
    assert " ".join(lines) == SENTENCE
    assert printed(terminal=False) == [SENTENCE]
