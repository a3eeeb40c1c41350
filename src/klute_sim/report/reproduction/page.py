"""The dissertation beside the model as one HTML file that needs nothing else."""

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
    "agrees": "what we compute is what is printed",
    "contradicts-source": "what we compute is not what is printed",
    "source-contradicts-itself": "it is not, and another part of the source speaks against what is printed, too",
    "not-printed": "nothing to compare: the page is missing from our copy, or it is about an experiment",
}


def write_page(reproduction: Reproduction, pictures: Mapping[str, Path], path: Path) -> None:
    """Write the page of ``found`` to ``path``, with ``pictures`` (number -> PNG) in it."""
    images = {name: base64.b64encode(file.read_bytes()).decode("ascii") for name, file in pictures.items()}
    path.write_text(render_template(TEMPLATE, **build_page_context(reproduction), images=images), "utf-8")


def build_page_context(reproduction: Reproduction) -> dict[str, Any]:
    """Everything on the page but its pictures, in words."""
    by_row: dict[str, list[ItemAssessment]] = {}
    for outcome in reproduction.assessments:
        by_row.setdefault(outcome.item.row_title, []).append(outcome)
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
                "shows": row.shows,
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
    """How often each verdict was given."""
    found = Counter(outcome.verdict for outcome in outcomes)
    return {verdict: found[verdict] for verdict in VERDICTS}


def count_agreeing_inputs(outcomes: Iterable[ItemAssessment]) -> int:
    """How many of those that agree were taken over as they are."""
    return sum(outcome.item.is_input and outcome.verdict == "agrees" for outcome in outcomes)


def format_outcome_cells(outcome: ItemAssessment) -> dict[str, str]:
    """An outcome as a person reads it."""
    item, found = outcome.item, outcome.finding
    published = item.published
    computed = "-" if found.value is None else format_number(found.value)
    if found.holds is not None:
        computed = f"{'holds' if found.holds else 'does not hold'}{'' if found.value is None else f' ({computed})'}"
    difference = outcome.difference
    apart = "-"
    if difference is not None:
        share = f"{round(100.0 * difference, 1) + 0.0:+.1f} %"
        apart = share if outcome.is_relative else f"{difference:+.2g}"
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
        "difference": apart,
        "verdict": outcome.verdict,
        "note": outcome.note,
    }
