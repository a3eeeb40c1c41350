"""Heatmaps with named rows, drawn in the plane of :mod:`klute_sim.viewer.chart`."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.types import Array
from klute_sim.viewer import chart
from klute_sim.viewer.stream import GREY, WHITE, import_rerun

COLOUR_SCALE = np.array([[20, 20, 60], [60, 90, 160], [240, 200, 90], [220, 50, 40], [255, 235, 235]], dtype=np.float64)
"""Colours from 0 to the maximum, RGB, evenly spaced."""
MISSING_VALUE_COLOUR = np.array([45, 45, 45])
"""Colour of cells without a value, RGB."""
PIXELS_PER_UNIT = 4
"""Number of pixels per unit of the plane, which makes the edges of cells sharp."""
MIN_KEY_LIGHTNESS = 120
"""Smallest red, green and blue of a number in the colour key, which is dark text on black otherwise."""
LABEL_WIDTH = 60.0
"""Width of the margin for the names of the rows."""


class Heatmap(NamedTuple):
    """Values on a grid of named rows and evenly spaced columns."""

    entity: str
    x_label: str
    """Label of the columns' axis, with its unit."""
    edges: Array
    """Edges of the columns, evenly spaced."""
    row_names: tuple[str, ...]
    values: Array
    """Values (rows, columns); NaN where undefined."""
    scale_max: float
    """Value of the last colour."""
    unit: str
    """Unit of the values."""


def build_view(heatmap: Heatmap, name: str) -> Any:
    """Build the view of ``heatmap``."""
    import rerun.blueprint as rrb

    bounds = rrb.VisualBounds2D(
        x_range=[-LABEL_WIDTH, chart.FRAME_WIDTH + chart.MARGIN_RIGHT],
        y_range=[-chart.LEGEND_ROW_HEIGHT - 3.0, chart.FRAME_HEIGHT + chart.MARGIN_BELOW],
    )
    return rrb.Spatial2DView(origin=f"/{heatmap.entity}", name=name, visual_bounds=bounds)


def log_heatmap(stream: Any, heatmap: Heatmap) -> None:
    """Log ``heatmap``: an image, labels of rows and columns, and a colour key."""
    rr, (left, right) = import_rerun(), (float(heatmap.edges[0]), float(heatmap.edges[-1]))
    shape = round(PIXELS_PER_UNIT * chart.FRAME_HEIGHT), round(PIXELS_PER_UNIT * chart.FRAME_WIDTH)
    row, column = (
        np.minimum((np.arange(n) * count) // n, count - 1) for n, count in zip(shape, heatmap.values.shape, strict=True)
    )
    stream.log(f"{heatmap.entity}/map", rr.Transform3D(scale=1.0 / PIXELS_PER_UNIT), static=True)
    stream.log(f"{heatmap.entity}/map", rr.Image(map_colours(heatmap)[row[:, None], column[None, :]]), static=True)
    tick_values = chart.compute_ticks(left, right)
    positions = [[chart.FRAME_WIDTH * (x - left) / (right - left), chart.FRAME_HEIGHT + 1.5] for x in tick_values]
    texts = [chart.format_tick(x, tick_values) for x in tick_values]
    height = chart.FRAME_HEIGHT / len(heatmap.row_names)
    positions += [[-0.5 * LABEL_WIDTH, height * (k + 0.5) - 3.0] for k in range(len(heatmap.row_names))]
    chart.log_labels(
        stream, f"{heatmap.entity}/ticks", positions, [*texts, *heatmap.row_names], [GREY] * len(positions)
    )
    title = f"across: {heatmap.x_label}, colours: {heatmap.unit}"
    chart.log_labels(
        stream,
        f"{heatmap.entity}/title",
        [[(chart.FRAME_WIDTH - LABEL_WIDTH) / 2.0, chart.FRAME_HEIGHT + 12.0]],
        [title],
        [WHITE],
    )
    steps = np.linspace(0.0, heatmap.scale_max, len(COLOUR_SCALE))
    positions = [
        [chart.FRAME_WIDTH * (k + 0.5) / len(COLOUR_SCALE), -chart.LEGEND_ROW_HEIGHT] for k in range(len(COLOUR_SCALE))
    ]
    key_labels = [f"{value:.3g}{' or more' * (k == len(COLOUR_SCALE) - 1)}" for k, value in enumerate(steps)]
    key_colours = [
        (max(MIN_KEY_LIGHTNESS, int(r)), max(MIN_KEY_LIGHTNESS, int(g)), max(MIN_KEY_LIGHTNESS, int(b)))
        for r, g, b in COLOUR_SCALE
    ]
    chart.log_labels(stream, f"{heatmap.entity}/key", positions, key_labels, key_colours)


def map_colours(heatmap: Heatmap) -> Any:
    """Return the colours (rows, columns, 3) RGB of the values."""
    fraction = np.clip(np.nan_to_num(heatmap.values) / heatmap.scale_max, 0.0, 1.0) * (len(COLOUR_SCALE) - 1)
    rgb = np.stack([np.interp(fraction, range(len(COLOUR_SCALE)), COLOUR_SCALE[:, k]) for k in range(3)], axis=-1)
    rgb[~np.isfinite(heatmap.values)] = MISSING_VALUE_COLOUR
    return np.round(rgb).astype(np.uint8)


def compute_binned_rms(positions: Array, values: Array, edges: Array) -> Array:
    """Return the rms of ``values`` whose ``positions`` are between two ``edges``; NaN in empty bins."""
    count = np.histogram(positions, edges)[0]
    total = np.histogram(positions, edges, weights=values**2)[0]
    return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)


def compute_common_max(maps: Sequence[Array], min_value: float) -> float:
    """Return the value of the last colour for comparable ``maps``: their 98 % quantile, robust to outliers."""
    finite = np.concatenate([values[np.isfinite(values)] for values in maps])
    return max(min_value, float(np.quantile(finite, 0.98)) if len(finite) else 0.0)
