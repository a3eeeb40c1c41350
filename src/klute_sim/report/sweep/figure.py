"""Figure of many runs, one row of a table each: main metrics over the inputs that vary."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from klute_sim.report.style import SERIES_COLOURS, add_heading, get_ordered_colours, get_series_colour, use_style

DESCRIPTION = "Main metrics of all cases over the inputs that vary."
"""Text that stands for the figure where it cannot be seen."""
GAIT_METRICS = {
    "ankle_work_net [J/kg]": "net ankle work [J/kg], generation positive",
    "ankle_power_peak [W/kg]": "peak net ankle power [W/kg]",
    "moment_distance [sd]": "moment, distance to people [sd]",
    "air_per_stride [g]": "air per stride [g]",
}
"""Column of a gait -> title of its panel."""
WALK_METRICS = {
    "cost_minetti [J/kg/m]": "metabolic cost, Minetti [J/kg/m]",
    "speed [m/s]": "walking speed [m/s]",
    "step_asymmetry [1]": "step asymmetry [1], longer left step positive",
    "load_peak_left [1]": "peak load, intact leg [body weights]",
}
"""Column of a predicted walk -> title of its panel."""
JOINT_METRICS = {
    "angle_error_rms [deg]": "rms error of the angle [deg], less is better",
    "action_change_rms [1]": "rms change of the commands [1], less is calmer",
}
"""Column of the controlled joint -> title of its panel."""
REQUESTED_SPEED = "speed_requested [m/s]"
"""Column of the speed; None stands for the one that reference and leg length imply."""
MARKERS, LINE_STYLES = ("o", "s", "^", "D", "v"), ("-", "--", ":", "-.")
MAX_SHIFT = 0.03
"""Distance, as a fraction of the axis, over which coinciding standard deviations are drawn side by side."""
MAX_LABEL_CHARS = 34
"""Maximum length of the name of a case on an axis [characters]."""
MAX_SERIES = len(SERIES_COLOURS)
"""Maximum number of values without an order that colours tell apart."""

Row = Mapping[str, Any]
"""Value by column."""


class Layout(NamedTuple):
    """Columns that the figure shows."""

    over: str | None
    """Column along the axis; None: there is one case."""
    has_lines: bool
    """Whether the axis is a numeric scale, with lines; otherwise the values are names below each other."""
    colour: str | None
    """Column that colours tell apart."""
    style: str | None
    """Column that markers and line styles tell apart."""


def choose_layout(rows: Sequence[Row], inputs: Sequence[str], over: str | None = None) -> Layout:
    """Return the layout for the columns ``inputs`` that vary in ``rows``: the one with most values is the axis.

    Numeric columns are preferred, and columns that follow from the others are left out. ``over`` is the axis.
    """
    varied = [column for column in inputs if column != over and _count(rows, [column]) > 1]
    chosen = [over] if over else []
    for column in sorted(varied, key=lambda column: (not _is_numeric(rows, column), -_count(rows, [column]))):
        if not chosen or _count(rows, [*chosen, column]) > _count(rows, chosen):
            chosen.append(column)
    if not chosen:
        return Layout(None, False, None, None)
    first, *others = chosen
    is_numeric = _is_numeric(rows, first)
    return Layout(first, is_numeric, *[*others, None, None][:2])


def _count(rows: Sequence[Row], columns: Sequence[str]) -> int:
    return len({tuple(row[column] for column in columns) for row in rows})


def _is_numeric(rows: Sequence[Row], column: str) -> bool:
    return all(isinstance(row[column], int | float) for row in rows)


def build_figure(
    rows: Sequence[Row],
    inputs: Sequence[str],
    metrics: Mapping[str, str],
    unusable: Sequence[str] = (),
    over: str | None = None,
    heading: str = "",
) -> Figure:
    """Plot the ``metrics`` (column -> title) of ``rows`` over the columns ``inputs`` that vary.

    Rows that differ in none of the shown columns, such as walks of several persons, give their mean and standard
    deviation. Rows with a true value in a column ``unusable`` have open markers; those without a value are left out.
    """
    rows = [_fill(row) for row in rows] if any(row.get(REQUESTED_SPEED) is not None for row in rows) else rows
    layout = choose_layout(rows, inputs, over)
    groups = _group(rows, layout)
    names = list(dict.fromkeys(_format_value(row[layout.over]) if layout.over else "" for row in rows))
    columns = min(2, len(metrics))
    n_rows = -(-len(metrics) // columns)
    height = 2.6 if layout.has_lines else 1.0 + 0.26 * len(names)
    with use_style() as create_figure:
        figure = create_figure(1.0 + max(height, 1.6) * n_rows)
        axes = figure.subplots(n_rows, columns, squeeze=False, sharey=not layout.has_lines)
        for axis, (column, title) in zip(axes.flat, metrics.items(), strict=False):
            _plot_metric(axis, groups, layout, names, column, unusable)
            axis.set_title(title)
        for unused in axes.flat[len(metrics) :]:
            unused.set_axis_off()
        add_heading(figure, heading or f"{len(rows)} cases", _build_legend(rows, layout, unusable), max_columns=3)
    return figure


def _fill(row: Row) -> Row:
    """Return ``row`` with the speed of the reference where none was requested."""
    return {**row, REQUESTED_SPEED: row.get("speed [m/s]")} if row[REQUESTED_SPEED] is None else row


def _group(rows: Sequence[Row], layout: Layout) -> dict[tuple[Any, Any], list[Row]]:
    """Return the rows of each combination of colour and style."""
    groups: dict[tuple[Any, Any], list[Row]] = {}
    for row in rows:
        key = (row[layout.colour] if layout.colour else None, row[layout.style] if layout.style else None)
        groups.setdefault(key, []).append(row)
    return groups


def _plot_metric(
    axis: Axes,
    groups: Mapping[tuple[Any, Any], Sequence[Row]],
    layout: Layout,
    names: Sequence[str],
    column: str,
    unusable: Sequence[str],
) -> None:
    """Plot means and standard deviations of ``column`` for every group."""
    colours, styles = _map_colours(groups), _map_styles(groups)
    column_values = [row[layout.over] for rows in groups.values() for row in rows] if layout.over else []
    positions = column_values if layout.has_lines else [0.0]
    span = MAX_SHIFT / max(1, len(groups)) * (max(positions) - min(positions))
    for number, ((colour_value, style_value), rows) in enumerate(groups.items()):
        points = _average(rows, layout.over, column, unusable)
        colour, (marker, line_style) = colours[colour_value], styles[style_value]
        shift = span * (number - 0.5 * (len(groups) - 1)) if any(point.deviation for point in points) else 0.0
        dodge = 0.5 * ((number + 0.5) / len(groups) - 0.5)
        for point in points:
            x, y = point.mean, names.index(point.name) + dodge
            style: Any = {"marker": marker, "color": colour, "linestyle": "", "markersize": 5, "elinewidth": 1.0}
            if layout.has_lines:
                x, y = point.position + shift, point.mean
            style["markerfacecolor"] = "none" if point.is_unusable else colour
            style["yerr" if layout.has_lines else "xerr"] = point.deviation
            axis.errorbar(x, y, **style)
        if layout.has_lines:
            ordered = sorted((point.position + shift, point.mean) for point in points)
            axis.plot(*zip(*ordered, strict=True) if ordered else ([], []), line_style, color=colour, linewidth=1.1)
    if layout.has_lines:
        axis.set_xlabel(_format_column(layout.over))
    else:
        axis.set_yticks(range(len(names)), [_shorten(name) for name in names])
        axis.set_ylim(len(names) - 0.4, -0.6)


class _Point(NamedTuple):
    position: Any
    name: str
    mean: float
    deviation: float | None
    is_unusable: bool


def _average(rows: Sequence[Row], over: str | None, column: str, unusable: Sequence[str]) -> list[_Point]:
    """Return mean and standard deviation of ``column`` at each value of ``over``, in the order of the rows."""
    known = [row for row in rows if row.get(column) is not None]
    points = []
    for position in dict.fromkeys(row[over] if over else None for row in known):
        here = [row for row in known if not over or row[over] == position]
        values = [float(row[column]) for row in here]
        mean = math.fsum(values) / len(values)
        squares = math.fsum((value - mean) ** 2 for value in values)
        deviation = math.sqrt(squares / (len(values) - 1)) if len(values) > 1 else None
        is_unusable = any(row.get(name) for row in here for name in unusable)
        points.append(_Point(position, _format_value(position) if over else "", mean, deviation, is_unusable))
    return points


def _map_colours(groups: Mapping[tuple[Any, Any], object]) -> dict[Any, str]:
    """Return colour by value: ordered for numbers, the same from :data:`MAX_SERIES` names on."""
    values = list(dict.fromkeys(colour for colour, _ in groups))
    if len(values) > 1 and all(isinstance(value, int | float) for value in values):
        return dict(get_ordered_colours(values))
    return {value: get_series_colour(min(number, MAX_SERIES - 1)) for number, value in enumerate(values)}


def _map_styles(groups: Mapping[tuple[Any, Any], object]) -> dict[Any, tuple[str, str]]:
    """Return marker and line style by value, used again from the first."""
    values = list(dict.fromkeys(style for _, style in groups))
    return {
        value: (MARKERS[number % len(MARKERS)], LINE_STYLES[number % len(LINE_STYLES)])
        for number, value in enumerate(values)
    }


def _build_legend(rows: Sequence[Row], layout: Layout, unusable: Sequence[str]) -> list[Line2D]:
    """Return one entry for each colour, each style, and open markers."""
    groups, entries = _group(rows, layout), []
    if layout.colour:
        for value, colour in list(_map_colours(groups).items())[:MAX_SERIES]:
            label = f"{_format_column(layout.colour, value)}"
            entries.append(Line2D([], [], color=colour, marker="o", linestyle="", markersize=5, label=label))
    if layout.style:
        for value, (marker, style) in _map_styles(groups).items():
            label = f"{_format_column(layout.style, value)}"
            appearance: Any = {"marker": marker, "linestyle": style if layout.has_lines else "", "label": label}
            entries.append(Line2D([], [], color="0.3", markersize=5, **appearance))
    shown = [name for name in unusable if any(row.get(name) for row in rows)]
    if shown:
        label = f"open: {', '.join(name.replace('_', ' ') for name in shown)}"
        entries.append(Line2D([], [], color="0.3", marker="o", markerfacecolor="none", linestyle="", label=label))
    return entries


def _format_column(column: str | None, value: Any = None) -> str:
    """Return ``column`` in words, with ``value`` and its unit if there is one."""
    name, _, unit = (column or "").replace("_", " ").partition(" [")
    name, unit = name.replace(" requested", ""), unit.rstrip("]").replace("*", "·")
    if value is None:
        return f"{name} [{unit}]" if unit else name
    if isinstance(value, int | float):
        return f"{name} {_format_value(value)} {unit}".rstrip()
    return _shorten(_format_value(value))


def _format_value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else "reference" if value is None else str(value)


def _shorten(text: str) -> str:
    return text if len(text) <= MAX_LABEL_CHARS else f"{text[: MAX_LABEL_CHARS - 1]}…"
