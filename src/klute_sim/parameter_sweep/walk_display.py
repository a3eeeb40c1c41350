"""Table and remarks of a sweep of walks for a terminal: means over the walkers of each condition."""

import math
from collections.abc import Sequence

from rich.table import Table

from klute_sim.parameter_sweep.display import MAX_ROWS_SHOWN, MIN_NAME_WIDTH_CHARS, format_cell
from klute_sim.parameter_sweep.table import FAILURE_COLUMN, SweepRow
from klute_sim.parameter_sweep.walk_metrics import ACUTE_COLUMN, FELL_COLUMN
from klute_sim.terminal_table import create_table

WALK_INPUT_TITLES = {
    "device": "device",
    "controller": "controller",
    "slope [deg]": "slope\ndeg",
    "unevenness [mm]": "blocks\nmm",
    "push [N*s]": "push\nN·s",
    "push_phase [%]": "phase\n%",
}
"""Title of each input but the walker by column; an input is shown only where it varies."""
WALK_METRIC_FORMATS = {
    "speed [m/s]": ("speed\nm/s", ".2f"),
    "cost_minetti [J/kg/m]": ("cost, Minetti\nJ/kg/m", ".2f"),
    "cost_bhargava [J/kg/m]": ("cost, Bhargava\nJ/kg/m", ".2f"),
    "step_asymmetry [1]": ("step\nasymmetry", "+.2f"),
    "load_peak_left [1]": ("left peak\nload, BW", ".2f"),
}
"""Title and format of each metric by column; the files contain more metrics."""


def format_walk_table(rows: Sequence[SweepRow]) -> Table:
    """Return the conditions: the inputs that vary, how many persons walked, and means over those who did."""
    varied = {column: title for column, title in WALK_INPUT_TITLES.items() if len({row[column] for row in rows}) > 1}
    groups: dict[tuple[object, ...], list[SweepRow]] = {}
    for row in rows:
        groups.setdefault(tuple(row[column] for column in WALK_INPUT_TITLES), []).append(row)
    table = create_table(title=f"{len(groups)} conditions, {len(rows)} walks")
    for column, heading in varied.items():
        longest = max(len(format_cell(row[column], ".4g")) for row in rows)
        table.add_column(heading, overflow="fold", min_width=min(longest, MIN_NAME_WIDTH_CHARS))
    table.add_column("walked", justify="right")
    for heading, _ in WALK_METRIC_FORMATS.values():
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("")
    for group in list(groups.values())[:MAX_ROWS_SHOWN]:
        walked = [row for row in group if row[FAILURE_COLUMN] is None and not row[FELL_COLUMN]]
        means = [
            _format_mean([row[column] for row in walked], spec) for column, (_, spec) in WALK_METRIC_FORMATS.items()
        ]
        inputs = [format_cell(group[0][column], ".4g") for column in varied]
        failures = [row[FAILURE_COLUMN] for row in group if row[FAILURE_COLUMN] is not None]
        is_acute = any(row[ACUTE_COLUMN] for row in group)
        remark = failures[0] if failures else "acute" if is_acute else "adapted"
        table.add_row(*inputs, f"{len(walked)} of {len(group)}", *means, remark)
    return table


def _format_mean(values: Sequence[float | None], spec: str) -> str:
    known = [value for value in values if value is not None]
    return format(math.fsum(known) / len(known), spec) if known else "-"


def collect_walk_remarks(rows: Sequence[SweepRow], n_failed: int) -> list[str]:
    """Return the remarks that belong to the table, one sentence each."""
    remarks = ["Predicted (planar reflex model); means over the walkers that did not fall."]
    if n_failed:
        remarks.append(f"{n_failed} of {len(rows)} cases failed; the column 'failure' gives the reasons.")
    n_acute = sum(bool(row[ACUTE_COLUMN]) for row in rows)
    if n_acute:
        remarks.append(
            f"In {n_acute} of {len(rows)} walks the person has not adapted to the condition (column 'acute'), which "
            "favours the condition for which the walker was found."
        )
    n_fell = sum(bool(row[FELL_COLUMN]) for row in rows)
    if n_fell:
        remarks.append(
            f"{n_fell} of {len(rows)} walks end in a fall: compare means only between conditions that the same walkers "
            "survive; klute-sim walk compare pairs the walkers."
        )
    return remarks
