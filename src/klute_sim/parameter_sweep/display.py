"""Table and remarks of a sweep for a terminal."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rich.table import Table

from klute_sim.gait.reference import MAX_GRF_TRACKING_RMS_BW
from klute_sim.parameter_sweep.evaluate import CONTACT_LOST_COLUMN, STATUS_COLUMNS, TRIPS_COLUMN, UNTRACKED_COLUMN
from klute_sim.parameter_sweep.table import FAILURE_COLUMN, SweepRow
from klute_sim.terminal_table import create_table

MAX_ROWS_SHOWN = 40
"""Maximum number of rows shown; the files contain all of them."""
INPUT_TITLES = {
    "device": "device",
    "controller": "controller",
    "reference": "reference",
    "reference_stride_time [s]": "stride\ntime s",
    "speed_requested [m/s]": "speed\nm/s",
    "slope [deg]": "slope\ndeg",
    "mass [kg]": "mass\nkg",
    "stature [m]": "stature\nm",
}
"""Title of each input by column; an input is shown only where it varies."""
MIN_NAME_WIDTH_CHARS = 12
"""Width [characters] that a column of names keeps in a narrow terminal."""
UNTRACKED_REMARK = "not tracked"
"""Remark on a load that is not tracked."""
REFERENCE_SPEED = "reference"
"""Word in place of a speed: the speed that the reference and the leg length imply."""
METRIC_FORMATS = {
    "ankle_power_peak [W/kg]": ("power\nW/kg", ".2f"),
    "ankle_work_net [J/kg]": ("net work\nJ/kg", "+.3f"),
    "ankle_moment_peak [N*m/kg]": ("moment\nN·m/kg", ".2f"),
    "moment_distance [sd]": ("moment to\nhuman, sd", ".2f"),
    "air_per_stride [g]": ("air\ng/stride", ".2f"),
}
"""Title and format of each metric by column; the files contain more metrics."""


JOINT_INPUT_TITLES = {
    "device": "device",
    "proportional [1/rad]": "proportional\n1/rad",
    "integral [1/(rad*s)]": "integral\n1/(rad·s)",
    "derivative [s/rad]": "derivative\ns/rad",
    "mean_action [1]": "mean\naction",
    "load [kg]": "load\nkg",
}
JOINT_METRIC_FORMATS = {
    "angle_error_rms [deg]": ("rms error\ndeg", ".2f"),
    "angle_error_max [deg]": ("max error\ndeg", ".1f"),
    "reward [1]": ("reward\n", ".3f"),
    "action_change_rms [1]": ("rms action\nchange", ".4f"),
}
"""As above, for a sweep of the controlled joint."""


def format_joint_table(rows: Sequence[SweepRow]) -> Table:
    """Return the first rows of a sweep of the controlled joint, as :func:`format_table`."""
    return _format_rows(rows, JOINT_INPUT_TITLES, JOINT_METRIC_FORMATS, "model", lambda row: row[FAILURE_COLUMN] or "")


def collect_joint_remarks(rows: Sequence[SweepRow], n_failed: int) -> list[str]:
    """Return the remarks that belong to the table of the controlled joint, one sentence each."""
    first = rows[0]
    scope = (
        f"Each row is the mean over {first['episodes [1]']} episodes of {first['duration_requested [s]']:g} s with the "
        "same targets."
    )
    return [scope, *_describe_size(rows, n_failed)]


def format_table(rows: Sequence[SweepRow]) -> Table:
    """Return the first rows: the inputs that vary, the main metrics, and the failure or a remark."""
    return _format_rows(rows, INPUT_TITLES, METRIC_FORMATS, REFERENCE_SPEED, _format_remark)


def _format_rows(
    rows: Sequence[SweepRow],
    input_titles: Mapping[str, str],
    metric_formats: Mapping[str, tuple[str, str]],
    placeholder: str,
    format_remark: Callable[[SweepRow], str],
) -> Table:
    varied = {column: title for column, title in input_titles.items() if len({row[column] for row in rows}) > 1}
    table = create_table(title=f"{len(rows)} cases")
    for column, title in varied.items():
        longest = max(len(format_cell(row[column], ".4g", placeholder)) for row in rows)
        table.add_column(title, overflow="fold", min_width=min(longest, MIN_NAME_WIDTH_CHARS))
    for title, _ in metric_formats.values():
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("", min_width=len(UNTRACKED_REMARK))
    for row in rows[:MAX_ROWS_SHOWN]:
        inputs = [format_cell(row[column], ".4g", placeholder) for column in varied]
        values = [
            "-" if row[column] is None else format(row[column], format_spec)
            for column, (_, format_spec) in metric_formats.items()
        ]
        table.add_row(*inputs, *values, format_remark(row))
    return table


def _format_remark(row: SweepRow) -> str:
    """Return the failure of a row, or what makes its gait unusable."""
    problems = {TRIPS_COLUMN: "trips", UNTRACKED_COLUMN: UNTRACKED_REMARK, CONTACT_LOST_COLUMN: "contact lost"}
    return row[FAILURE_COLUMN] or ", ".join(text for column, text in problems.items() if row[column])


def format_cell(value: Any, format_spec: str, placeholder: str = "-") -> str:
    """Return ``value`` as text, and the ``placeholder`` for None."""
    if value is None:
        return placeholder
    return value if isinstance(value, str) else format(value, format_spec)


def collect_remarks(rows: Sequence[SweepRow], n_failed: int) -> list[str]:
    """Return the remarks that belong to the table, one sentence each."""
    remarks = _describe_size(rows, n_failed)
    n_trips, n_untracked, n_lost = (sum(bool(row[column]) for row in rows) for column in STATUS_COLUMNS)
    if n_trips:
        remarks.append(f"In {n_trips} of {len(rows)} cases the foot touches the ground in swing (column 'trips').")
    if n_untracked:
        remarks.append(
            f"In {n_untracked} of {len(rows)} cases the ankle does not carry the load of the reference (column "
            f"'load_not_tracked': rms error above {MAX_GRF_TRACKING_RMS_BW:g} body weights); moments and powers are "
            "not those of walking."
        )
    if n_lost:
        remarks.append(
            f"In {n_lost} of {len(rows)} cases the foot leaves the ground for an instant in stance (column "
            "'contact_lost')."
        )
    return remarks


def _describe_size(rows: Sequence[SweepRow], n_failed: int) -> list[str]:
    remarks = []
    if len(rows) > MAX_ROWS_SHOWN:
        remarks.append(f"The first {MAX_ROWS_SHOWN} of {len(rows)} cases are shown; the files contain all of them.")
    if n_failed:
        remarks.append(f"{n_failed} of {len(rows)} cases failed; the column 'failure' gives the reasons.")
    return remarks
