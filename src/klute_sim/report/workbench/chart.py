"""Curves and points over an axis that is not time: rerun has no such view, so the axes are drawn in a picture plane.

The plane is :data:`WIDE` by :data:`HIGH` units, y down as in rerun; what is charted is scaled into it.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.recording.recording import Samples
from klute_sim.report.workbench.stream import GREY, WHITE, Colour, sdk

WIDE, HIGH = 160.0, 100.0
"""Of the frame."""
BELOW, LEFT, RIGHT = 24.0, 22.0, 6.0
"""Of the frame, what is left for words."""
ROW, PER_ROW = 11.0, 3
"""Height of a row of the legend above the frame, and how many names are in it."""
MARGIN = 0.05
"""Share of the range that stays free at each end."""
MOST_POINTS = 600
"""Of a curve: a loop does not get smoother with more."""
FRAME: Colour = (90, 90, 90)


class Curve(NamedTuple):
    """What is charted; not finite points are left out."""

    name: str
    colour: Colour
    x: Samples
    y: Samples
    dots: bool = False
    """Points that are not joined."""
    thin: bool = False
    """What others are compared with."""
    shown: bool = True
    """With its name in the legend."""


class Chart(NamedTuple):
    """Curves and what their axes are."""

    entity: str
    across: str
    """Label of the horizontal axis, with its unit."""
    up: str
    curves: tuple[Curve, ...]


def view(chart: Chart, name: str) -> Any:
    """The view of ``chart``."""
    import rerun.blueprint as rrb

    above = ROW * -(-len(_named(chart)) // PER_ROW) + 3.0
    bounds = rrb.VisualBounds2D(x_range=[-LEFT, WIDE + RIGHT], y_range=[-above, HIGH + BELOW])
    return rrb.Spatial2DView(origin=f"/{chart.entity}", name=name, visual_bounds=bounds)


def log(stream: Any, chart: Chart, axis: Any = None, cursor: tuple[Samples, Samples] | None = None) -> None:
    """Log ``chart``; with ``axis`` (a rerun TimeColumn), a mark that is at ``cursor`` (x, y) at each of its times."""
    rr = sdk()
    (left, right), (low, high) = _range(c.x for c in chart.curves), _range(c.y for c in chart.curves)

    def place(x: Any, y: Any) -> Samples:
        across = WIDE * (np.asarray(x, np.float64) - left) / (right - left)
        return np.column_stack([across, HIGH * (high - np.asarray(y, np.float64)) / (high - low)])

    _frame(stream, chart, (left, right), (low, high), place)
    for number, curve in enumerate(chart.curves):
        here = f"{chart.entity}/curve_{number:03d}"
        good = np.isfinite(curve.x) & np.isfinite(curve.y)
        points = place(curve.x[good], curve.y[good])
        if curve.dots:
            content: Any = rr.Points2D(points, colors=curve.colour, radii=rr.Radius.ui_points(4.0))
        else:
            every = max(1, -(-len(points) // MOST_POINTS))
            points = np.concatenate([points[::every], points[-1:]])
            width = rr.Radius.ui_points(0.6 if curve.thin else 1.2)
            content = rr.LineStrips2D([points], colors=curve.colour, radii=width)
        stream.log(here, content, static=True)
    _legend(stream, chart)
    if axis is not None and cursor is not None:
        where = f"{chart.entity}/now"
        stream.log(where, rr.Points2D.from_fields(colors=WHITE, radii=rr.Radius.ui_points(5.0)), static=True)
        stream.send_columns(where, indexes=[axis], columns=rr.Points2D.columns(positions=place(*cursor)))


def _range(values: Any) -> tuple[float, float]:
    known = np.concatenate([v[np.isfinite(v)] for v in values] or [np.zeros(1)])
    if not len(known):
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    pad = MARGIN * (high - low) or 0.05 * abs(high) or 1.0
    return low - pad, high + pad


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Round numbers between ``low`` and ``high``, not more than ``most``."""
    raw = (high - low) / most
    size = 10.0 ** np.floor(np.log10(raw))
    step = float(next(size * f for f in (1.0, 2.0, 5.0, 10.0) if size * f >= raw * (1.0 - 1e-9)))
    return [k * step for k in range(int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9)) + 1)]


def _frame(stream: Any, chart: Chart, across: tuple[float, float], up: tuple[float, float], place: Any) -> None:
    rr = sdk()
    (left, right), (low, high) = across, up
    strips = [place([left, right, right, left, left], [low, low, high, high, low])]
    strips += [place([x, x], [low, high]) for x in ticks(left, right)]
    strips += [place([left, right], [y, y]) for y in ticks(low, high, 5)]
    stream.log(
        f"{chart.entity}/axes", rr.LineStrips2D(strips, colors=FRAME, radii=rr.Radius.ui_points(0.3)), static=True
    )
    spots = [place([x], [low])[0] + [0.0, 1.5] for x in ticks(left, right)]
    spots += [place([left], [y])[0] + [-7.0, -3.0] for y in ticks(low, high, 5)]
    texts = [number(v, ticks(left, right)) for v in ticks(left, right)]
    texts += [number(v, ticks(low, high, 5)) for v in ticks(low, high, 5)]
    write(stream, f"{chart.entity}/ticks", spots, texts, [GREY] * len(texts))
    title = f"across: {chart.across}, up: {chart.up}"
    write(stream, f"{chart.entity}/title", [[WIDE / 2.0, HIGH + 12.0]], [title], [WHITE])


def number(value: float, among: Sequence[float]) -> str:
    """``value`` with as many decimals as tell it from its neighbours ``among`` the ticks."""
    step = among[1] - among[0] if len(among) > 1 else abs(value) or 1.0
    return f"{value + 0.0:.{max(0, min(6, int(np.ceil(-np.log10(step) - 1e-9))))}f}"


def _named(chart: Chart) -> list[Curve]:
    return [curve for curve in chart.curves if curve.shown]


def _legend(stream: Any, chart: Chart) -> None:
    named = _named(chart)
    spots = [[WIDE * (k % PER_ROW + 0.5) / PER_ROW, -ROW * (k // PER_ROW + 1)] for k in range(len(named))]
    write(stream, f"{chart.entity}/legend", spots, [c.name for c in named], [c.colour for c in named])


def write(stream: Any, entity: str, spots: Any, texts: Sequence[str], colours: Sequence[Colour]) -> None:
    """Words in the plane, each below its spot."""
    rr = sdk()
    if texts:
        dots = rr.Radius.ui_points(0.01)
        content = rr.Points2D(spots, labels=list(texts), colors=list(colours), radii=dots, show_labels=True)
        stream.log(entity, content, static=True)
