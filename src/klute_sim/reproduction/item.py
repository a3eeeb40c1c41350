"""What the source prints of one thing, what was computed of it, and the verdict.

The list of what is printed is data (``printed.toml``). Chapters compute; nothing in them knows what was printed, and no
verdict is written down anywhere: it follows from both.
"""

from typing import Literal, NamedTuple

Verdict = Literal["agrees", "contradicts-source", "source-contradicts-itself", "not-printed"]
VERDICTS: tuple[Verdict, ...] = ("agrees", "contradicts-source", "source-contradicts-itself", "not-printed")


class PublishedItem(NamedTuple):
    """One number or statement."""

    id: str
    """Row and name, such as ``table-2.1.frog-k1``."""
    row_title: str
    """Title of the table or figure it belongs to."""
    quantity: str
    unit: str
    published: float | str | None
    """A number; a statement, which holds or does not; None: the page with it is missing."""
    tolerance: float
    """What a computed number may differ by: a share of the published one, or as it is where that is 0."""
    contradiction: str
    """What else in the source speaks against it; '' if nothing does."""
    note: str
    is_measured: bool
    """Whether the source measured it on an actuator."""
    is_input: bool
    """Whether we take it over as it is, so that it cannot but agree."""


class Finding(NamedTuple):
    """What was computed."""

    value: float | None = None
    """None: nothing can be computed, because it is about an experiment whose data are not printed."""
    holds: bool | None = None
    """Whether a statement holds; None for a number."""
    note: str = ""
    """What the number means, where the item alone does not say it."""


class ItemAssessment(NamedTuple):
    """An item, what was found and the verdict."""

    item: PublishedItem
    finding: Finding
    verdict: Verdict

    @property
    def difference(self) -> float | None:
        """Computed less published, over published unless that is 0 or a percentage; None without two numbers."""
        published = self.item.published
        if self.finding.value is None or not isinstance(published, float):
            return None
        apart = self.finding.value - published
        return apart / abs(published) if self.is_relative else apart

    @property
    def is_relative(self) -> bool:
        """Whether the difference is a share of what is published."""
        return bool(self.item.published) and self.item.unit != "%"

    @property
    def note(self) -> str:
        """Everything there is to say beside the numbers."""
        against = self.item.contradiction if self.verdict == "source-contradicts-itself" else ""
        return " ".join(filter(None, [self.item.note, self.finding.note, against]))


def assess(item: PublishedItem, finding: Finding, implied: float | bool | None = None) -> ItemAssessment:
    """The verdict on ``item``: of a number by its distance, of a statement by whether it holds.

    ``implied`` is what the source's other printed numbers make of it, where they make anything. The source contradicts
    itself where something else in it speaks against the item and, if that can be computed, agrees with what we find,
    or makes a statement false that holds for us. What otherwise does not agree contradicts the source; what is not
    printed, or cannot be computed, is ``not-printed``.
    """
    if isinstance(item.published, str):
        if finding.holds is None:
            return ItemAssessment(item, finding, "not-printed")
        if finding.holds and implied is not False:
            return ItemAssessment(item, finding, "agrees")
        own = bool(item.contradiction) and implied is not True
    elif item.published is None or finding.value is None:
        return ItemAssessment(item, finding, "not-printed")
    else:
        room = item.tolerance * (abs(item.published) or 1.0) * (1.0 + 1e-9)
        if abs(finding.value - item.published) <= room:
            return ItemAssessment(item, finding, "agrees")
        own = bool(item.contradiction) and (implied is None or abs(finding.value - implied) <= room)
    return ItemAssessment(item, finding, "source-contradicts-itself" if own else "contradicts-source")
