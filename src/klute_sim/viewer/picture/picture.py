"""Pictures of a rerun recording without a screen: its own views, in its own layout, drawn by matplotlib.

The viewer itself draws without a screen only where there is a Vulkan driver, which an ordinary server has not. So these
are no screenshots of it; they are drawn from what is in the recording.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from klute_sim.errors import InputError
from klute_sim.viewer.picture import render, render_scene, rrd_reader
from klute_sim.viewer.picture.rrd_reader import Container, RrdContents, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

DPI = 110
WINDOW_SIZE_IN, VIEW_SIZE_IN = (16.0, 9.0), (6.4, 4.4)
"""Of the picture of a window, and of a view [inches]."""
UNSUPPORTED_SUFFIXES = {
    ".jpg",
    ".jpeg",
    ".pdf",
    ".svg",
    ".svgz",
    ".eps",
    ".ps",
    ".gif",
    ".bmp",
    ".tif",
    ".tiff",
    ".webp",
}
"""Endings of files that are not drawn, and hardly meant as a folder's."""
MAX_PAGE_HEIGHT_IN = 14.0
"""Of a page of words [inches]."""


def save_pictures(rrd_path: Path, out: Path, cursor: float | None = None) -> list[Path]:
    """Draw ``file`` (.rrd) with the cursor ``at`` a place on its timeline (None: in the middle); what was written.

    The window as it opens to ``out``, if that ends in .png; else every view to a picture of its own in the folder
    ``out``. Raises InputError where nothing can be written, and for a picture of another kind than PNG.
    """
    if out.suffix.lower() in UNSUPPORTED_SUFFIXES:
        raise InputError(f"{out}: pictures are drawn as PNG; give a file that ends in .png, or a folder")
    found = rrd_reader.read_rrd(rrd_path)
    place = compute_middle_cursor(found) if cursor is None else cursor
    try:
        if out.suffix.lower() == ".png":
            out.parent.mkdir(parents=True, exist_ok=True)
            _save_figure(build_window_figure(found, place), out)
            return [out]
        out.mkdir(parents=True, exist_ok=True)
        paths = []
        for number, view in enumerate(rrd_reader.iter_views(found.root), start=1):
            paths.append(out / f"{number:02d}-{_slugify(view.name)}.png")
            _save_figure(build_view_figure(found, view, place), paths[-1])
        return paths
    except OSError as error:
        raise InputError(f"{out} cannot be written: {error.strerror}") from None


def _save_figure(figure: "Figure", path: Path) -> None:
    figure.savefig(path, dpi=DPI, facecolor=render.BACKGROUND_COLOUR)


def _slugify(name: str) -> str:
    """``name`` as part of a file's name."""
    return re.sub(r"[^a-z0-9]+", "-", name.split("[")[0].lower()).strip("-")[:40] or "view"


def compute_middle_cursor(rrd: RrdContents) -> float:
    """Of the timeline; 0 where nothing is on it."""
    stamps = [e.get_times(rrd.timeline) for e in rrd.entities.values() if rrd.timeline in e.times]
    return 0.5 * float(min(map(np.min, stamps)) + max(map(np.max, stamps))) if stamps else 0.0


def build_window_figure(rrd: RrdContents, cursor: float) -> "Figure":
    """The layout as it opens: of tabs, the first."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=WINDOW_SIZE_IN, layout="constrained", facecolor=render.BACKGROUND_COLOUR)
    _draw_layout(figure, rrd, rrd.root, cursor, WINDOW_SIZE_IN)
    return figure


def build_view_figure(rrd: RrdContents, view: View, cursor: float) -> "Figure":
    """One view; a page of words is as high as it has to be."""
    from matplotlib.figure import Figure

    size = VIEW_SIZE_IN
    if view.kind == "TextDocument":
        wide = 2.0 * VIEW_SIZE_IN[0]
        lines = list(
            render.strip_markdown(
                render.join_text(view.select_entities(rrd.entities)), int(wide / render.LETTER_WIDTH_IN)
            )
        )
        size = wide, min(MAX_PAGE_HEIGHT_IN, (len(lines) + 4) * render.LINE_HEIGHT_IN)
    figure = Figure(figsize=size, layout="constrained", facecolor=render.BACKGROUND_COLOUR)
    _draw_layout(figure, rrd, view, cursor, size)
    return figure


def _draw_layout(
    figure: "Figure | SubFigure", rrd: RrdContents, node: View | Container, cursor: float, size: tuple[float, float]
) -> None:
    """Draw ``node`` into ``figure``, which is so large [inches]."""
    if isinstance(node, View):
        _draw_view(figure, rrd, node, cursor, size)
        return
    if node.kind == "tabs":
        _draw_layout(figure, rrd, node.children[0], cursor, size)
        return
    count = len(node.children)
    columns = {"row": count, "column": 1}.get(node.kind, min(node.columns, count))
    rows = -(-count // columns)
    wide = node.shares if node.kind == "row" else (1.0,) * columns
    high = node.shares if node.kind == "column" else (1.0,) * rows
    parts = np.atleast_2d(figure.subfigures(rows, columns, width_ratios=wide, height_ratios=high, squeeze=False))
    for k, child in enumerate(node.children):
        row, column = divmod(k, columns)
        own = size[0] * wide[column] / sum(wide), size[1] * high[row] / sum(high)
        parts[row, column].set_facecolor(render.BACKGROUND_COLOUR)
        _draw_layout(parts[row, column], rrd, child, cursor, own)


def _draw_view(
    figure: "Figure | SubFigure", rrd: RrdContents, view: View, cursor: float, size: tuple[float, float]
) -> None:
    axis = figure.subplots()
    axis.set_facecolor(render.BACKGROUND_COLOUR)
    axis.set_title(view.name, fontsize=render.FONT_SIZE_PT + 1.0, color=render.TEXT_COLOUR, loc="left")
    entities = view.select_entities(rrd.entities)
    if view.kind == "TextDocument":
        render.draw_text(axis, render.join_text(entities), (size[0] - 0.2, size[1] - 0.35))
        return
    draw: dict[str, Callable[..., Any]] = {
        "TimeSeries": render.draw_series,
        "2D": render.draw_plane,
        "3D": render_scene.draw_scene,
    }
    draw[view.kind](axis, view, entities, rrd.timeline, cursor)
