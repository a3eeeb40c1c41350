"""What became of the datasets: one row for each, and how every method did."""

import json
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from metrics import Row, metrics
from rich.console import Console
from rich.table import Table
from score import ABSORBED, hidden, kinds_confused, left, named

OWN = "klute-sim"
REFIT = "refit only"


def report(rows: Sequence[Row], others: Mapping[str, Sequence[Row]], *, as_json: bool) -> None:
    """Print the outcome of every dataset, and how often each; the same of ``others``, by the name of the method."""
    whole: dict[str, Any] = {
        "datasets": len(rows),
        "outcomes": _counts(rows),
        "kinds_confused": sum(kinds_confused(row.truth, row.verdict) for row in rows),
        "median_s": statistics.median(row.verdict["s"] for row in rows),
        "metrics": [one._asdict() for one in metrics(rows)],
    }
    if others:
        refit = {"names": 0, "gap_over_floor": _median(_worst(row)[0] for row in rows)}
        whole["methods"] = {OWN: _method(rows), **{name: _method(each) for name, each in others.items()}, REFIT: refit}
    listed = [
        {
            "dataset": row.name,
            "hidden": hidden(row.truth),
            "size": row.truth["size"],
            "left": left(row.verdict),
            "verdict": row.verdict["verdict"],
            "named": named(row.verdict),
            "alternatives": row.verdict["alternatives"],
            "outcome": row.outcome,
            "second": row.second,
            **{
                method: {"named": named(each[k].verdict), "outcome": each[k].outcome} for method, each in others.items()
            },
        }
        for k, row in enumerate(rows)
    ]
    if as_json:
        print(json.dumps({**whole, "rows": listed}, indent=2))
        return
    table = Table("dataset", "hidden", "size", "left", "verdict", "named", "outcome", *others)
    for row in listed:
        told = ", ".join(row["named"]) + ("".join(f" | {', '.join(a)}" for a in row["alternatives"]))
        sizes = f"{row['size']:.1f}", f"{row['left']:.1f}"
        words = [row[method]["outcome"] for method in others]
        table.add_row(row["dataset"], ", ".join(row["hidden"]), *sizes, row["verdict"], told, row["outcome"], *words)
    out = Console(width=150, highlight=False)
    out.print(table)
    methods = whole.pop("methods", {})
    aims = Table("", "measured", "of", "aimed at", "met")
    for one in metrics(rows):
        value = "-" if one.value is None else f"{one.value:.3g}"
        aims.add_row(one.name, value, str(one.of), one.target, {None: "", True: "yes", False: "no"}[one.met])
    out.print(aims)
    out.print({key: value for key, value in whole.items() if key != "metrics"})
    if methods:
        out.print(_compared(methods))


def _compared(methods: Mapping[str, Mapping[str, Any]]) -> Table:
    table = Table(
        "method",
        "outcomes",
        "median s",
        f"share of the gap above the floor removed on show trials, median ({REFIT}: gap left / floor, 0 names)",
    )
    for name, found in methods.items():
        if name == REFIT:
            table.add_row(name, "", "", _number(found["gap_over_floor"]))
        else:
            words = ", ".join(f"{count} {word}" for word, count in found["outcomes"].items())
            table.add_row(name, words, f"{found['median_s']:.0f}", _number(found["gap_removed"]))
    return table


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _counts(rows: Sequence[Row]) -> dict[str, int]:
    words = [row.outcome for row in rows]
    return {word: words.count(word) for word in dict.fromkeys(words)}


def _method(rows: Sequence[Row]) -> dict[str, Any]:
    """Counts, time, and the share of the gap removed, of datasets that have one."""
    return {
        "outcomes": _counts(rows),
        "median_s": statistics.median(row.verdict["s"] for row in rows),
        "gap_removed": _median(_worst(row)[1] for row in rows if left(row.verdict) >= ABSORBED),
    }


def _worst(row: Row) -> tuple[float | None, float | None]:
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
