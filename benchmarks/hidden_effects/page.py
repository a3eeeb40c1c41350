"""Page of results: targets, outcomes, and every failure with its reason."""

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
    tabulate_coverage,
    tabulate_power,
)
from benchmarks.hidden_effects.report import METHOD_COLUMNS, OWN_METHOD, format_method, summarise_method
from benchmarks.hidden_effects.score import is_first_right, list_effect_sets, list_hidden_effects

ACCEPTED_OUTCOMES = {"right", "absorbed"}
MAX_REASON_LENGTH = 400
"""Largest number of characters of a reason."""


def render_page(
    rows: Sequence[DatasetResult], baseline_rows: Mapping[str, Sequence[DatasetResult]], header: Mapping[str, Any]
) -> str:
    """Return the page in Markdown; ``header`` describes the run."""
    lines = ["# The hidden-effect benchmark: results", ""]
    lines += [f"{key}: {value}  " for key, value in header.items()]
    lines += ["", "## Targets", "", *_render_targets(compute_metrics(rows)), "", "## Blocks", ""]
    lines += _render_blocks(rows)
    if baseline_rows:
        lines += ["", "## Other methods", "", *_render_methods(rows, baseline_rows)]
    lines += ["", "## Power: outcome of single effects by their size over the noise", "", *_render_power(rows)]
    lines += ["", "## Repeats, for effects of half the noise", "", *_render_repeats(rows)]
    lines += ["", "## Sensor of the muscle's length", "", *_render_length_sensor(rows)]
    lines += [
        "",
        "## Confusion",
        "",
        *_render_confusion(rows),
        "",
        "## Failures, with the reasons that the program states",
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
    for metric in results:
        is_fraction = metric.low is not None
        value = "-" if metric.value is None else f"{100 * metric.value:.1f} %" if is_fraction else f"{metric.value:.3g}"
        interval = (
            f"{100 * metric.low:.1f} to {100 * metric.high:.1f} %"
            if metric.low is not None and metric.high is not None
            else ""
        )
        met = {None: "", True: "yes", False: "**no**"}[metric.met]
        rows.append([metric.name, value, interval, metric.n, metric.target, met])
    return _render_table(["", "measured", "95 % interval", "n", "target", "met"], rows)


def _render_blocks(rows: Sequence[DatasetResult]) -> list[str]:
    """Return the table of outcomes, 95 % intervals that cover the truth, and times of each block."""
    outcomes, coverage = list(dict.fromkeys(row.outcome for row in rows)), tabulate_coverage(rows)
    table = []
    for block in dict.fromkeys(row.truth["block"] for row in rows):
        block_rows = [row for row in rows if row.truth["block"] == block]
        counts = [sum(row.outcome == outcome for row in block_rows) or "" for outcome in outcomes]
        covering = f"{coverage[block][0]} of {coverage[block][1]}" if block in coverage else ""
        times = [row.verdict["cpu_s"] for row in block_rows]
        table.append(
            [block, len(block_rows), *counts, covering, f"{statistics.median(times):.0f}", f"{max(times):.0f}"]
        )
    head = ["block", "datasets", *outcomes, "intervals that cover", "processor time, median [s]", "largest [s]"]
    return _render_table(head, table)


def _render_methods(rows: Sequence[DatasetResult], baseline_rows: Mapping[str, Sequence[DatasetResult]]) -> list[str]:
    """Return the table of all methods and that by block, over the datasets common to all methods."""
    common = set.intersection(*({row.name for row in method_rows} for method_rows in baseline_rows.values()))
    rows_by_method = {
        method: [row for row in method_rows if row.name in common]
        for method, method_rows in {OWN_METHOD: rows, **baseline_rows}.items()
    }
    summary = [[method, *format_method(summarise_method(rows))] for method, rows in rows_by_method.items()]
    outcomes = list(dict.fromkeys(row.outcome for method_rows in rows_by_method.values() for row in method_rows))
    table = []
    for block in dict.fromkeys(row.truth["block"] for row in rows_by_method[OWN_METHOD]):
        for method, method_rows in rows_by_method.items():
            block_rows = [row for row in method_rows if row.truth["block"] == block]
            first = sum(
                bool(list_hidden_effects(row.truth)) and is_first_right(row.truth, row.verdict) for row in block_rows
            )
            counts = (sum(row.outcome == outcome for row in block_rows) for outcome in outcomes)
            table.append([block, method, len(block_rows), first or "", *(count or "" for count in counts)])
    return [
        *_render_table(["method", *METHOD_COLUMNS], summary),
        "",
        *_render_table(["block", "method", "datasets", "first name right", *outcomes], table),
    ]


def _render_power(rows: Sequence[DatasetResult]) -> list[str]:
    bands = ((0.0, 1.0), (1.0, 4.0), (4.0, float("inf")))
    heads = ["effect", "below 1", "1 to 4", "above 4"]
    table = []
    for name, outcomes in tabulate_power(rows).items():
        cells = [
            ", ".join(f"{word} ({size:.1f})" for size, word in sorted(outcomes.items()) if low <= size < high)
            for low, high in bands
        ]
        table.append([name, *cells])
    return _render_table(heads, table)


def _render_repeats(rows: Sequence[DatasetResult]) -> list[str]:
    repeat_rows = [row for row in rows if row.truth["block"] == "repeats"]
    outcomes = list(dict.fromkeys(row.outcome for row in repeat_rows))
    counts = sorted({row.truth["repeats"] for row in repeat_rows})
    return _render_table(
        ["repeats", *outcomes],
        [
            [n, *(sum(r.truth["repeats"] == n and r.outcome == w for r in repeat_rows) or "" for w in outcomes)]
            for n in counts
        ],
    )


def _render_length_sensor(rows: Sequence[DatasetResult]) -> list[str]:
    """Return the table of single effects and pairs of relevant size, by whether the muscle length was recorded."""
    table = []
    for is_recorded, label in ((True, "recorded"), (False, "not recorded")):
        subset = [
            row
            for row in rows
            if row.truth["block"] in ("single", "pair", "triple")
            and row.truth["size"] >= MIN_RELEVANT_SIZE
            and ("muscle_length" in row.verdict.get("gap", {})) is is_recorded
        ]
        errors = [interval.relative_error for interval in iter_parameter_intervals(subset)]
        n_right = sum(row.outcome == "right" for row in subset)
        n_unambiguous = sum(row.verdict["verdict"] == "identified" and row.outcome == "right" for row in subset)
        error = f"{100 * statistics.median(errors):.1f} %" if errors else "-"
        table.append([label, len(subset), n_right, n_unambiguous, error])
    return _render_table(
        ["muscle's length", "datasets", "right", "right with one name", "relative error of a parameter, median"], table
    )


def _render_confusion(rows: Sequence[DatasetResult]) -> list[str]:
    return _render_table(
        ["hidden", "verdict (count)"],
        [
            [
                true,
                ", ".join(f"{label} ({count})" for label, count in sorted(reports.items(), key=lambda pair: -pair[1])),
            ]
            for true, reports in sorted(tabulate_confusion(rows).items())
        ],
    )


def _render_failures(rows: Sequence[DatasetResult]) -> list[str]:
    table = []
    for row in rows:
        block, outcome = row.truth["block"], row.outcome
        is_accepted = (
            outcome in ACCEPTED_OUTCOMES
            or (block in ("outside", "faint_outside", "wrong_form") and outcome == "flagged")
            or block == "repeats"
        )
        if is_accepted and row.second_outcome in (None, "right"):
            continue
        reported = (
            " or ".join(" and ".join(effect_set) for effect_set in list_effect_sets(row.verdict))
            or row.verdict["verdict"]
        )
        reason = " ".join(row.verdict.get("reasons", ())).replace("\n", " ")
        outcome = row.outcome if row.second_outcome in (None, "right") else f"{row.outcome}, then {row.second_outcome}"
        sizes = f"{row.truth['size']:.1f}"
        table.append(
            [
                row.name,
                " and ".join(list_hidden_effects(row.truth)),
                sizes,
                reported,
                outcome,
                reason[:MAX_REASON_LENGTH],
            ]
        )
    return _render_table(["dataset", "hidden", "size", "verdict", "outcome", "reasons"], table)
