"""The dissertation beside the model as one HTML file that needs nothing else."""

import base64
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from klute_sim.provenance import versions
from klute_sim.report.diagnosis_words import number
from klute_sim.report.html import rendered
from klute_sim.reproduce import printed
from klute_sim.reproduce.item import VERDICTS, Outcome
from klute_sim.reproduce.walk import Reproduction

TEMPLATE = "reproduction.html"
MEANING = {
    "agrees": "what we compute is what is printed",
    "contradicts-source": "what we compute is not what is printed",
    "source-contradicts-itself": "it is not, and another part of the source speaks against what is printed, too",
    "not-printed": "nothing to compare: the page is missing from our copy, or it is about an experiment",
}


def write(found: Reproduction, pictures: Mapping[str, Path], path: Path) -> None:
    """Write the page of ``found`` to ``path``, with ``pictures`` (number -> PNG) in it."""
    images = {name: base64.b64encode(file.read_bytes()).decode("ascii") for name, file in pictures.items()}
    path.write_text(rendered(TEMPLATE, **content(found), images=images), "utf-8")


def content(found: Reproduction) -> dict[str, Any]:
    """Everything on the page but its pictures, in words."""
    by_row: dict[str, list[Outcome]] = {}
    for outcome in found.outcomes:
        by_row.setdefault(outcome.item.row, []).append(outcome)
    return {
        "device": found.device.name,
        "digest": found.device.digest,
        "counts": [(verdict, count, MEANING[verdict]) for verdict, count in counts(found.outcomes).items()],
        "inputs": inputs(found.outcomes),
        "items": len(found.outcomes),
        "measured": [cells(outcome) for outcome in found.outcomes if outcome.item.measured],
        "rows": [
            {
                "id": name,
                "title": row.title,
                "shows": row.shows,
                "items": [cells(outcome) for outcome in by_row[row.title]],
                "counts": [(v, n) for v, n in counts(by_row[row.title]).items() if n],
            }
            for name, row in printed.rows().items()
        ],
        "pictures": [
            {"number": p.number, "title": p.title, "assumed": p.assumed, "name": f"fig-{p.number}.png"}
            for p in found.pictures
        ],
        "versions": versions(),
    }


def counts(outcomes: Iterable[Outcome]) -> dict[str, int]:
    """How often each verdict was given."""
    found = Counter(outcome.verdict for outcome in outcomes)
    return {verdict: found[verdict] for verdict in VERDICTS}


def inputs(outcomes: Iterable[Outcome]) -> int:
    """How many of those that agree were taken over as they are."""
    return sum(outcome.item.input and outcome.verdict == "agrees" for outcome in outcomes)


def cells(outcome: Outcome) -> dict[str, str]:
    """An outcome as a person reads it."""
    item, found = outcome.item, outcome.found
    published = item.published
    computed = "-" if found.value is None else number(found.value)
    if found.holds is not None:
        computed = f"{'holds' if found.holds else 'does not hold'}{'' if found.value is None else f' ({computed})'}"
    difference = outcome.difference
    apart = "-"
    if difference is not None:
        share = f"{round(100.0 * difference, 1) + 0.0:+.1f} %"
        apart = share if outcome.relative else f"{difference:+.2g}"
    return {
        "id": item.id,
        "quantity": item.quantity,
        "unit": item.unit if item.unit not in ("", "1") else "-",
        "published": "-" if published is None else published if isinstance(published, str) else number(published, 5),
        "computed": computed,
        "difference": apart,
        "verdict": outcome.verdict,
        "note": outcome.note,
    }
