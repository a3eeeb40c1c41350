"""Render views of a recording with matplotlib: lines over the timeline, 2-D views, and text.

The colours are those of the recording, which are chosen for the dark background of the viewer.
"""

import textwrap
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from klute_sim.types import Array
from klute_sim.viewer.picture.rrd_reader import Entity, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BACKGROUND_COLOUR, GRID_COLOUR, TEXT_COLOUR = "#0d0d0d", "#444444", "#d8d8d8"
FONT_SIZE_PT = 7.5
"""Size of the font [points]."""
LINE_HEIGHT_IN, LETTER_WIDTH_IN = 0.16, 0.061
"""Height of a line of text, and width of a letter [inches]."""

MAX_LABEL_CHARS = 48
"""Longest line of a label in a 2-D view [characters]."""
MIN_STACK_HEIGHT_IN = 2.0
"""Height of a view below which the entries of its legend stand side by side [inches]."""


def unpack_colour(packed: int) -> tuple[float, float, float, float]:
    """Return the colour 0xRRGGBBAA of rerun as fractions for matplotlib."""
    red, green, blue, alpha = (((int(packed) >> shift) & 255) / 255.0 for shift in (24, 16, 8, 0))
    return red, green, blue, alpha


def get_first_value(entity: Entity, component: str, default: Any) -> Any:
    """Return the first value of a static component."""
    values = entity.static.get(component)
    return values[0] if values else default


def draw_series(axis: "Axes", view: View, entities: dict[str, Entity], timeline: str, cursor: float) -> None:
    """Plot lines over the timeline, with a mark at the cursor."""
    # The viewer draws in the order of the entities' names.
    for path, entity in sorted(entities.items()):
        component = "values" if "Measurements" in entity.archetypes else "scalars"
        if component not in entity.rows or timeline not in entity.times:
            continue
        time, value = entity.get_times(timeline), _read_single_values(entity, component)
        style: dict[str, Any] = {"color": unpack_colour(get_first_value(entity, "colors", 0xAAAAAAFF))}
        style["label"] = get_first_value(entity, "names", path)
        if "SeriesPoints" in entity.archetypes:
            style |= {"linestyle": "none", "marker": "o", "markersize": get_first_value(entity, "marker_sizes", 3.0)}
        else:
            style["linewidth"] = 0.6 * get_first_value(entity, "widths", 1.0)
        axis.plot(time, value, **style)
        if "variances" in entity.rows:
            deviation = np.sqrt(_read_single_values(entity, "variances"))
            axis.fill_between(time, value - deviation, value + deviation, color=style["color"], alpha=0.25, linewidth=0)
    axis.margins(x=0.0)
    if view.span is not None:
        axis.set_xlim(*view.span)
    if view.value_range is not None:
        axis.set_ylim(*view.value_range)
    axis.axvline(cursor, color=TEXT_COLOUR, linewidth=0.5)
    axis.grid(color=GRID_COLOUR, linewidth=0.3)
    axis.tick_params(labelsize=FONT_SIZE_PT, colors=TEXT_COLOUR)
    for spine in axis.spines.values():
        spine.set_color(GRID_COLOUR)
    # The legend of the viewer shows equal names once.
    handles, labels = axis.get_legend_handles_labels()
    handle_by_label = dict(zip(labels, handles, strict=True))
    if view.legend and handle_by_label:
        is_low = axis.figure.bbox.height / axis.figure.dpi < MIN_STACK_HEIGHT_IN
        axis.legend(
            handle_by_label.values(),
            handle_by_label.keys(),
            loc=view.legend_corner,
            ncols=len(handle_by_label) if is_low else 1,
            fontsize=FONT_SIZE_PT,
            frameon=True,
            facecolor=BACKGROUND_COLOUR,
            edgecolor=GRID_COLOUR,
            labelcolor=TEXT_COLOUR,
            framealpha=0.6,
        )
    axis.set_xlabel(
        f"{timeline.replace('_', ' ')}{' [s]' if timeline == 'time' else ''}", fontsize=FONT_SIZE_PT, color=TEXT_COLOUR
    )


def _read_single_values(entity: Entity, component: str) -> Array:
    """Return the value of each row of a component with one value per row; NaN without one."""
    return np.array([row[0] if row else np.nan for row in entity.rows[component]], dtype=np.float64)


def draw_plane(axis: "Axes", view: View, entities: dict[str, Entity], timeline: str, cursor: float) -> None:
    """Plot images, lines, points and labels of a 2-D view, y down."""
    from matplotlib.collections import LineCollection

    # The viewer draws images first, then in the order of the entities' names.
    for _, entity in sorted(entities.items(), key=lambda item: ("Image" not in item[1].archetypes, item[0])):
        if "Image" in entity.archetypes:
            pixels, scale = decode_image(entity), float(get_first_value(entity, "scale", [1.0])[0])
            height, width = pixels.shape[:2]
            axis.imshow(pixels, extent=(0.0, width * scale, height * scale, 0.0), interpolation="nearest")
        if "LineStrips2D" in entity.archetypes:
            strips = [np.array(strip) for strip in entity.get_value("strips", timeline, cursor) or []]
            line_width = 0.7 * abs(float(get_first_value(entity, "radii", -1.0)))
            axis.add_collection(
                LineCollection(strips, colors=[_unpack_colours(entity, 1)[0]], linewidths=2.0 * line_width)
            )
        if "Points2D" in entity.archetypes:
            _draw_points(axis, entity, timeline, cursor)
    if view.bounds is not None:
        (left, right), (top, bottom) = view.bounds
        axis.set_xlim(left, right)
        axis.set_ylim(bottom, top)
    axis.set_aspect("equal")
    axis.set_axis_off()


def _draw_points(axis: "Axes", entity: Entity, timeline: str, cursor: float) -> None:
    positions = np.array(entity.get_value("positions", timeline, cursor) or np.empty((0, 2)))
    labels, shades = entity.static.get("labels"), _unpack_colours(entity, len(positions))
    if labels:
        for (x, y), label, shade in zip(positions, labels, shades, strict=True):
            text = textwrap.fill(label, MAX_LABEL_CHARS)
            style: dict[str, Any] = {"color": shade, "fontsize": FONT_SIZE_PT, "ha": "center", "va": "top"}
            axis.text(x, y + 1.0, text, clip_on=text == label, **style)  # the view has room for one line only
    elif len(positions):
        size = abs(float(get_first_value(entity, "radii", -3.0)))
        axis.scatter(positions[:, 0], positions[:, 1], s=2.0 * size**2, c=shades, zorder=3.0)


def _unpack_colours(entity: Entity, n_colours: int) -> list[tuple[float, float, float, float]]:
    packed = entity.static.get("colors") or [0xAAAAAAFF]
    return [unpack_colour(packed[min(k, len(packed) - 1)]) for k in range(n_colours)]


def decode_image(entity: Entity) -> NDArray[np.uint8]:
    """Return the pixels (rows, columns, 3) of an image."""
    image_format = get_first_value(entity, "format", {})
    pixels = np.array(get_first_value(entity, "buffer", []), dtype=np.uint8)
    return pixels.reshape(image_format["height"], image_format["width"], -1)


def join_text(entities: dict[str, Entity]) -> str:
    """Return the Markdown text of all documents in ``entities``."""
    return "\n".join(str(get_first_value(entity, "text", "")) for entity in entities.values())


def draw_text(axis: "Axes", text: str, size: tuple[float, float]) -> None:
    """Draw Markdown as plain text, as many lines as fit into ``size`` (width, height) [inches]."""
    axis.set_axis_off()
    max_lines = max(1, int(size[1] / LINE_HEIGHT_IN) - 1)
    lines = list(strip_markdown(text, max(20, int(size[0] / LETTER_WIDTH_IN))))
    if len(lines) > max_lines:
        lines = [*lines[: max_lines - 1], ("…", False)]
    for k, (line, heading) in enumerate(lines):
        y, weight = 1.0 - (k + 0.5) * LINE_HEIGHT_IN / size[1], "bold" if heading else "normal"
        family = "monospace" if "  " in line.strip() else "sans-serif"
        axis.text(0.01, y, line, transform=axis.transAxes, fontsize=FONT_SIZE_PT, color=TEXT_COLOUR, va="center",
                  weight=weight, family=family, clip_on=True)  # fmt: skip


def strip_markdown(text: str, width: int) -> Iterator[tuple[str, bool]]:
    """Yield the lines of Markdown ``text`` without markup, and whether each is a heading; tables are aligned."""
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
                max_length = int(0.95 * width)  # tables have a wider, monospaced font
                yield (aligned if len(aligned) <= max_length else aligned[: max_length - 1] + "…"), False
            table = []
        is_heading = line.startswith("#")
        for wrapped in textwrap.wrap(line.lstrip("# "), width) or [""]:
            yield wrapped, is_heading
