"""Curves and points over an axis that is not time: rerun has no such view, so the axes are drawn in a picture plane.

The plane is :data:`WIDE` by :data:`HIGH` units, y down as in rerun; what is charted is scaled into it.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.recording.recording import Array
from klute_sim.viewer.stream import GREY, WHITE, Colour, import_rerun

FRAME_WIDTH, FRAME_HEIGHT = 160.0, 100.0
"""Of the frame."""
MARGIN_BELOW, MARGIN_LEFT, MARGIN_RIGHT = 24.0, 22.0, 6.0
"""Of the frame, what is left for words."""
LEGEND_ROW_HEIGHT, NAMES_PER_LEGEND_ROW = 11.0, 3
"""Height of a row of the legend above the frame, and how many names are in it."""
RANGE_PADDING_FRACTION = 0.05
"""Share of the range that stays free at each end."""
MAX_POINTS_PER_CURVE = 600
"""Of a curve: a loop does not get smoother with more."""
FRAME_COLOUR: Colour = (90, 90, 90)


class ChartCurve(NamedTuple):
    """What is charted; not finite points are left out."""

    name: str
    colour: Colour
    x: Array
    y: Array
    markers_only: bool = False
    """Points that are not joined."""
    thin: bool = False
    """What others are compared with."""
    in_legend: bool = True
    """With its name in the legend."""


class Chart(NamedTuple):
    """Curves and what their axes are."""

    entity: str
    x_label: str
    """Label of the horizontal axis, with its unit."""
    y_label: str
    curves: tuple[ChartCurve, ...]


def build_view(chart: Chart, name: str) -> Any:
    """The view of ``chart``."""
    import rerun.blueprint as rrb

    above = LEGEND_ROW_HEIGHT * -(-len(_select_legend_curves(chart)) // NAMES_PER_LEGEND_ROW) + 3.0
    bounds = rrb.VisualBounds2D(
        x_range=[-MARGIN_LEFT, FRAME_WIDTH + MARGIN_RIGHT], y_range=[-above, FRAME_HEIGHT + MARGIN_BELOW]
    )
    return rrb.Spatial2DView(origin=f"/{chart.entity}", name=name, visual_bounds=bounds)


def log_chart(stream: Any, chart: Chart, axis: Any = None, cursor: tuple[Array, Array] | None = None) -> None:
    """Log ``chart``; with ``axis`` (a rerun TimeColumn), a mark that is at ``cursor`` (x, y) at each of its times."""
    rr = import_rerun()
    (left, right), (low, high) = (
        _compute_padded_range(c.x for c in chart.curves),
        _compute_padded_range(c.y for c in chart.curves),
    )

    def place(x: Any, y: Any) -> Array:
        across = FRAME_WIDTH * (np.asarray(x, np.float64) - left) / (right - left)
        return np.column_stack([across, FRAME_HEIGHT * (high - np.asarray(y, np.float64)) / (high - low)])

    _log_frame(stream, chart, (left, right), (low, high), place)
    for number, curve in enumerate(chart.curves):
        here = f"{chart.entity}/curve_{number:03d}"
        good = np.isfinite(curve.x) & np.isfinite(curve.y)
        points = place(curve.x[good], curve.y[good])
        if curve.markers_only:
            content: Any = rr.Points2D(points, colors=curve.colour, radii=rr.Radius.ui_points(4.0))
        else:
            every = max(1, -(-len(points) // MAX_POINTS_PER_CURVE))
            points = np.concatenate([points[::every], points[-1:]])
            width = rr.Radius.ui_points(0.6 if curve.thin else 1.2)
            content = rr.LineStrips2D([points], colors=curve.colour, radii=width)
        stream.log(here, content, static=True)
    _log_legend(stream, chart)
    if axis is not None and cursor is not None:
        where = f"{chart.entity}/now"
        stream.log(where, rr.Points2D.from_fields(colors=WHITE, radii=rr.Radius.ui_points(5.0)), static=True)
        stream.send_columns(where, indexes=[axis], columns=rr.Points2D.columns(positions=place(*cursor)))


def _compute_padded_range(values: Any) -> tuple[float, float]:
    known = np.concatenate([v[np.isfinite(v)] for v in values] or [np.zeros(1)])
    if not len(known):
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    pad = RANGE_PADDING_FRACTION * (high - low) or 0.05 * abs(high) or 1.0
    return low - pad, high + pad


def compute_ticks(lower: float, upper: float, max_ticks: int = 6) -> list[float]:
    """Round numbers between ``low`` and ``high``, not more than ``most``."""
    raw = (upper - lower) / max_ticks
    size = 10.0 ** np.floor(np.log10(raw))
    step = float(next(size * f for f in (1.0, 2.0, 5.0, 10.0) if size * f >= raw * (1.0 - 1e-9)))
    return [k * step for k in range(int(np.ceil(lower / step - 1e-9)), int(np.floor(upper / step + 1e-9)) + 1)]


def _log_frame(
    stream: Any, chart: Chart, x_range: tuple[float, float], y_range: tuple[float, float], to_plane: Any
) -> None:
    rr = import_rerun()
    (left, right), (low, high) = x_range, y_range
    strips = [to_plane([left, right, right, left, left], [low, low, high, high, low])]
    strips += [to_plane([x, x], [low, high]) for x in compute_ticks(left, right)]
    strips += [to_plane([left, right], [y, y]) for y in compute_ticks(low, high, 5)]
    stream.log(
        f"{chart.entity}/axes",
        rr.LineStrips2D(strips, colors=FRAME_COLOUR, radii=rr.Radius.ui_points(0.3)),
        static=True,
    )
    spots = [to_plane([x], [low])[0] + [0.0, 1.5] for x in compute_ticks(left, right)]
    spots += [to_plane([left], [y])[0] + [-7.0, -3.0] for y in compute_ticks(low, high, 5)]
    texts = [format_tick(v, compute_ticks(left, right)) for v in compute_ticks(left, right)]
    texts += [format_tick(v, compute_ticks(low, high, 5)) for v in compute_ticks(low, high, 5)]
    log_labels(stream, f"{chart.entity}/ticks", spots, texts, [GREY] * len(texts))
    title = f"across: {chart.x_label}, up: {chart.y_label}"
    log_labels(stream, f"{chart.entity}/title", [[FRAME_WIDTH / 2.0, FRAME_HEIGHT + 12.0]], [title], [WHITE])


def format_tick(value: float, ticks: Sequence[float]) -> str:
    """``value`` with as many decimals as tell it from its neighbours ``among`` the ticks."""
    step = ticks[1] - ticks[0] if len(ticks) > 1 else abs(value) or 1.0
    return f"{value + 0.0:.{max(0, min(6, int(np.ceil(-np.log10(step) - 1e-9))))}f}"


def _select_legend_curves(chart: Chart) -> list[ChartCurve]:
    return [curve for curve in chart.curves if curve.in_legend]


def _log_legend(stream: Any, chart: Chart) -> None:
    named = _select_legend_curves(chart)
    spots = [
        [
            FRAME_WIDTH * (k % NAMES_PER_LEGEND_ROW + 0.5) / NAMES_PER_LEGEND_ROW,
            -LEGEND_ROW_HEIGHT * (k // NAMES_PER_LEGEND_ROW + 1),
        ]
        for k in range(len(named))
    ]
    log_labels(stream, f"{chart.entity}/legend", spots, [c.name for c in named], [c.colour for c in named])


def log_labels(stream: Any, entity: str, positions: Any, texts: Sequence[str], colours: Sequence[Colour]) -> None:
    """Words in the plane, each below its spot."""
    rr = import_rerun()
    if texts:
        dots = rr.Radius.ui_points(0.01)
        content = rr.Points2D(positions, labels=list(texts), colors=list(colours), radii=dots, show_labels=True)
        stream.log(entity, content, static=True)
