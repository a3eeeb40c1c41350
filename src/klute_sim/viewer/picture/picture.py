"""Pictures of a recording without a screen: its views in its layout, rendered by matplotlib.

They are not screenshots of the viewer, which renders without a screen only with a Vulkan driver; an ordinary server has
none.
"""

import re
import textwrap
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from klute_sim.errors import InputError, KluteSimWarning
from klute_sim.viewer.picture import render, render_scene, rrd_reader
from klute_sim.viewer.picture.rrd_reader import Container, RrdContents, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

DPI = 150
WINDOW_SIZE_IN, VIEW_SIZE_IN = (13.0, 7.8), (6.4, 4.4)
"""Size of the picture of a window, and of a view [inches]."""
TITLE_WIDTH_RATIO = 0.75
"""Part of the width of a view that its title may take."""
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
"""Suffixes of picture formats that are not supported; a folder hardly has such a name."""
MAX_SLUG_CHARS = 40
"""Largest number of characters of the name of a view in a file name."""
MAX_PAGE_HEIGHT_IN = 14.0
"""Maximum height of the picture of a text [inches]."""


def save_pictures(rrd_path: Path, out: Path, cursor: float | None = None) -> list[Path]:
    """Render ``rrd_path`` with the cursor at the position ``cursor`` on its timeline (None: middle); return the paths.

    If ``out`` ends in .png, it is the picture of the window as it opens; otherwise ``out`` is a folder with one picture
    for each view. Raises InputError if ``out`` cannot be written or has the suffix of another picture format.
    """
    if out.suffix.lower() in UNSUPPORTED_SUFFIXES:
        raise InputError(f"cannot write {out}: pictures are PNG files; give a file name that ends in .png, or a folder")
    rrd = rrd_reader.read_rrd(rrd_path)
    begin, end = _find_shown_span(rrd)
    position = 0.5 * (begin + end) if cursor is None else cursor
    if not begin <= position <= end:
        shown = f"the curves show {begin:.4g} to {end:.4g} on the timeline '{rrd.timeline}'"
        warnings.warn(f"{shown}; the cursor, at {position:.4g}, is outside of them", KluteSimWarning, stacklevel=2)
    try:
        if out.suffix.lower() == ".png":
            out.parent.mkdir(parents=True, exist_ok=True)
            _save_figure(build_window_figure(rrd, position), out)
            return [out]
        out.mkdir(parents=True, exist_ok=True)
        paths = []
        for number, view in enumerate(rrd_reader.iter_views(rrd.root), start=1):
            paths.append(out / f"{number:02d}-{_slugify(view.name)}.png")
            _save_figure(build_view_figure(rrd, view, position), paths[-1])
        return paths
    except OSError as error:
        raise InputError(f"{out} cannot be written: {error.strerror}") from None


def _save_figure(figure: "Figure", path: Path) -> None:
    figure.savefig(path, dpi=DPI, facecolor=render.BACKGROUND_COLOUR)


def _slugify(name: str) -> str:
    """Return ``name`` as part of a file name, cut between words."""
    slug = re.sub(r"[^a-z0-9]+", "-", re.split(r"[\[(]", name)[0].lower()).strip("-")
    return (slug if len(slug) <= MAX_SLUG_CHARS else slug[: MAX_SLUG_CHARS + 1].rpartition("-")[0]) or "view"


def _find_shown_span(rrd: RrdContents) -> tuple[float, float]:
    """Return the part of the timeline that the curves show first; (0, 0) if nothing is on it."""
    for view in rrd_reader.iter_views(rrd.root):
        if view.span is not None:
            return view.span
    stamps = [e.get_times(rrd.timeline) for e in rrd.entities.values() if rrd.timeline in e.times]
    return (float(min(map(np.min, stamps))), float(max(map(np.max, stamps)))) if stamps else (0.0, 0.0)


def build_window_figure(rrd: RrdContents, cursor: float) -> "Figure":
    """Render the window as it opens, with the first of several tabs."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=WINDOW_SIZE_IN, layout="constrained", facecolor=render.BACKGROUND_COLOUR)
    _draw_layout(figure, rrd, rrd.root, cursor, WINDOW_SIZE_IN)
    return figure


def build_view_figure(rrd: RrdContents, view: View, cursor: float) -> "Figure":
    """Render one view; a text is as high as its lines require."""
    from matplotlib.figure import Figure

    size = VIEW_SIZE_IN
    if view.kind == "TextDocument":
        width = 2.0 * VIEW_SIZE_IN[0]
        lines = list(
            render.strip_markdown(
                render.join_text(view.select_entities(rrd.entities)), int(width / render.LETTER_WIDTH_IN)
            )
        )
        size = width, min(MAX_PAGE_HEIGHT_IN, (len(lines) + 4) * render.LINE_HEIGHT_IN)
    figure = Figure(figsize=size, layout="constrained", facecolor=render.BACKGROUND_COLOUR)
    _draw_layout(figure, rrd, view, cursor, size)
    return figure


def _draw_layout(
    figure: "Figure | SubFigure", rrd: RrdContents, node: View | Container, cursor: float, size: tuple[float, float]
) -> None:
    """Draw ``node`` into ``figure``, which has ``size`` (width, height) [inches]."""
    if isinstance(node, View):
        _draw_view(figure, rrd, node, cursor, size)
        return
    if node.kind == "tabs":
        _draw_layout(figure, rrd, node.children[0], cursor, size)
        return
    count = len(node.children)
    columns = {"row": count, "column": 1}.get(node.kind, min(node.columns, count))
    rows = -(-count // columns)
    widths = node.relative_sizes if node.kind == "row" else (1.0,) * columns
    heights = node.relative_sizes if node.kind == "column" else (1.0,) * rows
    parts = np.atleast_2d(figure.subfigures(rows, columns, width_ratios=widths, height_ratios=heights, squeeze=False))
    for k, child in enumerate(node.children):
        row, column = divmod(k, columns)
        child_size = size[0] * widths[column] / sum(widths), size[1] * heights[row] / sum(heights)
        parts[row, column].set_facecolor(render.BACKGROUND_COLOUR)
        _draw_layout(parts[row, column], rrd, child, cursor, child_size)


def _draw_view(
    figure: "Figure | SubFigure", rrd: RrdContents, view: View, cursor: float, size: tuple[float, float]
) -> None:
    axis = figure.subplots()
    axis.set_facecolor(render.BACKGROUND_COLOUR)
    title = textwrap.fill(view.name, int(TITLE_WIDTH_RATIO * size[0] / render.LETTER_WIDTH_IN))
    axis.set_title(title, fontsize=render.FONT_SIZE_PT + 1.0, color=render.TEXT_COLOUR, loc="left")
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
