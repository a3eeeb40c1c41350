"""Exceptions of the package: a mistake of a user ends in one sentence with place, cause and allowed values."""

import difflib
import re
from collections.abc import Iterable

MAX_WORD_LENGTH = 300
"""Maximum number of letters of one word in a message; a path is shorter, the content of a damaged file is not."""
MAX_MESSAGE_LENGTH = 1500
"""Maximum number of letters of a message."""

MAX_LISTED_NAMES = 12
"""Maximum number of names that a message lists."""


class KluteSimError(Exception):
    """Base of all errors that this package raises on purpose; the message is one sentence for the user.

    Messages quote files and other libraries. A quotation is therefore put on one line and shortened.
    """

    def __str__(self) -> str:
        """Return the sentence."""
        text = "".join(" " if letter.isspace() else letter for letter in super().__str__())
        text = make_printable(text)
        text = re.sub(rf"\S{{{MAX_WORD_LENGTH},}}", lambda match: _truncate_middle(match[0], MAX_WORD_LENGTH), text)
        return _truncate_middle(text.strip(), MAX_MESSAGE_LENGTH)


def make_printable(text: str) -> str:
    """Return ``text`` with a replacement character for each control character, except for line ends and tabs.

    Text from files, such as names and paths, reaches terminals through this function only: control characters would
    move the cursor, change colours and titles, or turn the direction of writing.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() or letter in "\n\t" else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


def _truncate_middle(text: str, max_length: int) -> str:
    """Return ``text`` without its middle if it is longer than ``max_length`` letters."""
    return text if len(text) <= max_length else f"{text[: max_length // 2]} ... {text[-max_length // 4 :]}"


def suggest(name: str, candidates: Iterable[str], hint: str) -> str:
    """Return ``hint``, preceded by ``did you mean ...?`` if one of ``candidates`` resembles ``name``."""
    matches = difflib.get_close_matches(name, list(candidates), 1)
    return f"did you mean '{matches[0]}'? {hint[:1].upper()}{hint[1:]}" if matches else hint


def suggest_from(name: str, candidates: Iterable[str], pointer: str) -> str:
    """Return what is allowed instead of ``name``: all ``candidates`` if they are few, or the nearest and ``pointer``.

    ``pointer`` says where all are listed.
    """
    allowed = list(candidates)
    if len(allowed) <= MAX_LISTED_NAMES:
        return suggest(name, allowed, f"allowed: {', '.join(allowed)}")
    nearest = [f"'{match}'" for match in difflib.get_close_matches(name, allowed, 3)]
    # The last part, such as a number of another element, matters most.
    ending = re.split(r"[./]", name)[-1]
    nearest = nearest or [f"'{candidate}'" for candidate in allowed if ending and candidate.endswith(ending)][:3]
    if not nearest:
        return f"allowed: {len(allowed)} names such as '{allowed[0]}'; {pointer}"
    return f"did you mean {', '.join(nearest[:-1])}{' or ' if len(nearest) > 1 else ''}{nearest[-1]}? {pointer}"


class InputError(KluteSimError):
    """A value, key, column or file of the user is not valid."""


class MissingExtraError(KluteSimError):
    """A requested feature needs an optional dependency that is not installed."""

    def __init__(self, feature: str, extra: str, advice: str = "") -> None:
        """Report that ``feature`` needs the optional ``extra``, and how to install it; ``advice`` ends the sentence."""
        super().__init__(
            f"{feature} needs the optional extra '{extra}': pip install '.[{extra}]' in the project's folder{advice}"
        )


class SimulationError(KluteSimError):
    """A simulation left the range in which its results are meaningful (NaN, divergence)."""


class KluteSimWarning(UserWarning):
    """Something works, but less well than it could."""
