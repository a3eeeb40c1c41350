"""The table of a sweep for a terminal."""

from collections.abc import Sequence
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from klute_sim.sweep.table import FAILURE, Row
from klute_sim.sweep.walk import TRIPS

MOST_ROWS = 40
"""Rows shown; the files have all of them."""
INPUTS = {
    "device": "device",
    "controller": "controller",
    "reference": "reference",
    "speed_asked [m/s]": "speed\nm/s",
    "slope [deg]": "slope\ndeg",
    "mass [kg]": "mass\nkg",
    "stature [m]": "stature\nm",
}
"""Heading -> title of what was asked for, which is shown where it differs."""
OWN = "own"
"""In place of a speed: what reference and legs imply."""
OUTCOMES = {
    "ankle_power_peak [W/kg]": ("power\nW/kg", ".2f"),
    "ankle_work_net [J/kg]": ("net work\nJ/kg", "+.3f"),
    "ankle_moment_peak [N*m/kg]": ("moment\nN·m/kg", ".2f"),
    "moment_distance [sd]": ("moment to\nhuman, sd", ".2f"),
    "air_per_stride [g]": ("air\ng/stride", ".2f"),
}
"""Heading -> title and format of what is shown; the files have more."""


def display(rows: Sequence[Row]) -> Table:
    """The first rows, with the inputs that differ, the main outcomes, and what went wrong."""
    shown = {heading: title for heading, title in INPUTS.items() if len({row[heading] for row in rows}) > 1}
    result = Table(title=Text(f"{len(rows)} combinations"), box=box.SIMPLE_HEAD)
    for title in shown.values():
        result.add_column(title, overflow="fold")
    for title, _ in OUTCOMES.values():
        result.add_column(title, justify="right", no_wrap=True)
    result.add_column("")
    for row in rows[:MOST_ROWS]:
        inputs = [_cell(row[heading], ".4g", OWN) for heading in shown]
        values = [
            "-" if row[heading] is None else format(row[heading], form) for heading, (_, form) in OUTCOMES.items()
        ]
        result.add_row(*inputs, *values, row[FAILURE] or ("it trips" if row[TRIPS] else ""))
    return result


def _cell(value: Any, form: str, missing: str = "-") -> str:
    if value is None:
        return missing
    return value if isinstance(value, str) else format(value, form)


def remarks(rows: Sequence[Row], failed: int) -> list[str]:
    """What a reader has to know beside the table, one sentence each."""
    said = []
    if len(rows) > MOST_ROWS:
        said.append(f"The first {MOST_ROWS} of {len(rows)} combinations are shown; the files have all of them.")
    if failed:
        said.append(f"{failed} of {len(rows)} combinations have no outcomes; the column 'failure' says why.")
    return said
