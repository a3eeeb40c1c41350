"""Published items, computed findings and their assessment.

The published items are data (``printed.toml``). The chapters compute findings without access to the published numbers,
so every verdict follows from both alone.
"""

from typing import Literal, NamedTuple

Verdict = Literal["agrees", "contradicts-source", "source-contradicts-itself", "not-printed"]
VERDICTS: tuple[Verdict, ...] = ("agrees", "contradicts-source", "source-contradicts-itself", "not-printed")


class PublishedItem(NamedTuple):
    """One published number or statement."""

    id: str
    """Identifier of table and item, such as ``table-2.1.frog.k1``."""
    table_title: str
    """Title of the table or figure that contains the item."""
    quantity: str
    """Name of the quantity."""
    unit: str
    """Unit of the quantity."""
    published: float | str | None
    """Published number, or a statement that holds or does not; None where the page is missing."""
    tolerance: float
    """Allowed difference of the computed number, relative to the published one, or absolute where that is 0."""
    contradiction: str
    """Contradicting evidence in the source; empty without any."""
    note: str
    """Remark on the item."""
    is_measured: bool
    """Whether the source measured the item on an actuator."""
    is_input: bool
    """Whether the model takes the value from the source, so that it necessarily agrees."""


class Outcome(NamedTuple):
    """Computed value or statement of an item."""

    value: float | None = None
    """Computed number; None where nothing can be computed because the data of the experiment are not printed."""
    holds: bool | None = None
    """Whether a statement holds; None for a number."""
    note: str = ""
    """Meaning of the number where the item does not explain it."""


class ItemAssessment(NamedTuple):
    """A published item, its finding and the verdict."""

    item: PublishedItem
    """Published item."""
    finding: Outcome
    """Computed finding."""
    verdict: Verdict
    """Verdict on the item."""

    @property
    def difference(self) -> float | None:
        """Return the computed less the published number, relative unless the latter is 0 or a percentage.

        None without two numbers.
        """
        published = self.item.published
        if self.finding.value is None or not isinstance(published, float):
            return None
        difference = self.finding.value - published
        return difference / abs(published) if self.is_relative else difference

    @property
    def is_relative(self) -> bool:
        """Return whether the difference is relative to the published number."""
        return bool(self.item.published) and self.item.unit != "%"

    @property
    def note(self) -> str:
        """Return the remarks on item, finding and verdict."""
        contradiction = self.item.contradiction if self.verdict == "source-contradicts-itself" else ""
        return " ".join(filter(None, [self.item.note, self.finding.note, contradiction]))


def assess(item: PublishedItem, finding: Outcome, implied: float | bool | None = None) -> ItemAssessment:
    """Return the verdict on ``item``: a number agrees within its tolerance, a statement agrees if it holds.

    ``implied`` is the value that other printed numbers of the source imply for the item. The source contradicts itself
    where it has contradicting evidence that, if it can be computed, agrees with the finding, or where it makes a
    statement false that the finding supports. Any other disagreement contradicts the source. Items that are not printed
    or cannot be computed are ``not-printed``.
    """
    if isinstance(item.published, str):
        if finding.holds is None:
            return ItemAssessment(item, finding, "not-printed")
        if finding.holds and implied is not False:
            return ItemAssessment(item, finding, "agrees")
        is_self_contradiction = bool(item.contradiction) and implied is not True
    elif item.published is None or finding.value is None:
        return ItemAssessment(item, finding, "not-printed")
    else:
        tolerance = item.tolerance * (abs(item.published) or 1.0) * (1.0 + 1e-9)
        if abs(finding.value - item.published) <= tolerance:
            return ItemAssessment(item, finding, "agrees")
        is_self_contradiction = bool(item.contradiction) and (
            implied is None or abs(finding.value - implied) <= tolerance
        )
    return ItemAssessment(item, finding, "source-contradicts-itself" if is_self_contradiction else "contradicts-source")
