"""Line wrapping of sentences on a terminal and elsewhere."""

import io

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
