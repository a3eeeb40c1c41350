"""What a figure of the source shows, as numbers; how it is drawn is not known here."""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.reproduction.item import Finding

Array = NDArray[np.float64]
LineStyle = Literal["line", "dashed", "dotted", "points"]


class PlotLine(NamedTuple):
    """A curve."""

    label: str
    x: Array
    y: Array
    style: LineStyle = "line"
    colour_index: int | None = None
    """Curves of the same number are drawn alike; None: a colour of its own."""


class PlotSurface(NamedTuple):
    """A height over two axes."""

    x: Array
    """(n,)"""
    y: Array
    """(m,)"""
    z: Array
    """(m, n)"""


class FigureData(NamedTuple):
    """A figure in the axes of the source."""

    number: str
    """Of the figure, such as ``3.9``."""
    title: str
    x_label: str
    y_label: str
    lines: tuple[PlotLine, ...] = ()
    x_range: tuple[float, float] | None = None
    """The source's own range, where it is known."""
    y_range: tuple[float, float] | None = None
    surface: PlotSurface | None = None
    z_label: str = ""
    assumption_note: str = ""
    """What had to be assumed to draw it."""


class ChapterResult(NamedTuple):
    """What a chapter's equations give."""

    findings: dict[str, Finding]
    """Identifier of an item -> what was computed of it."""
    figures: tuple[FigureData, ...]
