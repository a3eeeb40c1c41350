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
from klute_sim.report.workbench import contents, drawn, drawn_scene
from klute_sim.report.workbench.contents import Container, Contents, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure, SubFigure

DPI = 110
WHOLE, ONE = (16.0, 9.0), (6.4, 4.4)
"""Of the picture of a window, and of a view [inches]."""
OTHER_PICTURES = {".jpg", ".jpeg", ".pdf", ".svg", ".svgz", ".eps", ".ps", ".gif", ".bmp", ".tif", ".tiff", ".webp"}
"""Endings of files that are not drawn, and hardly meant as a folder's."""
HIGHEST = 14.0
"""Of a page of words [inches]."""


def save(file: Path, out: Path, at: float | None = None) -> list[Path]:
    """Draw ``file`` (.rrd) with the cursor ``at`` a place on its timeline (None: in the middle); what was written.

    The window as it opens to ``out``, if that ends in .png; else every view to a picture of its own in the folder
    ``out``. Raises InputError where nothing can be written, and for a picture of another kind than PNG.
    """
    if out.suffix.lower() in OTHER_PICTURES:
        raise InputError(f"{out}: pictures are drawn as PNG; give a file that ends in .png, or a folder")
    found = contents.read(file)
    place = middle(found) if at is None else at
    try:
        if out.suffix.lower() == ".png":
            out.parent.mkdir(parents=True, exist_ok=True)
            _write(window(found, place), out)
            return [out]
        out.mkdir(parents=True, exist_ok=True)
        paths = []
        for number, view in enumerate(contents.views(found.root), start=1):
            paths.append(out / f"{number:02d}-{_slug(view.name)}.png")
            _write(single(found, view, place), paths[-1])
        return paths
    except OSError as error:
        raise InputError(f"{out} cannot be written: {error.strerror}") from None


def _write(figure: "Figure", path: Path) -> None:
    figure.savefig(path, dpi=DPI, facecolor=drawn.DARK)


def _slug(name: str) -> str:
    """``name`` as part of a file's name."""
    return re.sub(r"[^a-z0-9]+", "-", name.split("[")[0].lower()).strip("-")[:40] or "view"


def middle(found: Contents) -> float:
    """Of the timeline; 0 where nothing is on it."""
    stamps = [e.time(found.timeline) for e in found.entities.values() if found.timeline in e.times]
    return 0.5 * float(min(map(np.min, stamps)) + max(map(np.max, stamps))) if stamps else 0.0


def window(found: Contents, at: float) -> "Figure":
    """The layout as it opens: of tabs, the first."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=WHOLE, layout="constrained", facecolor=drawn.DARK)
    _lay(figure, found, found.root, at, WHOLE)
    return figure


def single(found: Contents, view: View, at: float) -> "Figure":
    """One view; a page of words is as high as it has to be."""
    from matplotlib.figure import Figure

    size = ONE
    if view.kind == "TextDocument":
        wide = 2.0 * ONE[0]
        lines = list(drawn.plain(drawn.text_of(view.of(found.entities)), int(wide / drawn.LETTER)))
        size = wide, min(HIGHEST, (len(lines) + 4) * drawn.LINE)
    figure = Figure(figsize=size, layout="constrained", facecolor=drawn.DARK)
    _lay(figure, found, view, at, size)
    return figure


def _lay(
    figure: "Figure | SubFigure", found: Contents, node: View | Container, at: float, size: tuple[float, float]
) -> None:
    """Draw ``node`` into ``figure``, which is so large [inches]."""
    if isinstance(node, View):
        _draw(figure, found, node, at, size)
        return
    if node.kind == "tabs":
        _lay(figure, found, node.children[0], at, size)
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
        parts[row, column].set_facecolor(drawn.DARK)
        _lay(parts[row, column], found, child, at, own)


def _draw(figure: "Figure | SubFigure", found: Contents, view: View, at: float, size: tuple[float, float]) -> None:
    axis = figure.subplots()
    axis.set_facecolor(drawn.DARK)
    axis.set_title(view.name, fontsize=drawn.SMALL + 1.0, color=drawn.LIGHT, loc="left")
    entities = view.of(found.entities)
    if view.kind == "TextDocument":
        drawn.words(axis, drawn.text_of(entities), (size[0] - 0.2, size[1] - 0.35))
        return
    draw: dict[str, Callable[..., Any]] = {"TimeSeries": drawn.series, "2D": drawn.plane, "3D": drawn_scene.scene}
    draw[view.kind](axis, view, entities, found.timeline, at)
