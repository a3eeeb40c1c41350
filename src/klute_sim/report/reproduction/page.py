"""Page that compares the model with the dissertation: one self-contained HTML file that works offline."""

import base64
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from klute_sim.provenance import collect_versions
from klute_sim.report.diagnosis.text import format_number
from klute_sim.report.html import render_template
from klute_sim.reproduction import printed
from klute_sim.reproduction.item import VERDICTS, ItemAssessment
from klute_sim.reproduction.run import Reproduction

TEMPLATE = "reproduction.html"
VERDICT_MEANINGS = {
    "agrees": "the computed value equals the printed value",
    "contradicts-source": "the computed value differs from the printed value",
    "source-contradicts-itself": "the values differ, and another part of the source contradicts the printed value, too",
    "not-printed": "no comparison: the page is missing from our copy, or it describes an experiment",
}


def write_page(reproduction: Reproduction, pictures: Mapping[str, Path], path: Path) -> None:
    """Write the page of ``reproduction`` to ``path``, with ``pictures`` (number -> path of a PNG file) embedded."""
    images = {name: base64.b64encode(file.read_bytes()).decode("ascii") for name, file in pictures.items()}
    path.write_text(render_template(TEMPLATE, **build_page_context(reproduction), images=images), "utf-8")


def build_page_context(reproduction: Reproduction) -> dict[str, Any]:
    """Return the content of the page except its figures as text for the template."""
    by_row: dict[str, list[ItemAssessment]] = {}
    for outcome in reproduction.assessments:
        by_row.setdefault(outcome.item.table_title, []).append(outcome)
    return {
        "device": reproduction.device.name,
        "digest": reproduction.device.digest,
        "counts": [
            (verdict, count, VERDICT_MEANINGS[verdict])
            for verdict, count in count_verdicts(reproduction.assessments).items()
        ],
        "inputs": count_agreeing_inputs(reproduction.assessments),
        "items": len(reproduction.assessments),
        "measured": [format_outcome_cells(outcome) for outcome in reproduction.assessments if outcome.item.is_measured],
        "rows": [
            {
                "id": name,
                "title": row.title,
                "description": row.description,
                "items": [format_outcome_cells(outcome) for outcome in by_row[row.title]],
                "counts": [(v, n) for v, n in count_verdicts(by_row[row.title]).items() if n],
            }
            for name, row in printed.load_tables().items()
        ],
        "pictures": [
            {"number": p.number, "title": p.title, "assumed": p.assumption_note, "name": f"fig-{p.number}.png"}
            for p in reproduction.figures
        ],
        "versions": collect_versions(),
    }


def count_verdicts(outcomes: Iterable[ItemAssessment]) -> dict[str, int]:
    """Return the number of outcomes with each verdict."""
    counts = Counter(outcome.verdict for outcome in outcomes)
    return {verdict: counts[verdict] for verdict in VERDICTS}


def count_agreeing_inputs(outcomes: Iterable[ItemAssessment]) -> int:
    """Return the number of agreeing items that are inputs of the model."""
    return sum(outcome.item.is_input and outcome.verdict == "agrees" for outcome in outcomes)


def format_outcome_cells(outcome: ItemAssessment) -> dict[str, str]:
    """Return the cells of an outcome as text."""
    item, finding = outcome.item, outcome.finding
    published = item.published
    computed = "-" if finding.value is None else format_number(finding.value)
    if finding.holds is not None:
        value = "" if finding.value is None else f" ({computed})"
        computed = f"{'holds' if finding.holds else 'does not hold'}{value}"
    difference = outcome.difference
    difference_text = "-"
    if difference is not None:
        percentage = f"{round(100.0 * difference, 1) + 0.0:+.1f} %"
        difference_text = percentage if outcome.is_relative else f"{difference:+.2g}"
    return {
        "id": item.id,
        "quantity": item.quantity,
        "unit": item.unit if item.unit not in ("", "1") else "-",
        "published": "-"
        if published is None
        else published
        if isinstance(published, str)
        else format_number(published, 5),
        "computed": computed,
        "difference": difference_text,
        "verdict": outcome.verdict,
        "note": outcome.note,
    }
