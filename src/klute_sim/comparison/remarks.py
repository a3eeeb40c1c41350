"""What the user should know beside the numbers, each sentence once."""

from collections.abc import Iterable, Sequence

MAX_LISTED_NAMES = 8
"""Names listed before the rest are counted."""


class Remarks:
    """Sentences in the order in which they were first said."""

    def __init__(self, sentences: Iterable[str] = ()) -> None:
        """Begin with what was ``said``."""
        self._sentences = dict.fromkeys(sentences)

    def add(self, sentence: str) -> None:
        """Say ``sentence``, if it was not said."""
        self._sentences[sentence] = None

    @property
    def sentences(self) -> tuple[str, ...]:
        """All of them."""
        return tuple(self._sentences)


def format_names(names: Sequence[str]) -> str:
    """``names`` with commas, the last of many counted."""
    rest = len(names) - MAX_LISTED_NAMES
    return ", ".join(names[:MAX_LISTED_NAMES]) + (f" and {rest} more" if rest > 0 else "")
