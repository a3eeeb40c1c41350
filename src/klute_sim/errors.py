"""The base exception: whatever a user can do wrong ends in one sentence: what, where, what is allowed."""

import difflib
import re
from collections.abc import Iterable

MAX_WORD_LENGTH, MAX_MESSAGE_LENGTH = 300, 1500
"""Letters of a word and of a whole message that are shown; a path is shorter, what a damaged file holds is not."""


class KluteSimError(Exception):
    """Base of all errors this package raises on purpose; its message is one sentence for the user.

    Messages quote files that others made, and libraries: what they bring along stays on one line and within bounds.
    """

    def __str__(self) -> str:
        """The sentence."""
        text = "".join(
            c if c.isprintable() else " " if c.isspace() else "\N{REPLACEMENT CHARACTER}" for c in super().__str__()
        )
        text = re.sub(rf"\S{{{MAX_WORD_LENGTH},}}", lambda word: _truncate_middle(word[0], MAX_WORD_LENGTH), text)
        return _truncate_middle(text.strip(), MAX_MESSAGE_LENGTH)


def _printable(letter: str) -> str:
    return letter if letter.isprintable() else " " if letter.isspace() else "\N{REPLACEMENT CHARACTER}"


def _truncate_middle(text: str, max_length: int) -> str:
    """``text`` without its middle where it is longer than ``longest``."""
    return text if len(text) <= max_length else f"{text[: max_length // 2]} ... {text[-max_length // 4 :]}"


def suggest(name: str, candidates: Iterable[str], hint: str) -> str:
    """``did you mean ...?`` with the ``known`` name that is most like ``name``, if one is, before the ``rest``."""
    found = difflib.get_close_matches(name, list(candidates), 1)
    return f"did you mean '{found[0]}'? {hint[:1].upper()}{hint[1:]}" if found else hint


class InputError(KluteSimError):
    """A value, key, column or file given by the user is not usable."""


class MissingExtraError(KluteSimError):
    """An optional dependency is needed for what was asked and is not installed."""

    def __init__(self, feature: str, extra: str) -> None:
        """``what`` was asked for; ``extra`` would bring it."""
        super().__init__(
            f"{feature} needs the optional extra '{extra}': pip install '.[{extra}]' in the project's folder"
        )


class SimulationError(KluteSimError):
    """A simulation left the region where its result means anything (NaN, divergence)."""


class KluteSimWarning(UserWarning):
    """Something works, but not as well as it could."""
