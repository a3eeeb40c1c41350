"""What became of the datasets: one row for each, and how every method did."""

import json
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from benchmarks.hidden_effects.metrics import DatasetResult, compute_metrics
from benchmarks.hidden_effects.score import (
    MAX_ABSORBED_RESIDUAL,
    are_kinds_confused,
    list_hidden_effects,
    list_named_effects,
    residual_over_noise,
)
from rich.console import Console
from rich.table import Table

OWN_METHOD = "klute-sim"
REFIT_METHOD = "refit only"


def print_report(
    rows: Sequence[DatasetResult], baseline_rows: Mapping[str, Sequence[DatasetResult]], *, as_json: bool
) -> None:
    """Print the outcome of every dataset, and how often each; the same of ``others``, by the name of the method."""
    whole: dict[str, Any] = {
        "datasets": len(rows),
        "outcomes": _count_outcomes(rows),
        "kinds_confused": sum(are_kinds_confused(row.truth, row.verdict) for row in rows),
        "median_s": statistics.median(row.verdict["s"] for row in rows),
        "metrics": [one._asdict() for one in compute_metrics(rows)],
    }
    if baseline_rows:
        refit = {"names": 0, "gap_over_floor": _median(_worst_gap(row)[0] for row in rows)}
        whole["methods"] = {
            OWN_METHOD: _summarise_method(rows),
            **{name: _summarise_method(each) for name, each in baseline_rows.items()},
            REFIT_METHOD: refit,
        }
    listed = [
        {
            "dataset": row.name,
            "hidden": list_hidden_effects(row.truth),
            "size": row.truth["size"],
            "left": residual_over_noise(row.verdict),
            "verdict": row.verdict["verdict"],
            "named": list_named_effects(row.verdict),
            "alternatives": row.verdict["alternatives"],
            "outcome": row.outcome,
            "second": row.second_outcome,
            **{
                method: {"named": list_named_effects(each[k].verdict), "outcome": each[k].outcome}
                for method, each in baseline_rows.items()
            },
        }
        for k, row in enumerate(rows)
    ]
    if as_json:
        print(json.dumps({**whole, "rows": listed}, indent=2))
        return
    table = Table("dataset", "hidden", "size", "left", "verdict", "named", "outcome", *baseline_rows)
    for row in listed:
        told = ", ".join(row["named"]) + ("".join(f" | {', '.join(a)}" for a in row["alternatives"]))
        sizes = f"{row['size']:.1f}", f"{row['left']:.1f}"
        words = [row[method]["outcome"] for method in baseline_rows]
        table.add_row(row["dataset"], ", ".join(row["hidden"]), *sizes, row["verdict"], told, row["outcome"], *words)
    out = Console(width=150, highlight=False)
    out.print(table)
    methods = whole.pop("methods", {})
    aims = Table("", "measured", "of", "aimed at", "met")
    for one in compute_metrics(rows):
        value = "-" if one.value is None else f"{one.value:.3g}"
        aims.add_row(one.name, value, str(one.of), one.target, {None: "", True: "yes", False: "no"}[one.met])
    out.print(aims)
    out.print({key: value for key, value in whole.items() if key != "metrics"})
    if methods:
        out.print(_build_methods_table(methods))


def _build_methods_table(methods: Mapping[str, Mapping[str, Any]]) -> Table:
    table = Table(
        "method",
        "outcomes",
        "median s",
        f"share of the gap above the floor removed on show trials, median ({REFIT_METHOD}: gap left / floor, 0 names)",
    )
    for name, found in methods.items():
        if name == REFIT_METHOD:
            table.add_row(name, "", "", _format_number(found["gap_over_floor"]))
        else:
            words = ", ".join(f"{count} {word}" for word, count in found["outcomes"].items())
            table.add_row(name, words, f"{found['median_s']:.0f}", _format_number(found["gap_removed"]))
    return table


def _format_number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _count_outcomes(rows: Sequence[DatasetResult]) -> dict[str, int]:
    words = [row.outcome for row in rows]
    return {word: words.count(word) for word in dict.fromkeys(words)}


def _summarise_method(rows: Sequence[DatasetResult]) -> dict[str, Any]:
    """Counts, time, and the share of the gap removed, of datasets that have one."""
    return {
        "outcomes": _count_outcomes(rows),
        "median_s": statistics.median(row.verdict["s"] for row in rows),
        "gap_removed": _median(
            _worst_gap(row)[1] for row in rows if residual_over_noise(row.verdict) >= MAX_ABSORBED_RESIDUAL
        ),
    }


def _worst_gap(row: DatasetResult) -> tuple[float | None, float | None]:
    """Of the channel that a refit leaves worst: its gap over the floor, and the share above it that was removed."""
    gaps = [gap for gap in row.verdict.get("gap", {}).values() if gap["floor"]]
    if not gaps:
        return None, None
    gap = max(gaps, key=lambda each: each["before"] / each["floor"])
    above = gap["before"] - gap["floor"]
    return gap["before"] / gap["floor"], (gap["before"] - gap["after"]) / above if above > 0.0 else None


def _median(values: Iterable[float | None]) -> float | None:
    """Of those that there are."""
    return statistics.median(there) if (there := [value for value in values if value is not None]) else None
