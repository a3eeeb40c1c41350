"""Report of the outcome of each dataset and of the performance of each method."""

import json
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from benchmarks.hidden_effects.metrics import DatasetResult, compute_metrics
from benchmarks.hidden_effects.score import (
    MAX_ABSORBED_SIZE,
    WRONG_OUTCOMES,
    Verdict,
    are_kinds_confused,
    is_first_right,
    is_out_of_catalogue,
    list_hidden_effects,
    list_named_effects,
    residual_over_noise,
)
from rich.console import Console
from rich.markup import escape
from rich.table import Table

OWN_METHOD = "klute-sim"
REFIT_METHOD = "refit only"
METHOD_COLUMNS = (
    "alarms on clean data",
    "exact set",
    "first name right",
    "wrong names",
    "out of catalogue: flagged",
    "gap removed on test trials, median",
    "processor time, median [s]",
)
"""Columns of the table of methods, those of :func:`format_method`."""


def _has_proposal(verdict: Verdict) -> bool:
    """Return whether ``verdict`` proposes an experiment or a direct measurement."""
    experiment = verdict["next_experiment"]
    return bool(verdict.get("direct_measurements") or (experiment and experiment["protocol"]))


def print_report(
    rows: Sequence[DatasetResult], baseline_rows: Mapping[str, Sequence[DatasetResult]], *, as_json: bool
) -> None:
    """Print the outcome of each dataset and the totals; ``baseline_rows`` are those of the baseline methods."""
    totals: dict[str, Any] = {
        "datasets": len(rows),
        "outcomes": _count_outcomes(rows),
        "indistinguishable_without_proposal": sum(
            row.verdict["verdict"] == "indistinguishable" and not _has_proposal(row.verdict) for row in rows
        ),
        "kinds_confused": sum(are_kinds_confused(row.truth, row.verdict) for row in rows),
        "median_cpu_s": statistics.median(row.verdict["cpu_s"] for row in rows),
        "metrics": [metric._asdict() for metric in compute_metrics(rows)],
    }
    if baseline_rows:
        refit = {"names": 0, "gap_over_floor": _median(_worst_gap(row)[0] for row in rows)}
        totals["methods"] = {
            OWN_METHOD: summarise_method(rows),
            **{name: summarise_method(method_rows) for name, method_rows in baseline_rows.items()},
            REFIT_METHOD: refit,
        }
    records = [
        {
            "dataset": row.name,
            "hidden": list_hidden_effects(row.truth),
            "size": row.truth["size"],
            "misfit": residual_over_noise(row.verdict),
            "verdict": row.verdict["verdict"],
            "named": list_named_effects(row.verdict),
            "alternatives": row.verdict["alternatives"],
            "outcome": row.outcome,
            "second": row.second_outcome,
            **{
                method: {"named": list_named_effects(method_rows[k].verdict), "outcome": method_rows[k].outcome}
                for method, method_rows in baseline_rows.items()
            },
        }
        for k, row in enumerate(rows)
    ]
    if as_json:
        print(json.dumps({**totals, "rows": records}, indent=2))
        return
    table = Table("dataset", "hidden", "size", "misfit", "verdict", "named", "outcome", *baseline_rows)
    for row in records:
        named = ", ".join(row["named"]) + ("".join(f" | {', '.join(a)}" for a in row["alternatives"]))
        sizes = f"{row['size']:.1f}", f"{row['misfit']:.1f}"
        outcomes = [row[method]["outcome"] for method in baseline_rows]
        table.add_row(
            row["dataset"], ", ".join(row["hidden"]), *sizes, row["verdict"], named, row["outcome"], *outcomes
        )
    out = Console(width=150, highlight=False)
    out.print(table)
    methods = totals.pop("methods", {})
    targets = Table("", "measured", "95 % interval", "n", "target", "met")
    for metric in compute_metrics(rows):
        if metric.value is not None:
            interval = "" if metric.low is None else f"{metric.low:.2f} to {metric.high:.2f}"
            met = {None: "", True: "yes", False: "no"}[metric.met]
            targets.add_row(escape(metric.name), f"{metric.value:.3g}", interval, str(metric.n), metric.target, met)
    out.print(targets)
    out.print({key: value for key, value in totals.items() if key != "metrics"})
    if methods:
        out.print(_build_methods_table(methods))


def _build_methods_table(methods: Mapping[str, Mapping[str, Any]]) -> Table:
    table = Table("method", *METHOD_COLUMNS)
    for name, summary in methods.items():
        if name != REFIT_METHOD:
            table.add_row(name, *format_method(summary))
    return table


def format_method(summary: Mapping[str, Any]) -> list[str]:
    """Return the cells of a method, in the order of :data:`METHOD_COLUMNS`."""
    counts = [
        f"{summary[count]} of {summary[total]}" if summary[total] else ""
        for count, total in (
            ("alarms", "clean"),
            ("right", "known"),
            ("first_right", "known"),
            ("wrong", "known"),
            ("flagged", "outside"),
        )
    ]
    return [*counts, *(_format_number(summary[key]) for key in ("gap_removed", "median_cpu_s"))]


def _format_number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _count_outcomes(rows: Sequence[DatasetResult]) -> dict[str, int]:
    outcomes = [row.outcome for row in rows]
    return {outcome: outcomes.count(outcome) for outcome in dict.fromkeys(outcomes)}


def summarise_method(rows: Sequence[DatasetResult]) -> dict[str, Any]:
    """Return the counts of outcomes, the processor time, and the removed fraction of the gap where there is one.

    A method alarms on a clean dataset by any verdict but ``nothing-missing``. ``known`` datasets hide what has a name,
    those ``outside`` what has none; defective data and imperfect laws are in neither.
    """
    sound = [row for row in rows if not (row.truth.get("defect") or row.truth.get("law_error"))]
    clean = [row for row in sound if not list_hidden_effects(row.truth)]
    outside = [row for row in sound if is_out_of_catalogue(row.truth)]
    known = [row for row in sound if list_hidden_effects(row.truth) and not is_out_of_catalogue(row.truth)]
    times = [row.verdict["cpu_s"] for row in rows if "cpu_s" in row.verdict]
    return {
        "outcomes": _count_outcomes(rows),
        "clean": len(clean),
        "alarms": sum(row.verdict["verdict"] != "nothing-missing" for row in clean),
        "known": len(known),
        "right": sum(row.outcome == "right" for row in known),
        "first_right": sum(is_first_right(row.truth, row.verdict) for row in known),
        "wrong": sum(row.outcome in WRONG_OUTCOMES for row in known),
        "outside": len(outside),
        "flagged": sum(row.outcome == "flagged" for row in outside),
        "median_cpu_s": _median(times),
        "gap_removed": _median(
            _worst_gap(row)[1] for row in rows if residual_over_noise(row.verdict) >= MAX_ABSORBED_SIZE
        ),
    }


def _worst_gap(row: DatasetResult) -> tuple[float | None, float | None]:
    """Return the gap over the noise floor and its removed fraction, in the worst channel after a refit."""
    gaps = [gap for gap in row.verdict.get("gap", {}).values() if gap["noise_floor"]]
    if not gaps:
        return None, None
    gap = max(gaps, key=lambda channel_gap: channel_gap["refitted"] / channel_gap["noise_floor"])
    excess = gap["refitted"] - gap["noise_floor"]
    removed = (gap["refitted"] - gap["with_effects"]) / excess if excess > 0.0 else None
    return gap["refitted"] / gap["noise_floor"], removed


def _median(values: Iterable[float | None]) -> float | None:
    """Return the median of the values that are not None."""
    return statistics.median(present) if (present := [value for value in values if value is not None]) else None
