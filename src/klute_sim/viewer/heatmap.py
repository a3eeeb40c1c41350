"""A map of numbers in colours, rows with names, for the rerun viewer; in the plane of :mod:`.chart`."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.recording.recording import Array
from klute_sim.viewer import chart
from klute_sim.viewer.stream import GREY, WHITE, import_rerun

COLOUR_SCALE = np.array([[20, 20, 60], [60, 90, 160], [240, 200, 90], [220, 50, 40], [255, 235, 235]], dtype=np.float64)
"""Colours from nothing to the most, RGB, evenly spaced."""
MISSING_VALUE_COLOUR = np.array([45, 45, 45])
"""Where there is no number."""
PIXELS_PER_UNIT = 4
"""Pixels in a unit of the plane: edges of cells are sharp."""
LABEL_WIDTH = 60.0
"""Of the map, what is left for the rows' names."""


class Heatmap(NamedTuple):
    """What is mapped."""

    entity: str
    x_label: str
    """Label of the columns' axis, with its unit."""
    edges: Array
    """Of the columns, evenly spaced."""
    row_names: tuple[str, ...]
    values: Array
    """(rows, columns); NaN where there is none."""
    scale_max: float
    """What the last colour stands for."""
    unit: str
    """Of the values."""


def build_view(heatmap: Heatmap, name: str) -> Any:
    """The view of ``heat``."""
    import rerun.blueprint as rrb

    bounds = rrb.VisualBounds2D(
        x_range=[-LABEL_WIDTH, chart.FRAME_WIDTH + chart.MARGIN_RIGHT],
        y_range=[-chart.LEGEND_ROW_HEIGHT - 3.0, chart.FRAME_HEIGHT + chart.MARGIN_BELOW],
    )
    return rrb.Spatial2DView(origin=f"/{heatmap.entity}", name=name, visual_bounds=bounds)


def log_heatmap(stream: Any, heatmap: Heatmap) -> None:
    """Log ``heat``: an image, what its rows and columns are, and what its colours mean."""
    rr, (left, right) = import_rerun(), (float(heatmap.edges[0]), float(heatmap.edges[-1]))
    shape = round(PIXELS_PER_UNIT * chart.FRAME_HEIGHT), round(PIXELS_PER_UNIT * chart.FRAME_WIDTH)
    row, column = (
        np.minimum((np.arange(n) * count) // n, count - 1) for n, count in zip(shape, heatmap.values.shape, strict=True)
    )
    stream.log(f"{heatmap.entity}/map", rr.Transform3D(scale=1.0 / PIXELS_PER_UNIT), static=True)
    stream.log(f"{heatmap.entity}/map", rr.Image(map_colours(heatmap)[row[:, None], column[None, :]]), static=True)
    places = chart.compute_ticks(left, right)
    spots = [[chart.FRAME_WIDTH * (x - left) / (right - left), chart.FRAME_HEIGHT + 1.5] for x in places]
    texts = [chart.format_tick(x, places) for x in places]
    height = chart.FRAME_HEIGHT / len(heatmap.row_names)
    spots += [[-0.5 * LABEL_WIDTH, height * (k + 0.5) - 3.0] for k in range(len(heatmap.row_names))]
    chart.log_labels(stream, f"{heatmap.entity}/ticks", spots, [*texts, *heatmap.row_names], [GREY] * len(spots))
    title = f"across: {heatmap.x_label}, colours: {heatmap.unit}"
    chart.log_labels(
        stream,
        f"{heatmap.entity}/title",
        [[(chart.FRAME_WIDTH - LABEL_WIDTH) / 2.0, chart.FRAME_HEIGHT + 12.0]],
        [title],
        [WHITE],
    )
    steps = np.linspace(0.0, heatmap.scale_max, len(COLOUR_SCALE))
    spots = [
        [chart.FRAME_WIDTH * (k + 0.5) / len(COLOUR_SCALE), -chart.LEGEND_ROW_HEIGHT] for k in range(len(COLOUR_SCALE))
    ]
    key = [f"{value:.3g}{' or more' * (k == len(COLOUR_SCALE) - 1)}" for k, value in enumerate(steps)]
    shown = [(max(90, int(r)), max(90, int(g)), int(b)) for r, g, b in COLOUR_SCALE]  # dark words on black are none
    chart.log_labels(stream, f"{heatmap.entity}/key", spots, key, shown)


def map_colours(heatmap: Heatmap) -> Any:
    """(rows, columns, 3) RGB."""
    share = np.clip(np.nan_to_num(heatmap.values) / heatmap.scale_max, 0.0, 1.0) * (len(COLOUR_SCALE) - 1)
    found = np.stack([np.interp(share, range(len(COLOUR_SCALE)), COLOUR_SCALE[:, k]) for k in range(3)], axis=-1)
    found[~np.isfinite(heatmap.values)] = MISSING_VALUE_COLOUR
    return np.round(found).astype(np.uint8)


def compute_binned_rms(positions: Array, values: Array, edges: Array) -> Array:
    """Root mean square of ``values`` whose ``place`` is between two ``edges``; NaN where there are none."""
    count = np.histogram(positions, edges)[0]
    total = np.histogram(positions, edges, weights=values**2)[0]
    return np.where(count > 0, np.sqrt(total / np.maximum(count, 1)), np.nan)


def compute_common_max(maps: Sequence[Array], min_value: float) -> float:
    """The last colour of ``maps`` that are to be compared: their 98 % quantile, so that one cell decides nothing."""
    known = np.concatenate([values[np.isfinite(values)] for values in maps])
    return max(min_value, float(np.quantile(known, 0.98)) if len(known) else 0.0)
