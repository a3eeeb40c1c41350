"""Figures of the dissertation, recomputed and plotted in its axes.

Matplotlib is imported when a figure is built.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from klute_sim.report.style import add_legend, get_ordered_colours, get_series_colour, save_figure, use_style
from klute_sim.reproduction.curves import FigureData, PlotLine

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINE_STYLES: Any = {"line": "-", "dashed": "--", "dotted": ":", "dashdot": "-.", "points": "none"}
WIDTH_INCHES, HEIGHT_INCHES = 5.6, 4.4


def build_figure(picture: FigureData) -> "Figure":
    """Plot ``picture`` as curves or as a surface."""
    with use_style() as create_figure:
        figure = create_figure(HEIGHT_INCHES, WIDTH_INCHES)
        if picture.surface is not None:
            _plot_surface(figure, picture)
        else:
            _plot_curves(figure, picture)
        figure.suptitle(f"Fig. {picture.number}: {picture.title}")
    return figure


def _plot_curves(figure: "Figure", picture: FigureData) -> None:
    axes = figure.subplots()
    ordered_colours = get_ordered_colours([x.ordered_value for x in picture.lines if x.ordered_value is not None])
    for line in picture.lines:
        _plot_curve(axes, line, ordered_colours)
    axes.set_xlabel(picture.x_label)
    axes.set_ylabel(picture.y_label)
    if picture.x_range:
        axes.set_xlim(*picture.x_range)
    if picture.y_range:
        axes.set_ylim(*picture.y_range)
    axes.axhline(0.0, color="0.7", linewidth=0.6)
    if sum(bool(line.label) for line in picture.lines) > 1:
        add_legend(axes, max_columns=2)


def _plot_curve(axes: Any, line: PlotLine, ordered_colours: Mapping[float, str]) -> None:
    style: dict[str, Any] = {"linestyle": LINE_STYLES[line.style], "linewidth": 1.4, "label": line.label or None}
    if line.style == "points":
        style |= {"marker": "o", "markersize": 6.0, "clip_on": False}
    if line.ordered_value is not None:
        style["color"] = ordered_colours[line.ordered_value]
    elif line.colour_index is not None:
        style["color"] = get_series_colour(line.colour_index)
    axes.plot(line.x, line.y, **style)


def _plot_surface(figure: "Figure", picture: FigureData) -> None:
    assert picture.surface is not None
    axes: Any = figure.add_subplot(projection="3d")
    x, y = np.meshgrid(picture.surface.x, picture.surface.y)
    axes.plot_surface(x, y, picture.surface.z, cmap="viridis", linewidth=0.2, edgecolor="0.4", antialiased=True)
    axes.set_xlabel(picture.x_label)
    axes.set_ylabel(picture.y_label)
    axes.set_zlabel(picture.z_label)
    axes.view_init(elev=24.0, azim=-130.0)


def save_figures(pictures: tuple[FigureData, ...], folder: Path) -> Iterator[Path]:
    """Write every figure into ``folder`` as ``fig-NUMBER.png``; yield the path of each after it is written."""
    for picture in pictures:
        path = folder / f"fig-{picture.number}.png"
        save_figure(build_figure(picture), path)
        yield path
