"""The page of results: what was aimed at, what came out, every failure with its reason."""

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.hidden_effects.metrics import (
    MIN_RELEVANT_SIZE,
    DatasetResult,
    Metric,
    compute_metrics,
    iter_parameter_intervals,
    tabulate_confusion,
    tabulate_power,
)
from benchmarks.hidden_effects.score import is_first_right, list_effect_sets, list_hidden_effects

ACCEPTED_OUTCOMES = {"right", "absorbed"}
MAX_REASON_LENGTH = 400
"""Letters of a reason."""


def render_page(
    rows: Sequence[DatasetResult], baseline_rows: Mapping[str, Sequence[DatasetResult]], header: Mapping[str, Any]
) -> str:
    """Markdown; ``head`` says what was run."""
    blocks = list(dict.fromkeys(row.truth["block"] for row in rows))
    lines = ["# The hidden-effect benchmark: results", ""]
    lines += [f"{key}: {value}  " for key, value in header.items()]
    lines += ["", "## What was aimed at", "", *_render_targets(compute_metrics(rows)), "", "## Blocks", ""]
    words = list(dict.fromkeys(row.outcome for row in rows))
    lines += _render_table(
        ["block", "datasets", *words],
        [
            [block, len(own), *(sum(row.outcome == word for row in own) or "" for word in words)]
            for block in blocks
            for own in [[row for row in rows if row.truth["block"] == block]]
        ],
    )
    if baseline_rows:
        lines += ["", "## Beside other methods", "", *_render_methods(rows, baseline_rows)]
    lines += ["", "## Power: what became of single effects, by their size over the noise", "", *_render_power(rows)]
    lines += ["", "## How many repeats, for effects of half the noise", "", *_render_repeats(rows)]
    lines += ["", "## What a sensor for the muscle's length brings", "", *_render_length_sensor(rows)]
    lines += [
        "",
        "## Confusion",
        "",
        *_render_confusion(rows),
        "",
        "## What was not right, and why",
        "",
        *_render_failures(rows),
    ]
    return "\n".join(lines) + "\n"


def _render_table(head: Sequence[object], rows: Sequence[Sequence[object]]) -> list[str]:
    return [_render_row(head), _render_row(["---"] * len(head)), *map(_render_row, rows)]


def _render_row(cells: Sequence[object]) -> str:
    return "| " + " | ".join(str(cell).replace("|", "\\|") for cell in cells) + " |"


def _render_targets(results: Sequence[Metric]) -> list[str]:
    rows = []
    for one in results:
        share = one.low is not None
        value = "-" if one.value is None else f"{100 * one.value:.1f} %" if share else f"{one.value:.3g}"
        around = (
            f"{100 * one.low:.1f} to {100 * one.high:.1f} %" if one.low is not None and one.high is not None else ""
        )
        met = {None: "", True: "yes", False: "**no**"}[one.met]
        rows.append([one.name, value, around, one.of, one.target, met])
    return _render_table(["", "measured", "95 % interval", "of", "aimed at", "met"], rows)


def _render_methods(rows: Sequence[DatasetResult], baseline_rows: Mapping[str, Sequence[DatasetResult]]) -> list[str]:
    """By block, on the datasets that every method was given."""
    common = set.intersection(*({row.name for row in own} for own in baseline_rows.values()))
    every = {
        method: [row for row in own if row.name in common]
        for method, own in {"klute-sim": rows, **baseline_rows}.items()
    }
    words = list(dict.fromkeys(row.outcome for own in every.values() for row in own))
    table = []
    for block in dict.fromkeys(row.truth["block"] for row in every["klute-sim"]):
        for method, own in every.items():
            here = [row for row in own if row.truth["block"] == block]
            first = sum(bool(list_hidden_effects(row.truth)) and is_first_right(row.truth, row.verdict) for row in here)
            counts = (sum(row.outcome == word for row in here) for word in words)
            table.append([block, method, len(here), first or "", *(count or "" for count in counts)])
    return _render_table(["block", "method", "datasets", "first name right", *words], table)


def _render_power(rows: Sequence[DatasetResult]) -> list[str]:
    bands = ((0.0, 1.0), (1.0, 4.0), (4.0, float("inf")))
    heads = ["effect", "below 1", "1 to 4", "above 4"]
    table = []
    for name, found in tabulate_power(rows).items():
        told = [
            ", ".join(f"{word} ({size:.1f})" for size, word in sorted(found.items()) if low <= size < high)
            for low, high in bands
        ]
        table.append([name, *told])
    return _render_table(heads, table)


def _render_repeats(rows: Sequence[DatasetResult]) -> list[str]:
    own = [row for row in rows if row.truth["block"] == "repeats"]
    words = list(dict.fromkeys(row.outcome for row in own))
    counts = sorted({row.truth["repeats"] for row in own})
    return _render_table(
        ["repeats", *words],
        [[n, *(sum(r.truth["repeats"] == n and r.outcome == w for r in own) or "" for w in words)] for n in counts],
    )


def _render_length_sensor(rows: Sequence[DatasetResult]) -> list[str]:
    """Single effects and pairs, of those of a size worth finding, by whether the muscle's own length was recorded."""
    table = []
    for has, word in ((True, "recorded"), (False, "not recorded")):
        own = [
            row
            for row in rows
            if row.truth["block"] in ("single", "pair", "triple")
            and row.truth["size"] >= MIN_RELEVANT_SIZE
            and ("muscle_length" in row.verdict.get("gap", {})) is has
        ]
        errors = [each.relative_error for each in iter_parameter_intervals(own)]
        right = sum(row.outcome == "right" for row in own)
        alone = sum(row.verdict["verdict"] == "named" and row.outcome == "right" for row in own)
        error = f"{100 * statistics.median(errors):.1f} %" if errors else "-"
        table.append([word, len(own), right, alone, error])
    return _render_table(
        ["muscle's length", "datasets", "right", "of them by one name", "error of a number, median"], table
    )


def _render_confusion(rows: Sequence[DatasetResult]) -> list[str]:
    return _render_table(
        ["hidden", "told (how often)"],
        [
            [true, ", ".join(f"{word} ({count})" for word, count in sorted(told.items(), key=lambda pair: -pair[1]))]
            for true, told in sorted(tabulate_confusion(rows).items())
        ],
    )


def _render_failures(rows: Sequence[DatasetResult]) -> list[str]:
    table = []
    for row in rows:
        block, outcome = row.truth["block"], row.outcome
        fine = (
            outcome in ACCEPTED_OUTCOMES
            or (block in ("outside", "wrong_form") and outcome == "flagged")
            or block == "repeats"
        )
        if fine and row.second_outcome in (None, "right"):
            continue
        told = " or ".join(" and ".join(each) for each in list_effect_sets(row.verdict)) or row.verdict["verdict"]
        reason = " ".join(row.verdict.get("reasons", ())).replace("\n", " ")
        outcome = row.outcome if row.second_outcome in (None, "right") else f"{row.outcome}, then {row.second_outcome}"
        sizes = f"{row.truth['size']:.1f}"
        table.append(
            [row.name, " and ".join(list_hidden_effects(row.truth)), sizes, told, outcome, reason[:MAX_REASON_LENGTH]]
        )
    return _render_table(["dataset", "hidden", "size", "told", "outcome", "what the program said"], table)
