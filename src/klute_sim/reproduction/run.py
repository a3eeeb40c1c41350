"""Through the whole source, item by item."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from klute_sim.device.device import Device
from klute_sim.reproduction import printed
from klute_sim.reproduction.chapters import (
    chapter2,
    chapter3,
    chapter3_dynamic,
    chapter4,
    chapter7,
    chapter8,
    chapter56,
)
from klute_sim.reproduction.curves import ChapterResult, FigureData
from klute_sim.reproduction.implied_values import compute_implied_values
from klute_sim.reproduction.item import Finding, ItemAssessment, assess


class Reproduction(NamedTuple):
    """The source and what became of it."""

    device: Device
    """Of chapters 4 to 8; chapter 3 is about the presets of Table 3.1."""
    assessments: tuple[ItemAssessment, ...]
    """In the order of the source's pages."""
    figures: tuple[FigureData, ...]

    def to_records(self) -> list[dict[str, Any]]:
        """One object per item."""
        return [
            {
                "item": outcome.item.id,
                "row": outcome.item.row_title,
                "quantity": outcome.item.quantity,
                "unit": outcome.item.unit,
                "published": outcome.item.published,
                "computed": _finite_or_none(outcome.finding.value),
                "holds": outcome.finding.holds,
                "difference": _finite_or_none(outcome.difference),
                "tolerance": outcome.item.tolerance,
                "input": outcome.item.is_input,
                "verdict": outcome.verdict,
                "note": outcome.note,
            }
            for outcome in self.assessments
        ]


def _finite_or_none(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def run_reproduction(
    device: Device,
    supplied_values: Mapping[str, float] | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Reproduction:
    """Compute and judge every item; ``told`` hears how far it is.

    ``device`` is the musculo-tendon unit of chapters 4 to 8. Raises InputError if it has no damper or tendon, or if it
    cannot take the lengths of chapter 7.
    """
    parts: tuple[tuple[float, Callable[[Callable[[float], None]], ChapterResult]], ...] = (
        (0.02, lambda told: chapter2.compute()),
        (0.02, lambda told: chapter3.compute()),
        (0.26, lambda told: chapter3_dynamic.compute(told)),
        (0.02, lambda told: chapter4.compute(device)),
        (0.01, lambda told: chapter56.compute(device)),
        (0.2, lambda told: chapter7.compute(device, told)),
        (0.47, lambda told: chapter8.compute(device, told)),
    )
    findings: dict[str, Finding] = {}
    pictures: list[FigureData] = []
    begin = 0.0
    for weight, part in parts:

        def heard(share: float, begin: float = begin, weight: float = weight) -> None:
            progress(begin + weight * share)

        found = part(heard)
        findings.update(found.findings)
        pictures += found.figures
        begin += weight
        progress(begin)
    others = compute_implied_values()
    outcomes = tuple(
        assess(item, findings[item.id], others.get(item.id)) for item in printed.list_items(supplied_values)
    )
    return Reproduction(device, outcomes, tuple(pictures))
