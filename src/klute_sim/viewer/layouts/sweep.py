"""A sweep for the rerun viewer: each outcome over what was varied, and every row of the table."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from klute_sim.errors import InputError
from klute_sim.viewer import chart, stream
from klute_sim.viewer.stream import PALETTE

TIMELINE, TABLE_ENTITY = "combination", "table"
NUMERIC_INPUTS = {"speed_asked [m/s]": "speed [m/s]", "slope [deg]": "slope [deg]", "mass [kg]": "mass [kg]"}
"""What numbers were asked for -> where they are told; a speed that was not named is the walker's own."""
TEXT_INPUTS = ("device", "controller")
CHARTED_METRICS = {
    "ankle_power_peak [W/kg]": "peak net power [W/kg]",
    "ankle_work_net [J/kg]": "net work [J/kg]",
    "ankle_moment_peak [N*m/kg]": "peak net moment [N·m/kg]",
    "moment_distance [sd]": "moment to human [sd]",
    "air_per_stride [g]": "air in a stride [g]",
    "toe_clearance [mm]": "toe clearance [mm]",
}
"""Heading -> label of what is charted; the table has all."""
MAX_LEGEND_NAMES = 9
"""Curves up to which their names are shown."""

SweepRow = dict[str, Any]


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the table of a sweep's ``folder``; raises MissingExtraError without rerun."""
    table = pq.read_table(folder / "sweep.parquet")
    rows = table.to_pylist()
    if not rows:
        raise InputError(f"{folder} has no walks to show")
    drawn = build_charts(rows)
    with stream.open_recording(path, "sweep", rows, lambda: build_blueprint(drawn)) as out:
        stream.log_text(out, TABLE_ENTITY, format_page(rows))
        for one in itertools.chain.from_iterable(drawn.values()):
            chart.log_chart(out, one)


def find_varied_inputs(rows: Sequence[SweepRow]) -> list[str]:
    """Headings of the inputs that differ between ``rows``."""
    return [name for name in (*TEXT_INPUTS, *NUMERIC_INPUTS) if len({row[name] for row in rows}) > 1]


def build_charts(rows: Sequence[SweepRow]) -> dict[str, list[chart.Chart]]:
    """What was varied -> the outcomes over it; over the row's number where words alone were, or nothing.

    Rows that are alike in all else are one curve.
    """
    numbers = [name for name in find_varied_inputs(rows) if name in NUMERIC_INPUTS]
    found = {}
    for name in numbers or [TIMELINE]:
        others = [each for each in find_varied_inputs(rows) if each != name]
        groups: dict[tuple[Any, ...], list[int]] = {}
        for k, row in enumerate(rows):
            groups.setdefault(tuple(row[each] for each in others) if numbers else (), []).append(k)
        label = NUMERIC_INPUTS.get(name, "row of the table")
        found[label] = [
            _build_chart(
                rows, groups, name, f"chart/{label.split(' [')[0].replace(' ', '_')}/{k}", label, heading, outcome
            )
            for k, (heading, outcome) in enumerate(CHARTED_METRICS.items())
            if any(row[heading] is not None for row in rows)
        ]
    return found


def _build_chart(
    rows: Sequence[SweepRow],
    groups: dict[tuple[Any, ...], list[int]],
    input_name: str,
    entity: str,
    x_label: str,
    heading: str,
    y_label: str,
) -> chart.Chart:
    curves = []
    for n, (group, members) in enumerate(groups.items()):
        x = [
            k + 1.0 if input_name not in NUMERIC_INPUTS else _to_float(rows[k][NUMERIC_INPUTS[input_name]])
            for k in members
        ]
        y = [_to_float(rows[k][heading]) for k in members]
        order = np.argsort(x, kind="stable")
        across, up = np.array(x)[order], np.array(y)[order]
        called = ", ".join("own" if each is None else str(each) for each in group) or "all"
        colour, shown = PALETTE[n % len(PALETTE)], 1 < len(groups) <= MAX_LEGEND_NAMES
        curves.append(chart.ChartCurve(called, colour, across, up, markers_only=True, in_legend=False))
        if input_name in NUMERIC_INPUTS:
            curves.append(chart.ChartCurve(called, colour, across, up, thin=True, in_legend=shown))
    return chart.Chart(entity, x_label, y_label, tuple(curves))


def _to_float(value: float | None) -> float:
    return np.nan if value is None else float(value)


def format_page(rows: Sequence[SweepRow]) -> str:
    """The table: what differs between the rows, and every outcome."""
    constant = {name: rows[0][name] for name in (*TEXT_INPUTS, *NUMERIC_INPUTS) if name not in find_varied_inputs(rows)}
    fixed = ", ".join(f"{name} {'own' if value is None else value}" for name, value in constant.items())
    ends = list(rows[0]).index("step [s]") + 1
    headings = [
        *find_varied_inputs(rows),
        *[name for name in list(rows[0])[ends:] if any(row[name] is not None for row in rows)],
    ]
    table = stream.format_markdown_table(
        ["row", *headings], [[str(k), *(row[name] for name in headings)] for k, row in enumerate(rows, start=1)]
    )
    failed = sum(bool(row["failure"]) for row in rows)
    said = f"{failed} of them have no outcomes; the last column says why." if failed else ""
    return f"# {len(rows)} combinations\n\nAlike in all: {fixed}. {said}\n\n{table}"


def build_blueprint(charts: dict[str, list[chart.Chart]]) -> Any:
    """Layout: a tab for each number that was varied, with a chart for each outcome; then the table."""
    import rerun.blueprint as rrb

    tabs = [
        rrb.Grid(
            *(chart.build_view(one, one.y_label) for one in own), grid_columns=min(3, len(own)), name=f"over {label}"
        )
        for label, own in charts.items()
        if own
    ]
    return stream.build_window_blueprint(rrb.Tabs(*tabs, stream.build_text_view("table", TABLE_ENTITY)), TIMELINE)
