"""Views of a rerun recording drawn by matplotlib: series, what is in a plane, and words.

The colours are those of the recording, which are made for the viewer's dark background.
"""

import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.report.workbench.contents import Entity, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DARK, FAINT, LIGHT = "#0d0d0d", "#444444", "#d8d8d8"
SMALL = 7.0
"""Of words [points]."""
LINE, LETTER = 0.15, 0.057
"""Height of a line of words, and width of a letter [inches]."""


def colour(packed: int) -> tuple[float, float, float, float]:
    """Rerun's 0xRRGGBBAA, as matplotlib has it."""
    red, green, blue, alpha = (((int(packed) >> shift) & 255) / 255.0 for shift in (24, 16, 8, 0))
    return red, green, blue, alpha


def first(entity: Entity, component: str, otherwise: Any) -> Any:
    """The first of a static component's values."""
    found = entity.static.get(component)
    return found[0] if found else otherwise


def series(axis: "Axes", view: View, entities: dict[str, Entity], timeline: str, at: float) -> None:
    """A plot over the timeline, with a mark where the cursor is."""
    # As the viewer does: in the order of the entities' names.
    for path, entity in sorted(entities.items()):
        if "scalars" not in entity.rows or timeline not in entity.times:
            continue
        value = np.array([row[0] if row else np.nan for row in entity.rows["scalars"]], dtype=np.float64)
        look: dict[str, Any] = {"color": colour(first(entity, "colors", 0xAAAAAAFF))}
        look["label"] = first(entity, "names", path)
        if "SeriesPoints" in entity.archetypes:
            look |= {"linestyle": "none", "marker": "o", "markersize": first(entity, "marker_sizes", 3.0)}
        else:
            look["linewidth"] = 0.6 * first(entity, "widths", 1.0)
        axis.plot(entity.time(timeline), value, **look)
    axis.axvline(at, color=LIGHT, linewidth=0.5)
    axis.grid(color=FAINT, linewidth=0.3)
    axis.tick_params(labelsize=SMALL, colors=LIGHT)
    for spine in axis.spines.values():
        spine.set_color(FAINT)
    # As the viewer does: what is called alike is there once.
    handles, labels = axis.get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    if view.legend and named:
        axis.legend(named.values(), named.keys(), fontsize=SMALL, frameon=True, facecolor=DARK, edgecolor=FAINT,
                    labelcolor=LIGHT, framealpha=0.6)  # fmt: skip
    axis.set_xlabel(f"{timeline.replace('_', ' ')}{' [s]' if timeline == 'time' else ''}", fontsize=SMALL, color=LIGHT)


def plane(axis: "Axes", view: View, entities: dict[str, Entity], timeline: str, at: float) -> None:
    """What is in a picture plane, y down: images, lines, points and words."""
    from matplotlib.collections import LineCollection

    # As the viewer does: images first, then in the order of the entities' names.
    for _, entity in sorted(entities.items(), key=lambda each: ("Image" not in each[1].archetypes, each[0])):
        if "Image" in entity.archetypes:
            pixels, scale = image(entity), float(first(entity, "scale", [1.0])[0])
            high, wide = pixels.shape[:2]
            axis.imshow(pixels, extent=(0.0, wide * scale, high * scale, 0.0), interpolation="nearest")
        if "LineStrips2D" in entity.archetypes:
            strips = [np.array(strip) for strip in entity.at("strips", timeline, at) or []]
            width = 0.7 * abs(float(first(entity, "radii", -1.0)))
            axis.add_collection(LineCollection(strips, colors=[_colours(entity, 1)[0]], linewidths=2.0 * width))
        if "Points2D" in entity.archetypes:
            _points(axis, entity, timeline, at)
    if view.bounds is not None:
        (left, right), (top, bottom) = view.bounds
        axis.set_xlim(left, right)
        axis.set_ylim(bottom, top)
    axis.set_aspect("equal")
    axis.set_axis_off()


def _points(axis: "Axes", entity: Entity, timeline: str, at: float) -> None:
    places = np.array(entity.at("positions", timeline, at) or np.empty((0, 2)))
    labels, shades = entity.static.get("labels"), _colours(entity, len(places))
    if labels:
        for (x, y), label, shade in zip(places, labels, shades, strict=True):
            axis.text(x, y + 1.0, label, color=shade, fontsize=SMALL, ha="center", va="top", clip_on=True)
    elif len(places):
        size = abs(float(first(entity, "radii", -3.0)))
        axis.scatter(places[:, 0], places[:, 1], s=2.0 * size**2, c=shades, zorder=3.0)


def _colours(entity: Entity, count: int) -> list[tuple[float, float, float, float]]:
    packed = entity.static.get("colors") or [0xAAAAAAFF]
    return [colour(packed[min(k, len(packed) - 1)]) for k in range(count)]


def image(entity: Entity) -> NDArray[np.uint8]:
    """The pixels (rows, columns, 3) of an image of bytes."""
    form = first(entity, "format", {})
    pixels = np.array(first(entity, "buffer", []), dtype=np.uint8)
    return pixels.reshape(form["height"], form["width"], -1)


def text_of(entities: dict[str, Entity]) -> str:
    """The Markdown of a page."""
    return "\n".join(str(first(entity, "text", "")) for entity in entities.values())


def words(axis: "Axes", text: str, inches: tuple[float, float]) -> None:
    """A page of Markdown as plain words, as much as there is place for in so many ``inches`` (wide, high)."""
    axis.set_axis_off()
    most = max(1, int(inches[1] / LINE) - 1)
    lines = list(plain(text, max(20, int(inches[0] / LETTER))))
    if len(lines) > most:
        lines = [*lines[: most - 1], ("…", False)]
    for k, (line, heading) in enumerate(lines):
        place, weight = 1.0 - (k + 0.5) * LINE / inches[1], "bold" if heading else "normal"
        family = "monospace" if "  " in line.strip() else "sans-serif"
        axis.text(0.01, place, line, transform=axis.transAxes, fontsize=SMALL, color=LIGHT, va="center",
                  weight=weight, family=family, clip_on=True)  # fmt: skip


def plain(text: str, width: int) -> Iterator[tuple[str, bool]]:
    """Lines of Markdown ``text`` without its marks, and whether each is a heading; tables are aligned."""
    table: list[list[str]] = []
    for line in [*text.splitlines(), ""]:
        if line.startswith("|"):
            table.append([cell.strip() for cell in line.strip("|").split("|")])
            continue
        if table:
            rows = [row for row in table if set("".join(row)) != {"-"}]
            sizes = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
            for row in rows:
                aligned = "  ".join(cell.ljust(size) for cell, size in zip(row, sizes, strict=True)).rstrip()
                fits = int(0.95 * width)  # of a wider family
                yield (aligned if len(aligned) <= fits else aligned[: fits - 1] + "…"), False
            table = []
        heading = line.startswith("#")
        for piece in textwrap.wrap(line.lstrip("# "), width) or [""]:
            yield piece, heading
