"""What the user should know beside the numbers, each sentence once."""

from collections.abc import Iterable, Sequence

MOST_NAMES = 8
"""Names listed before the rest are counted."""


class Remarks:
    """Sentences in the order in which they were first said."""

    def __init__(self, said: Iterable[str] = ()) -> None:
        """Begin with what was ``said``."""
        self._said = dict.fromkeys(said)

    def add(self, sentence: str) -> None:
        """Say ``sentence``, if it was not said."""
        self._said[sentence] = None

    @property
    def said(self) -> tuple[str, ...]:
        """All of them."""
        return tuple(self._said)


def listed(names: Sequence[str]) -> str:
    """``names`` with commas, the last of many counted."""
    rest = len(names) - MOST_NAMES
    return ", ".join(names[:MOST_NAMES]) + (f" and {rest} more" if rest > 0 else "")
