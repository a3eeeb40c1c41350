"""A sweep for the rerun viewer: each outcome over what was varied, and every row of the table."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from klute_sim.errors import InputError
from klute_sim.report.workbench import chart, stream
from klute_sim.report.workbench.stream import MANY

TIMELINE, TABLE = "combination", "table"
INPUTS = {"speed_asked [m/s]": "speed [m/s]", "slope [deg]": "slope [deg]", "mass [kg]": "mass [kg]"}
"""What numbers were asked for -> where they are told; a speed that was not named is the walker's own."""
WORDS = ("device", "controller")
OUTCOMES = {
    "ankle_power_peak [W/kg]": "peak net power [W/kg]",
    "ankle_work_net [J/kg]": "net work [J/kg]",
    "ankle_moment_peak [N*m/kg]": "peak net moment [N·m/kg]",
    "moment_distance [sd]": "moment to human [sd]",
    "air_per_stride [g]": "air in a stride [g]",
    "toe_clearance [mm]": "toe clearance [mm]",
}
"""Heading -> label of what is charted; the table has all."""
MOST_NAMES = 9
"""Curves up to which their names are shown."""

Row = dict[str, Any]


def remake(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the table of a sweep's ``folder``; raises MissingExtraError without rerun."""
    table = pq.read_table(folder / "sweep.parquet")
    rows = table.to_pylist()
    if not rows:
        raise InputError(f"{folder} has no walks to show")
    drawn = charts(rows)
    with stream.recorded(path, "sweep", rows, lambda: blueprint(drawn)) as out:
        stream.tell(out, TABLE, page(rows))
        for one in itertools.chain.from_iterable(drawn.values()):
            chart.log(out, one)


def varied(rows: Sequence[Row]) -> list[str]:
    """Headings of the inputs that differ between ``rows``."""
    return [name for name in (*WORDS, *INPUTS) if len({row[name] for row in rows}) > 1]


def charts(rows: Sequence[Row]) -> dict[str, list[chart.Chart]]:
    """What was varied -> the outcomes over it; over the row's number where words alone were, or nothing.

    Rows that are alike in all else are one curve.
    """
    numbers = [name for name in varied(rows) if name in INPUTS]
    found = {}
    for name in numbers or [TIMELINE]:
        others = [each for each in varied(rows) if each != name]
        groups: dict[tuple[Any, ...], list[int]] = {}
        for k, row in enumerate(rows):
            groups.setdefault(tuple(row[each] for each in others) if numbers else (), []).append(k)
        label = INPUTS.get(name, "row of the table")
        found[label] = [
            _chart(rows, groups, name, f"chart/{label.split(' [')[0].replace(' ', '_')}/{k}", label, heading, outcome)
            for k, (heading, outcome) in enumerate(OUTCOMES.items())
            if any(row[heading] is not None for row in rows)
        ]
    return found


def _chart(
    rows: Sequence[Row],
    groups: dict[tuple[Any, ...], list[int]],
    name: str,
    entity: str,
    label: str,
    heading: str,
    outcome: str,
) -> chart.Chart:
    curves = []
    for n, (group, members) in enumerate(groups.items()):
        x = [k + 1.0 if name not in INPUTS else _number(rows[k][INPUTS[name]]) for k in members]
        y = [_number(rows[k][heading]) for k in members]
        order = np.argsort(x, kind="stable")
        across, up = np.array(x)[order], np.array(y)[order]
        called = ", ".join("own" if each is None else str(each) for each in group) or "all"
        colour, shown = MANY[n % len(MANY)], 1 < len(groups) <= MOST_NAMES
        curves.append(chart.Curve(called, colour, across, up, dots=True, shown=False))
        if name in INPUTS:
            curves.append(chart.Curve(called, colour, across, up, thin=True, shown=shown))
    return chart.Chart(entity, label, outcome, tuple(curves))


def _number(value: float | None) -> float:
    return np.nan if value is None else float(value)


def page(rows: Sequence[Row]) -> str:
    """The table: what differs between the rows, and every outcome."""
    constant = {name: rows[0][name] for name in (*WORDS, *INPUTS) if name not in varied(rows)}
    fixed = ", ".join(f"{name} {'own' if value is None else value}" for name, value in constant.items())
    ends = list(rows[0]).index("step [s]") + 1
    headings = [*varied(rows), *[name for name in list(rows[0])[ends:] if any(row[name] is not None for row in rows)]]
    table = stream.table(
        ["row", *headings], [[str(k), *(row[name] for name in headings)] for k, row in enumerate(rows, start=1)]
    )
    failed = sum(bool(row["failure"]) for row in rows)
    said = f"{failed} of them have no outcomes; the last column says why." if failed else ""
    return f"# {len(rows)} combinations\n\nAlike in all: {fixed}. {said}\n\n{table}"


def blueprint(drawn: dict[str, list[chart.Chart]]) -> Any:
    """Layout: a tab for each number that was varied, with a chart for each outcome; then the table."""
    import rerun.blueprint as rrb

    tabs = [
        rrb.Grid(*(chart.view(one, one.up) for one in own), grid_columns=min(3, len(own)), name=f"over {label}")
        for label, own in drawn.items()
        if own
    ]
    return stream.whole(rrb.Tabs(*tabs, stream.words("table", TABLE)), TIMELINE)
