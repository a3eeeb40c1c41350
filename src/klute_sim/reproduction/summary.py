"""Counts of the assessments, and the sentences that state them."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from klute_sim.reproduction.item import KIND_MEANINGS, VERDICTS, ItemAssessment, ItemKind, Verdict

KIND_PLURALS: dict[ItemKind, str] = {
    "independent": "independent numbers",
    "claim": "claims and definitions",
    "round-trip": "round trips",
    "input": "inputs",
}


def count_verdicts(assessments: Iterable[ItemAssessment]) -> dict[Verdict, int]:
    """Return the number of assessments with each verdict."""
    counts = Counter(assessment.verdict for assessment in assessments)
    return {verdict: counts[verdict] for verdict in VERDICTS}


def count_kinds(assessments: Sequence[ItemAssessment]) -> dict[ItemKind, dict[Verdict, int]]:
    """Return the number of assessments with each verdict by kind."""
    return {kind: count_verdicts(select_kind(assessments, kind)) for kind in KIND_MEANINGS}


def select_kind(assessments: Iterable[ItemAssessment], kind: ItemKind) -> list[ItemAssessment]:
    """Return the assessments of items of ``kind``."""
    return [assessment for assessment in assessments if assessment.item.kind == kind]


def format_headline(assessments: Sequence[ItemAssessment]) -> str:
    """Return how many independent numbers agree, of those that are compared."""
    return f"{_format_agreement(select_kind(assessments, 'independent'))} independent numbers agree."


def format_dependence(assessments: Sequence[ItemAssessment]) -> str:
    """Return how many agree without numbers that the model was fitted to or that follow from other items."""
    compared = [a for a in select_kind(assessments, "independent") if a.is_compared]
    counts = Counter(a.item.dependence for a in compared)
    rest = [a for a in compared if a.item.dependence is None]
    return (
        f"Of these, {counts['calibrated']} was used to fit constants of the model and {counts['derived']} follow from "
        f"other items: without them {_format_agreement(rest)} agree."
    )


def format_other_kinds(assessments: Sequence[ItemAssessment]) -> str:
    """Return how many items of the other kinds agree, and how many items are not compared."""
    others = [
        f"{_format_agreement(select_kind(assessments, kind))} {KIND_PLURALS[kind]}"
        for kind in KIND_MEANINGS
        if kind != "independent"
    ]
    n_skipped = sum(not assessment.is_compared for assessment in assessments)
    return f"Beside them {', '.join(others[:-1])} and {others[-1]} agree. {n_skipped} items are not compared."


def _format_agreement(assessments: Iterable[ItemAssessment]) -> str:
    compared = [assessment for assessment in assessments if assessment.is_compared]
    return f"{sum(assessment.verdict == 'agrees' for assessment in compared)} of {len(compared)}"


def summarize(assessments: Sequence[ItemAssessment]) -> dict[str, Any]:
    """Return headline and counts as a JSON object."""
    return {
        "headline": format_headline(assessments),
        "dependence": format_dependence(assessments),
        "other_kinds": format_other_kinds(assessments),
        "counts": count_kinds(assessments),
    }
