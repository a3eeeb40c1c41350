"""Charts of curves and points over an axis that is not time.

rerun has no such view, so axes and curves are drawn in a 2-D view. Its frame has :data:`FRAME_WIDTH` by
:data:`FRAME_HEIGHT` units, y down as in rerun; the values are scaled to the frame.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.types import Array
from klute_sim.viewer.stream import GREY, WHITE, Colour, import_rerun

FRAME_WIDTH, FRAME_HEIGHT = 160.0, 100.0
"""Size of the frame."""
MARGIN_BELOW, MARGIN_LEFT, MARGIN_RIGHT = 24.0, 22.0, 6.0
"""Margins of the frame for text."""
LEGEND_ROW_HEIGHT, NAMES_PER_LEGEND_ROW = 11.0, 3
"""Height of a row of the legend above the frame, and number of names in a row."""
MIN_RELATIVE_RANGE = 1e-9
"""Smallest range of values that is shown as one, over the largest value."""
RANGE_PADDING_FRACTION = 0.05
"""Fraction of the range that stays free at each end."""
MAX_POINTS_PER_CURVE = 600
"""Maximum number of points of a curve; more points do not make it smoother."""
FRAME_COLOUR: Colour = (90, 90, 90)


class ChartCurve(NamedTuple):
    """A curve of a chart; points that are not finite are omitted."""

    name: str
    colour: Colour
    x: Array
    y: Array
    markers_only: bool = False
    """Whether the points are shown as markers that are not joined."""
    thin: bool = False
    """Whether the line is thin, for curves with which others are compared."""
    in_legend: bool = True
    """Whether the legend has the name of the curve."""


class Chart(NamedTuple):
    """Curves and the labels of their axes."""

    entity: str
    x_label: str
    """Label of the horizontal axis, with its unit."""
    y_label: str
    """Label of the vertical axis, with its unit."""
    curves: tuple[ChartCurve, ...]


def build_view(chart: Chart, name: str) -> Any:
    """Build the view of ``chart``."""
    import rerun.blueprint as rrb

    above = LEGEND_ROW_HEIGHT * -(-len(_select_legend_curves(chart)) // NAMES_PER_LEGEND_ROW) + 3.0
    bounds = rrb.VisualBounds2D(
        x_range=[-MARGIN_LEFT, FRAME_WIDTH + MARGIN_RIGHT], y_range=[-above, FRAME_HEIGHT + MARGIN_BELOW]
    )
    return rrb.Spatial2DView(origin=f"/{chart.entity}", name=name, visual_bounds=bounds)


def log_chart(stream: Any, chart: Chart) -> None:
    """Log frame, curves and legend of ``chart``."""
    rr = import_rerun()
    to_plane = _build_projection(chart)
    _log_frame(stream, chart, to_plane)
    for number, curve in enumerate(chart.curves):
        entity = f"{chart.entity}/curve_{number:03d}"
        is_finite = np.isfinite(curve.x) & np.isfinite(curve.y)
        points = to_plane(curve.x[is_finite], curve.y[is_finite])
        if curve.markers_only:
            content: Any = rr.Points2D(points, colors=curve.colour, radii=rr.Radius.ui_points(4.0))
        else:
            stride = max(1, -(-len(points) // MAX_POINTS_PER_CURVE))
            points = np.concatenate([points[::stride], points[-1:]])
            width = rr.Radius.ui_points(0.6 if curve.thin else 1.2)
            content = rr.LineStrips2D([points], colors=curve.colour, radii=width)
        stream.log(entity, content, static=True)
    _log_legend(stream, chart)


def log_marker(stream: Any, chart: Chart, axis: Any, x: Array, y: Array) -> None:
    """Log a marker in ``chart`` that is at (``x``, ``y``) at the rows of ``axis`` (a rerun TimeColumn)."""
    rr, entity = import_rerun(), f"{chart.entity}/marker"
    stream.log(entity, rr.Points2D.from_fields(colors=WHITE, radii=rr.Radius.ui_points(5.0)), static=True)
    positions = _build_projection(chart)(x, y)
    stream.send_columns(entity, indexes=[axis], columns=rr.Points2D.columns(positions=positions))


def _compute_ranges(chart: Chart) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ranges of both axes of ``chart``."""
    return _compute_padded_range(c.x for c in chart.curves), _compute_padded_range(c.y for c in chart.curves)


def _build_projection(chart: Chart) -> Callable[[Any, Any], Array]:
    """Return the function from values (x, y) to points (n, 2) in the frame of ``chart``."""
    (left, right), (low, high) = _compute_ranges(chart)

    def to_plane(x: Any, y: Any) -> Array:
        plane_x = FRAME_WIDTH * (np.asarray(x, np.float64) - left) / (right - left)
        return np.column_stack([plane_x, FRAME_HEIGHT * (high - np.asarray(y, np.float64)) / (high - low)])

    return to_plane


def _compute_padded_range(values: Any) -> tuple[float, float]:
    """Return the range of all finite ``values`` (an iterable of arrays) with padding."""
    finite = np.concatenate([v[np.isfinite(v)] for v in values] or [np.zeros(1)])
    if not len(finite):
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    largest = max(abs(low), abs(high))
    is_constant = high - low <= MIN_RELATIVE_RANGE * largest  # rounding errors, as of a clamped length, are no range
    padding = (0.05 * largest or 1.0) if is_constant else RANGE_PADDING_FRACTION * (high - low)
    return low - padding, high + padding


def compute_ticks(lower: float, upper: float, max_ticks: int = 6) -> list[float]:
    """Return at most ``max_ticks`` round numbers between ``lower`` and ``upper``."""
    raw = (upper - lower) / max_ticks
    size = 10.0 ** np.floor(np.log10(raw))
    step = float(next(size * f for f in (1.0, 2.0, 5.0, 10.0) if size * f >= raw * (1.0 - 1e-9)))
    return [k * step for k in range(int(np.ceil(lower / step - 1e-9)), int(np.floor(upper / step + 1e-9)) + 1)]


def _log_frame(stream: Any, chart: Chart, to_plane: Callable[[Any, Any], Array]) -> None:
    rr = import_rerun()
    (left, right), (low, high) = _compute_ranges(chart)
    strips = [to_plane([left, right, right, left, left], [low, low, high, high, low])]
    strips += [to_plane([x, x], [low, high]) for x in compute_ticks(left, right)]
    strips += [to_plane([left, right], [y, y]) for y in compute_ticks(low, high, 5)]
    stream.log(
        f"{chart.entity}/axes",
        rr.LineStrips2D(strips, colors=FRAME_COLOUR, radii=rr.Radius.ui_points(0.3)),
        static=True,
    )
    positions = [to_plane([x], [low])[0] + [0.0, 1.5] for x in compute_ticks(left, right)]
    positions += [to_plane([left], [y])[0] + [-7.0, -3.0] for y in compute_ticks(low, high, 5)]
    texts = [format_tick(v, compute_ticks(left, right)) for v in compute_ticks(left, right)]
    texts += [format_tick(v, compute_ticks(low, high, 5)) for v in compute_ticks(low, high, 5)]
    log_labels(stream, f"{chart.entity}/ticks", positions, texts, [GREY] * len(texts))
    title = f"across: {chart.x_label}, up: {chart.y_label}"
    log_labels(stream, f"{chart.entity}/title", [[FRAME_WIDTH / 2.0, FRAME_HEIGHT + 12.0]], [title], [WHITE])


def format_tick(value: float, ticks: Sequence[float]) -> str:
    """Return ``value`` with enough decimals to distinguish neighbouring ``ticks``."""
    step = ticks[1] - ticks[0] if len(ticks) > 1 else abs(value) or 1.0
    return f"{value + 0.0:.{max(0, min(6, int(np.ceil(-np.log10(step) - 1e-9))))}f}"


def _select_legend_curves(chart: Chart) -> list[ChartCurve]:
    return [curve for curve in chart.curves if curve.in_legend]


def _log_legend(stream: Any, chart: Chart) -> None:
    curves = _select_legend_curves(chart)
    positions = [
        [
            FRAME_WIDTH * (k % NAMES_PER_LEGEND_ROW + 0.5) / NAMES_PER_LEGEND_ROW,
            -LEGEND_ROW_HEIGHT * (k // NAMES_PER_LEGEND_ROW + 1),
        ]
        for k in range(len(curves))
    ]
    log_labels(stream, f"{chart.entity}/legend", positions, [c.name for c in curves], [c.colour for c in curves])


def log_labels(stream: Any, entity: str, positions: Any, texts: Sequence[str], colours: Sequence[Colour]) -> None:
    """Log texts in the plane, each below its position."""
    rr = import_rerun()
    if texts:
        dots = rr.Radius.ui_points(0.01)
        content = rr.Points2D(positions, labels=list(texts), colors=list(colours), radii=dots, show_labels=True)
        stream.log(entity, content, static=True)
