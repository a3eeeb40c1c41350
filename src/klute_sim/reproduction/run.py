"""Assessment of all published items."""

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
from klute_sim.reproduction.item import ItemAssessment, Outcome, assess
from klute_sim.types import ProgressCallback


class Reproduction(NamedTuple):
    """Assessments and figures of all published items."""

    device: Device
    """Device of chapters 4 to 8; chapter 3 uses the presets of Table 3.1."""
    assessments: tuple[ItemAssessment, ...]
    """Assessments in the order of the source."""
    figures: tuple[FigureData, ...]
    """Figures of all chapters."""

    def to_records(self) -> list[dict[str, Any]]:
        """Return one JSON object per item."""
        return [
            {
                "item": assessment.item.id,
                "table": assessment.item.table_title,
                "quantity": assessment.item.quantity,
                "unit": assessment.item.unit,
                "published": assessment.item.published,
                "computed": _finite_or_none(assessment.finding.value),
                "holds": assessment.holds,
                "difference": _finite_or_none(assessment.difference),
                "kind": assessment.item.kind,
                "kind_reason": assessment.item.kind_reason,
                "dependence": assessment.item.dependence,
                "tolerance": assessment.item.tolerance,
                "at_most": assessment.item.at_most,
                "at_least": assessment.item.at_least,
                "criterion": assessment.item.criterion,
                "checked": assessment.item.is_checked,
                "verdict": assessment.verdict,
                "note": assessment.note,
            }
            for assessment in self.assessments
        ]


def _finite_or_none(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def run_reproduction(
    device: Device,
    supplied_values: Mapping[str, float] | None = None,
    progress: ProgressCallback = lambda fraction, stage: None,
) -> Reproduction:
    """Compute and assess every published item.

    ``device`` is the muscle-tendon unit of chapters 4 to 8; ``supplied_values`` maps item identifiers to published
    numbers that the user supplies; ``progress`` receives the completed fraction. Raises InputError when the device has
    no damper or tendon or cannot take the lengths of chapter 7.
    """
    # Refused before the first chapters, which take half a minute where the laws are not compiled yet.
    chapter4.get_damper(device)
    chapter56.get_tendon(device)
    chapters: tuple[tuple[str, float, Callable[[ProgressCallback], ChapterResult]], ...] = (
        ("chapter 2", 0.02, lambda chapter_progress: chapter2.compute()),
        ("chapter 3", 0.02, lambda chapter_progress: chapter3.compute()),
        ("chapter 3 in motion", 0.26, chapter3_dynamic.compute),
        ("chapter 4", 0.02, lambda chapter_progress: chapter4.compute(device)),
        ("chapters 5 and 6", 0.01, lambda chapter_progress: chapter56.compute(device)),
        ("chapter 7", 0.2, lambda chapter_progress: chapter7.compute(device, chapter_progress)),
        ("chapter 8", 0.47, lambda chapter_progress: chapter8.compute(device, chapter_progress)),
    )
    findings: dict[str, Outcome] = {}
    figures: list[FigureData] = []
    start = 0.0
    for title, weight, compute_chapter in chapters:

        def report_fraction(
            fraction: float, stage: str, start: float = start, weight: float = weight, title: str = title
        ) -> None:
            progress(start + weight * fraction, title)

        chapter = compute_chapter(report_fraction)
        findings.update(chapter.findings)
        figures += chapter.figures
        start += weight
        progress(start, title)
    implied_values = compute_implied_values()
    assessments = tuple(
        assess(item, findings[item.id], implied_values.get(item.id)) for item in printed.list_items(supplied_values)
    )
    return Reproduction(device, assessments, tuple(figures))
