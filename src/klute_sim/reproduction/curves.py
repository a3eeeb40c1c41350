"""Curves, surfaces and figures of the source as numbers, independent of how they are drawn."""

from typing import Literal, NamedTuple

from klute_sim.reproduction.item import Outcome
from klute_sim.types import Array

LineStyle = Literal["line", "dashed", "dotted", "dashdot", "points"]


class PlotLine(NamedTuple):
    """A curve of a figure."""

    label: str
    """Label in the legend."""
    x: Array
    """Abscissa, shape (n,)."""
    y: Array
    """Ordinate, shape (n,)."""
    style: LineStyle = "line"
    """Style of the line."""
    colour_index: int | None = None
    """Index of a colour that several curves share; None selects a colour of its own."""
    ordered_value: float | None = None
    """Value of the quantity by which the curves are ordered, which gives the colour in place of the index."""


class PlotSurface(NamedTuple):
    """A height over two axes."""

    x: Array
    """Abscissa, shape (n,)."""
    y: Array
    """Ordinate, shape (m,)."""
    z: Array
    """Height, shape (m, n)."""


class FigureData(NamedTuple):
    """A figure in the axes of the source."""

    number: str
    """Number of the figure, such as ``3.9``."""
    title: str
    """Title."""
    x_label: str
    """Label of the abscissa."""
    y_label: str
    """Label of the ordinate."""
    lines: tuple[PlotLine, ...] = ()
    """Curves of a two-dimensional figure."""
    x_range: tuple[float, float] | None = None
    """Range of the abscissa in the source; None where it is unknown."""
    y_range: tuple[float, float] | None = None
    """Range of the ordinate in the source; None where it is unknown."""
    surface: PlotSurface | None = None
    """Surface of a three-dimensional figure."""
    z_label: str = ""
    """Label of the height."""
    assumption_note: str = ""
    """Assumptions of the figure."""


class ChapterResult(NamedTuple):
    """Findings and figures of a chapter."""

    findings: dict[str, Outcome]
    """Outcome by item identifier."""
    figures: tuple[FigureData, ...]
    """Figures of the chapter."""
