"""Published items, computed findings and their assessment.

The published items are data (``printed.toml``), with tolerances and limits. The chapters compute findings without them,
so every verdict follows from both alone.
"""

from typing import Literal, NamedTuple

Verdict = Literal["agrees", "contradicts-source", "source-contradicts-itself", "not-printed"]
VERDICTS: tuple[Verdict, ...] = ("agrees", "contradicts-source", "source-contradicts-itself", "not-printed")
ItemKind = Literal["independent", "claim", "round-trip", "input"]
KIND_MEANINGS: dict[ItemKind, str] = {
    "independent": "a printed number that is no input of its computation",
    "claim": "a statement in words, or a definition, checked on the model",
    "round-trip": "a printed constant or form that is put into a law and recovered from it",
    "input": "a number or test condition that is taken from the source as it is",
}
"""What the comparison of an item shows, the strongest evidence first."""
Dependence = Literal["calibrated", "derived"]
ROUNDING_FACTOR = 1.0 + 1e-9
"""Factor on tolerances for the rounding of a difference."""


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
    kind: ItemKind
    """What the comparison shows."""
    kind_reason: str = ""
    """Reason for the kind, where it is not obvious."""
    dependence: Dependence | None = None
    """Whether constants of the model were fitted to such data, or the number follows from other items."""
    tolerance: float | None = None
    """Allowed difference of the computed number, in the unit of the item; None where no number is compared."""
    at_most: float | None = None
    """Largest computed number with which a statement holds."""
    at_least: float | None = None
    """Least computed number with which a statement holds."""
    criterion: str = ""
    """What decides the verdict, and the reason of tolerance or limit; empty where nothing is compared."""
    contradiction: str = ""
    """Contradicting evidence in the source; empty without any."""
    note: str = ""
    """Remark on the item."""
    is_checked: bool = True
    """Whether the printed value was compared with a second reading of the source."""


class Outcome(NamedTuple):
    """Computed value or statement of an item."""

    value: float | None = None
    """Computed number; None where nothing can be computed because the data of the experiment are not printed."""
    holds: bool | None = None
    """Whether a statement holds, apart from the limits of its item; None for a number."""
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
    holds: bool | None = None
    """Whether the model meets the statement, limits included; None for a number."""

    @property
    def is_compared(self) -> bool:
        """Return whether the item was compared with a computed value."""
        return self.verdict != "not-printed"

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
    """Return the verdict on ``item``.

    A number agrees within its tolerance. A statement agrees if it holds and the computed number meets the limits of the
    item. ``implied`` is the value that other printed numbers of the source imply for the item, or whether they meet its
    statement. The source contradicts itself where it has contradicting evidence that, if it can be computed, agrees
    with the finding, or where it makes a statement false that the finding supports. Any other disagreement contradicts
    the source. Items that are not printed or cannot be computed are ``not-printed``.
    """
    if isinstance(item.published, str):
        return _assess_statement(item, finding, implied)
    if item.published is None or finding.value is None:
        return ItemAssessment(item, finding, "not-printed")
    if item.tolerance is None:
        raise ValueError(f"item {item.id} has no tolerance")
    tolerance = item.tolerance * ROUNDING_FACTOR
    if abs(finding.value - item.published) <= tolerance:
        return ItemAssessment(item, finding, "agrees")
    is_self_contradiction = bool(item.contradiction) and (implied is None or abs(finding.value - implied) <= tolerance)
    return ItemAssessment(item, finding, _name_disagreement(is_self_contradiction))


def _assess_statement(item: PublishedItem, finding: Outcome, implied: float | bool | None) -> ItemAssessment:
    if finding.holds is None:
        return ItemAssessment(item, finding, "not-printed")
    holds = finding.holds and _is_within_limits(item, finding.value)
    implied_holds = implied if implied is None or isinstance(implied, bool) else _is_within_limits(item, implied)
    if holds and implied_holds is not False:
        return ItemAssessment(item, finding, "agrees", holds)
    is_self_contradiction = bool(item.contradiction) and implied_holds is not True
    return ItemAssessment(item, finding, _name_disagreement(is_self_contradiction), holds)


def _is_within_limits(item: PublishedItem, value: float | None) -> bool:
    if item.at_most is None and item.at_least is None:
        return True
    if value is None:
        return False
    return (item.at_most is None or value <= item.at_most) and (item.at_least is None or value >= item.at_least)


def _name_disagreement(is_self_contradiction: bool) -> Verdict:
    return "source-contradicts-itself" if is_self_contradiction else "contradicts-source"
