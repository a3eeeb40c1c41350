"""Remarks on a comparison for the user, without repetitions."""

from collections.abc import Iterable, Sequence

MAX_LISTED_NAMES = 8
"""Largest number of names that a sentence lists."""


class Remarks:
    """Ordered set of sentences."""

    def __init__(self, sentences: Iterable[str] = ()) -> None:
        """Start with ``sentences``."""
        self._sentences = dict.fromkeys(sentences)

    def add(self, sentence: str) -> None:
        """Add ``sentence``; repetitions are ignored."""
        self._sentences[sentence] = None

    @property
    def sentences(self) -> tuple[str, ...]:
        """All sentences in the order in which they were added."""
        return tuple(self._sentences)


def format_names(names: Sequence[str]) -> str:
    """Return ``names`` separated by commas; names beyond :data:`MAX_LISTED_NAMES` are counted."""
    n_unlisted = len(names) - MAX_LISTED_NAMES
    return ", ".join(names[:MAX_LISTED_NAMES]) + (f" and {n_unlisted} more" if n_unlisted > 0 else "")
