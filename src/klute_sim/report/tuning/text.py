"""Sentences on a tuning: how much was searched, and which part of the objective fell."""

from collections.abc import Mapping, Sequence
from typing import Any

MIN_CAUSE_FRACTION = 0.2
"""Smallest fraction of the sum of all falls for which a part of the objective is named as a cause (assumed)."""
MIN_CHANGE_PCT = 0.5
"""Smallest change of the tracking error that is stated [%]."""


def format_change(before: float, tuned: float) -> str:
    """Return by how much the objective fell, as the beginning of a sentence."""
    if not tuned < before:
        return "The objective did not fall"
    return f"The objective fell by {100.0 * (1.0 - tuned / before):.0f} %"


def format_search_size(n: int, n_generations: int, n_finalists: int, seed: int) -> str:
    """Return a sentence on the ``n`` evaluations, why they may exceed the budget, and the finer repeats."""
    size = f"{n} evaluation{'s' * (n != 1)}"
    if n_generations:
        size += f" (the start and {n_generations} whole generation{'s' * (n_generations != 1)}"
        size += f" of {(n - 1) // n_generations})"
    size = f"Search: {size}, finer repeats of the start and {n_finalists} finalist{'s' * (n_finalists != 1)}"
    return f"{size}; seed {seed}."


def format_causes(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return which parts of the objective fell, and what the tracking error did, as the end of a sentence.

    ``rows`` are those of :func:`klute_sim.tuning.results.build_objective_rows`; empty where nothing fell.
    """
    falls = {row["name"]: row["before"] - row["tuned"] for row in rows}
    total = sum(max(0.0, fall) for fall in falls.values())
    causes = [name for name, fall in falls.items() if fall > 0.0 and fall >= MIN_CAUSE_FRACTION * total]
    if not causes:
        return ""
    causes.sort(key=lambda name: -falls[name])
    sentence = f", because {' and '.join(causes)} fell"
    tracking = rows[0]
    if tracking["name"] in causes or not tracking["before"]:
        return sentence
    change = 100.0 * (tracking["tuned"] / tracking["before"] - 1.0)
    if abs(change) < MIN_CHANGE_PCT:
        return f"{sentence}; {tracking['name']} did not"
    return f"{sentence}; {tracking['name']} {'rose' if change > 0.0 else 'fell'} by {abs(change):.0f} %" + (
        "" if change > 0.0 else " only"
    )


def format_quantity(row: Mapping[str, Any]) -> str:
    """Return the quantity of a part of the objective before and after tuning, and what is allowed without cost."""
    values = [row["value_before"], row["value_tuned"]]
    texts = [] if None in values else [f"{values[0]:.3g} -> {values[1]:.3g}"]
    return " ".join(
        [*texts, *[row["unit"]] * bool(row["unit"]), *[f"(allowed: {row['allowed']})"] * bool(row["allowed"])]
    )
