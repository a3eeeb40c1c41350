"""Page that compares the model with the dissertation: one self-contained HTML file that works offline."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from klute_sim.provenance import collect_versions
from klute_sim.recording.atomic_file import write_atomically
from klute_sim.report.diagnosis.text import format_number
from klute_sim.report.html import render_template
from klute_sim.report.run_page import PAGE_FILE, encode_picture, list_files
from klute_sim.reproduction import printed
from klute_sim.reproduction.item import KIND_MEANINGS, VERDICTS, ItemAssessment
from klute_sim.reproduction.run import Reproduction
from klute_sim.reproduction.summary import count_kinds, count_verdicts, select_kind, summarize

TEMPLATE = "reproduction.html"
VERDICT_MEANINGS = {
    "agrees": "the computed value equals the printed value",
    "contradicts-source": "the computed value differs from the printed value",
    "source-contradicts-itself": "the values differ, and another part of the source contradicts the printed value, too",
    "not-printed": "no comparison: the page is missing from our copy, or it describes an experiment",
}


def write_page(reproduction: Reproduction, pictures: Mapping[str, Path], folder: Path) -> None:
    """Write the page of ``reproduction`` into ``folder``, with ``pictures`` (number -> path of a PNG file) embedded."""
    images = {number: encode_picture(file) for number, file in pictures.items()}
    content = render_template(TEMPLATE, **build_page_context(reproduction), images=images, files=list_files(folder))
    write_atomically(folder / PAGE_FILE, content)


def build_page_context(reproduction: Reproduction) -> dict[str, Any]:
    """Return the content of the page except its figures as text for the template."""
    by_row: dict[str, list[ItemAssessment]] = {}
    for outcome in reproduction.assessments:
        by_row.setdefault(outcome.item.table_title, []).append(outcome)
    return {
        "device": reproduction.device.name,
        "digest": reproduction.device.digest,
        "summary": summarize(reproduction.assessments),
        "verdicts": VERDICT_MEANINGS,
        "kinds": [
            (kind, KIND_MEANINGS[kind], [counts[verdict] for verdict in VERDICTS], sum(counts.values()))
            for kind, counts in count_kinds(reproduction.assessments).items()
        ],
        "totals": list(count_verdicts(reproduction.assessments).values()),
        "items": len(reproduction.assessments),
        "independent": [
            format_outcome_cells(outcome)
            for outcome in select_kind(reproduction.assessments, "independent")
            if outcome.is_compared
        ],
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


def format_outcome_cells(outcome: ItemAssessment) -> dict[str, str]:
    """Return the cells of an outcome as text."""
    item, finding = outcome.item, outcome.finding
    computed = "-" if finding.value is None else format_number(finding.value)
    if outcome.holds is not None:
        value = "" if finding.value is None else f" ({computed})"
        computed = f"{'holds' if outcome.holds else 'does not hold'}{value}"
    difference = outcome.difference
    difference_text = "-"
    if difference is not None:
        percentage = f"{round(100.0 * difference, 1) + 0.0:+.1f} %"
        difference_text = percentage if outcome.is_relative else f"{difference:+.2g}"
    return {
        "id": item.id,
        "table": item.table_title,
        "quantity": item.quantity,
        "unit": item.unit if item.unit not in ("", "1") else "-",
        "published": _format_published(outcome),
        "computed": computed,
        "difference": difference_text,
        "kind": item.kind,
        "verdict": outcome.verdict,
        "criterion": _format_criterion(outcome),
        "note": " ".join(filter(None, [item.kind_reason, outcome.note])),
    }


def _format_published(outcome: ItemAssessment) -> str:
    published = outcome.item.published
    if published is None:
        return "-"
    text = published if isinstance(published, str) else format_number(published, 5)
    return text if outcome.item.is_checked else f"{text} (read once)"


def _format_criterion(outcome: ItemAssessment) -> str:
    """Return tolerance or limit and their reason; empty where nothing is compared."""
    item = outcome.item
    if not outcome.is_compared:
        return ""
    limits = [
        f"{name} {format_number(value)}"
        for name, value in (("±", item.tolerance), ("at most", item.at_most), ("at least", item.at_least))
        if value is not None
    ]
    unit = "" if item.unit == "1" else f" {item.unit}"
    return f"{limits[0]}{unit}: {item.criterion}" if limits else item.criterion
