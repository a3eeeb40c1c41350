"""What the source prints of one thing, what was computed of it, and the verdict.

The list of what is printed is data (``printed.toml``). Chapters compute; nothing in them knows what was printed, and no
verdict is written down anywhere: it follows from both.
"""

import math
from typing import Literal, NamedTuple

Verdict = Literal["agrees", "contradicts-source", "source-contradicts-itself", "not-printed"]
VERDICTS: tuple[Verdict, ...] = ("agrees", "contradicts-source", "source-contradicts-itself", "not-printed")


class Item(NamedTuple):
    """One number or statement."""

    id: str
    """Row and name, such as ``table-2.1.frog-k1``."""
    row: str
    """Title of the table or figure it belongs to."""
    quantity: str
    unit: str
    published: float | str | None
    """A number; a statement, which holds or does not; None: the page with it is missing."""
    within: float
    """What a computed number may differ by: a share of the published one, or as it is where that is 0."""
    against: str
    """What else in the source speaks against it; '' if nothing does."""
    note: str
    measured: bool
    """Whether the source measured it on an actuator."""


class Found(NamedTuple):
    """What was computed."""

    value: float | None = None
    """None: nothing can be computed, because it is about an experiment whose data are not printed."""
    holds: bool | None = None
    """Whether a statement holds; None for a number."""
    note: str = ""
    """What the number means, where the item alone does not say it."""


class Outcome(NamedTuple):
    """An item, what was found and the verdict."""

    item: Item
    found: Found
    verdict: Verdict

    @property
    def difference(self) -> float | None:
        """Computed less published, over published where that is not 0; None where there are no two numbers."""
        published = self.item.published
        if self.found.value is None or not isinstance(published, float):
            return None
        apart = self.found.value - published
        return apart / abs(published) if published else apart

    @property
    def note(self) -> str:
        """Everything there is to say beside the numbers."""
        against = self.item.against if self.verdict == "source-contradicts-itself" else ""
        return " ".join(filter(None, [self.item.note, self.found.note, against]))


def judge(item: Item, found: Found) -> Outcome:
    """The verdict on ``item``: of a number by its distance, of a statement by whether it holds.

    What does not agree contradicts the source, or shows that the source contradicts itself where another part of the
    source speaks against the item. What is not printed, or cannot be computed, is ``not-printed``.
    """
    if isinstance(item.published, str):
        agrees = found.holds
    elif item.published is None or found.value is None:
        agrees = None
    else:
        room = item.within * (abs(item.published) or 1.0)
        agrees = abs(found.value - item.published) <= room * (1.0 + 1e-9) and math.isfinite(found.value)
    if agrees is None:
        return Outcome(item, found, "not-printed")
    if agrees:
        return Outcome(item, found, "agrees")
    return Outcome(item, found, "source-contradicts-itself" if item.against else "contradicts-source")
