"""Viewer recording of a sweep: each metric over the varied inputs, and the table of all combinations."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from klute_sim.errors import InputError
from klute_sim.files.limits import RECORDING
from klute_sim.files.parquet import open_parquet
from klute_sim.files.reading import read_bytes
from klute_sim.viewer import chart, stream
from klute_sim.viewer.stream import PALETTE

TIMELINE, TABLE_ENTITY = "combination", "table"
NUMERIC_INPUTS = {
    "speed_requested [m/s]": "speed [m/s]",
    "slope [deg]": "slope [deg]",
    "mass [kg]": "mass [kg]",
    "push_off_pressure [bar]": "push_off_pressure [bar]",
    "push_off_lean [deg]": "push_off_lean [deg]",
    "foot_stiffness [N*m/deg]": "foot_stiffness [N*m/deg]",
    "unevenness [mm]": "unevenness [mm]",
    "push [N*s]": "push [N*s]",
    "proportional [1/rad]": "proportional [1/rad]",
    "integral [1/(rad*s)]": "integral [1/(rad*s)]",
    "derivative [s/rad]": "derivative [s/rad]",
    "mean_action [1]": "mean_action [1]",
    "load [kg]": "load [kg]",
}
"""Requested input -> column of its actual value; without a requested speed it is the subject's own.

Each rig has some of these.
"""
MACHINE_INPUTS = ("push_off_pressure [bar]", "push_off_lean [deg]")
"""Numbers of a state machine, which are inputs of predicted walks."""
TEXT_INPUTS = ("device", "controller", "reference", "walker")
CHARTED_METRICS = {
    "ankle_power_peak [W/kg]": "peak net power [W/kg]",
    "ankle_work_net [J/kg]": "net work [J/kg]",
    "ankle_moment_peak [N*m/kg]": "peak net moment [N·m/kg]",
    "moment_distance [sd]": "moment to human [sd]",
    "air_per_stride [g]": "air per stride [g]",
    "toe_clearance [mm]": "toe clearance [mm]",
    "cost_minetti [J/kg/m]": "cost, Minetti and Alexander [J/kg/m]",
    "cost_bhargava [J/kg/m]": "cost, Bhargava et al. [J/kg/m]",
    "step_asymmetry [1]": "step asymmetry",
    "load_peak_left [1]": "peak load of the left leg [body weights]",
    "duration [s]": "time walked [s]",
    "angle_error_rms [deg]": "rms error of the angle [deg]",
    "reward [1]": "mean reward",
    "force_flexor_mean [N]": "mean force of the flexor [N]",
}
"""Column -> label of the charted metrics; the table has all metrics."""
MAX_LEGEND_NAMES = 9
"""Maximum number of curves with names in the legend."""

SweepRow = dict[str, Any]


def rebuild_recording(folder: Path, path: Path) -> None:
    """Write ``path`` (.rrd) from the table in the ``folder`` of a sweep.

    Raises MissingExtraError without rerun.
    """
    path_of_table = folder / "sweep.parquet"
    rows = open_parquet(read_bytes(path_of_table, RECORDING), str(path_of_table), with_text=True).read_rows()
    if not rows:
        raise InputError(f"{folder} has no simulated combination to show")
    charts = build_charts(rows)
    with stream.open_recording(path, "sweep", rows, lambda: build_blueprint(charts)) as out:
        stream.log_text(out, TABLE_ENTITY, format_page(rows))
        for metric_chart in itertools.chain.from_iterable(charts.values()):
            chart.log_chart(out, metric_chart)


def find_varied_inputs(rows: Sequence[SweepRow]) -> list[str]:
    """Return the columns of the inputs that differ between ``rows``."""
    inputs = [name for name in (*TEXT_INPUTS, *NUMERIC_INPUTS) if name in rows[0]]
    return [name for name in inputs if len({row[name] for row in rows}) > 1]


def build_charts(rows: Sequence[SweepRow]) -> dict[str, list[chart.Chart]]:
    """Return label of each varied number -> charts of the metrics over it.

    Without a varied number, the charts are over the number of the row. Rows with equal other inputs form one curve, and
    so do several subjects that differ in the number.
    """
    numeric_inputs = [name for name in find_varied_inputs(rows) if name in NUMERIC_INPUTS]
    charts = {}
    for name in numeric_inputs or [TIMELINE]:
        ignored = {name, "reference"} if numeric_inputs and _is_determined_by_reference(rows, name) else {name}
        if name in MACHINE_INPUTS:
            ignored |= {"controller"}  # its name is the numbers of the machine
        others = [other for other in find_varied_inputs(rows) if other not in ignored]
        groups: dict[tuple[Any, ...], list[int]] = {}
        for k, row in enumerate(rows):
            groups.setdefault(tuple(row[other] for other in others) if numeric_inputs else (), []).append(k)
        label = NUMERIC_INPUTS.get(name, "row of the table")
        charts[label] = [
            _build_chart(
                rows, groups, name, f"chart/{label.split(' [')[0].replace(' ', '_')}/{k}", label, heading, y_label
            )
            for k, (heading, y_label) in enumerate(CHARTED_METRICS.items())
            if any(row.get(heading) is not None for row in rows)
        ]
    return charts


def _is_determined_by_reference(rows: Sequence[SweepRow], name: str) -> bool:
    """Return whether each reference has one value of the input ``name``, as of the body mass of its subject."""
    references = {row.get("reference") for row in rows}
    return None not in references and len({(row["reference"], row[name]) for row in rows}) == len(references)


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
        x_sorted, y_sorted = np.array(x)[order], np.array(y)[order]
        name = ", ".join("default" if value is None else str(value) for value in group) or "all"
        colour, in_legend = PALETTE[n % len(PALETTE)], 1 < len(groups) <= MAX_LEGEND_NAMES
        curves.append(chart.ChartCurve(name, colour, x_sorted, y_sorted, markers_only=True, in_legend=False))
        if input_name in NUMERIC_INPUTS:
            curves.append(chart.ChartCurve(name, colour, x_sorted, y_sorted, thin=True, in_legend=in_legend))
    return chart.Chart(entity, x_label, y_label, tuple(curves))


def _to_float(value: float | None) -> float:
    return np.nan if value is None else float(value)


def format_page(rows: Sequence[SweepRow]) -> str:
    """Return the table of varied inputs and all metrics as Markdown."""
    varied = find_varied_inputs(rows)
    names = [name for name in (*TEXT_INPUTS, *NUMERIC_INPUTS) if name in rows[0] and name not in varied]
    constant = {name: rows[0][name] for name in names}
    inputs = ", ".join(f"{name} {'default' if value is None else value}" for name, value in constant.items())
    first_metric = list(rows[0]).index("time_step [s]") + 1
    headings = [
        *find_varied_inputs(rows),
        *[name for name in list(rows[0])[first_metric:] if any(row[name] is not None for row in rows)],
    ]
    table = stream.format_markdown_table(
        ["row", *headings], [[str(k), *(row[name] for name in headings)] for k, row in enumerate(rows, start=1)]
    )
    n_failed = sum(bool(row["failure"]) for row in rows)
    failures = f"{n_failed} of them failed; the last column has the reason." if n_failed else ""
    return f"# {len(rows)} combinations\n\nConstant inputs: {inputs}. {failures}\n\n{table}"


def build_blueprint(charts: dict[str, list[chart.Chart]]) -> Any:
    """Build the layout: a tab of charts for each varied number, and a tab with the table."""
    import rerun.blueprint as rrb

    tabs = [
        rrb.Grid(
            *(chart.build_view(metric_chart, metric_chart.y_label) for metric_chart in metric_charts),
            grid_columns=min(3, len(metric_charts)),
            name=f"over {label}",
        )
        for label, metric_charts in charts.items()
        if metric_charts
    ]
    return stream.build_window_blueprint(rrb.Tabs(*tabs, stream.build_text_view("table", TABLE_ENTITY)), TIMELINE)
