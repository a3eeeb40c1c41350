"""A map of numbers in colours, rows with names, for the rerun viewer; in the plane of :mod:`.chart`."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.recording.recording import Samples
from klute_sim.report.workbench import chart
from klute_sim.report.workbench.stream import GREY, WHITE, sdk

SCALE = np.array([[20, 20, 60], [60, 90, 160], [240, 200, 90], [220, 50, 40], [255, 235, 235]], dtype=np.float64)
"""Colours from nothing to the most, RGB, evenly spaced."""
UNKNOWN = np.array([45, 45, 45])
"""Where there is no number."""
FINE = 4
"""Pixels in a unit of the plane: edges of cells are sharp."""
LEFT = 60.0
"""Of the map, what is left for the rows' names."""


class Heat(NamedTuple):
    """What is mapped."""

    entity: str
    across: str
    """Label of the columns' axis, with its unit."""
    edges: Samples
    """Of the columns, evenly spaced."""
    rows: tuple[str, ...]
    values: Samples
    """(rows, columns); NaN where there is none."""
    top: float
    """What the last colour stands for."""
    unit: str
    """Of the values."""


def view(heat: Heat, name: str) -> Any:
    """The view of ``heat``."""
    import rerun.blueprint as rrb

    bounds = rrb.VisualBounds2D(
        x_range=[-LEFT, chart.WIDE + chart.RIGHT], y_range=[-chart.ROW - 3.0, chart.HIGH + chart.BELOW]
    )
    return rrb.Spatial2DView(origin=f"/{heat.entity}", name=name, visual_bounds=bounds)


def log(stream: Any, heat: Heat) -> None:
    """Log ``heat``: an image, what its rows and columns are, and what its colours mean."""
    rr, (left, right) = sdk(), (float(heat.edges[0]), float(heat.edges[-1]))
    shape = round(FINE * chart.HIGH), round(FINE * chart.WIDE)
    row, column = (
        np.minimum((np.arange(n) * count) // n, count - 1) for n, count in zip(shape, heat.values.shape, strict=True)
    )
    stream.log(f"{heat.entity}/map", rr.Transform3D(scale=1.0 / FINE), static=True)
    stream.log(f"{heat.entity}/map", rr.Image(colours(heat)[row[:, None], column[None, :]]), static=True)
    places = chart.ticks(left, right)
    spots = [[chart.WIDE * (x - left) / (right - left), chart.HIGH + 1.5] for x in places]
    texts = [chart.number(x, places) for x in places]
    height = chart.HIGH / len(heat.rows)
    spots += [[-0.5 * LEFT, height * (k + 0.5) - 3.0] for k in range(len(heat.rows))]
    chart.write(stream, f"{heat.entity}/ticks", spots, [*texts, *heat.rows], [GREY] * len(spots))
    title = f"across: {heat.across}, colours: {heat.unit}"
    chart.write(stream, f"{heat.entity}/title", [[(chart.WIDE - LEFT) / 2.0, chart.HIGH + 12.0]], [title], [WHITE])
    steps = np.linspace(0.0, heat.top, len(SCALE))
    spots = [[chart.WIDE * (k + 0.5) / len(SCALE), -chart.ROW] for k in range(len(SCALE))]
    key = [f"{value:.3g}{' or more' * (k == len(SCALE) - 1)}" for k, value in enumerate(steps)]
    shown = [(max(90, int(r)), max(90, int(g)), int(b)) for r, g, b in SCALE]  # dark words on black are none
    chart.write(stream, f"{heat.entity}/key", spots, key, shown)


def colours(heat: Heat) -> Any:
    """(rows, columns, 3) RGB."""
    share = np.clip(np.nan_to_num(heat.values) / heat.top, 0.0, 1.0) * (len(SCALE) - 1)
    found = np.stack([np.interp(share, range(len(SCALE)), SCALE[:, k]) for k in range(3)], axis=-1)
    found[~np.isfinite(heat.values)] = UNKNOWN
    return np.round(found).astype(np.uint8)


def binned(place: Samples, values: Samples, edges: Samples) -> Samples:
    """Root mean square of ``values`` whose ``place`` is between two ``edges``; NaN where there are none."""
    count = np.histogram(place, edges)[0]
    total = np.histogram(place, edges, weights=values**2)[0]
    return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)


def common(maps: Sequence[Samples], least: float) -> float:
    """The last colour of ``maps`` that are to be compared: their 98 % quantile, so that one cell decides nothing."""
    known = np.concatenate([values[np.isfinite(values)] for values in maps])
    return max(least, float(np.quantile(known, 0.98)) if len(known) else 0.0)
