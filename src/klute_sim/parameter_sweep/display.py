"""The table of a sweep for a terminal."""

from collections.abc import Sequence
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from klute_sim.parameter_sweep.evaluate import TRIPS_COLUMN
from klute_sim.parameter_sweep.table import FAILURE_COLUMN, SweepRow

MAX_ROWS_SHOWN = 40
"""Rows shown; the files have all of them."""
INPUT_TITLES = {
    "device": "device",
    "controller": "controller",
    "reference": "reference",
    "speed_asked [m/s]": "speed\nm/s",
    "slope [deg]": "slope\ndeg",
    "mass [kg]": "mass\nkg",
    "stature [m]": "stature\nm",
}
"""Heading -> title of what was asked for, which is shown where it differs."""
REFERENCE_SPEED = "own"
"""In place of a speed: what reference and legs imply."""
METRIC_FORMATS = {
    "ankle_power_peak [W/kg]": ("power\nW/kg", ".2f"),
    "ankle_work_net [J/kg]": ("net work\nJ/kg", "+.3f"),
    "ankle_moment_peak [N*m/kg]": ("moment\nN·m/kg", ".2f"),
    "moment_distance [sd]": ("moment to\nhuman, sd", ".2f"),
    "air_per_stride [g]": ("air\ng/stride", ".2f"),
}
"""Heading -> title and format of what is shown; the files have more."""


def format_table(rows: Sequence[SweepRow]) -> Table:
    """The first rows, with the inputs that differ, the main outcomes, and what went wrong."""
    shown = {heading: title for heading, title in INPUT_TITLES.items() if len({row[heading] for row in rows}) > 1}
    result = Table(title=Text(f"{len(rows)} combinations"), box=box.SIMPLE_HEAD)
    for title in shown.values():
        result.add_column(title, overflow="fold")
    for title, _ in METRIC_FORMATS.values():
        result.add_column(title, justify="right", no_wrap=True)
    result.add_column("")
    for row in rows[:MAX_ROWS_SHOWN]:
        inputs = [_format_cell(row[heading], ".4g", REFERENCE_SPEED) for heading in shown]
        values = [
            "-" if row[heading] is None else format(row[heading], form) for heading, (_, form) in METRIC_FORMATS.items()
        ]
        result.add_row(*inputs, *values, row[FAILURE_COLUMN] or ("it trips" if row[TRIPS_COLUMN] else ""))
    return result


def _format_cell(value: Any, format_spec: str, placeholder: str = "-") -> str:
    if value is None:
        return placeholder
    return value if isinstance(value, str) else format(value, format_spec)


def collect_remarks(rows: Sequence[SweepRow], n_failed: int) -> list[str]:
    """What a reader has to know beside the table, one sentence each."""
    said = []
    if len(rows) > MAX_ROWS_SHOWN:
        said.append(f"The first {MAX_ROWS_SHOWN} of {len(rows)} combinations are shown; the files have all of them.")
    if n_failed:
        said.append(f"{n_failed} of {len(rows)} combinations have no outcomes; the column 'failure' says why.")
    return said
