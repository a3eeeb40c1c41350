"""What a figure of the source shows, as numbers; how it is drawn is not known here."""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.reproduce.item import Found

Array = NDArray[np.float64]
Style = Literal["line", "dashed", "dotted", "points"]


class Line(NamedTuple):
    """A curve."""

    label: str
    x: Array
    y: Array
    style: Style = "line"
    colour: int | None = None
    """Curves of the same number are drawn alike; None: a colour of its own."""


class Surface(NamedTuple):
    """A height over two axes."""

    x: Array
    """(n,)"""
    y: Array
    """(m,)"""
    z: Array
    """(m, n)"""


class Picture(NamedTuple):
    """A figure in the axes of the source."""

    number: str
    """Of the figure, such as ``3.9``."""
    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...] = ()
    x_span: tuple[float, float] | None = None
    """The source's own range, where it is known."""
    y_span: tuple[float, float] | None = None
    surface: Surface | None = None
    z_label: str = ""
    assumed: str = ""
    """What had to be assumed to draw it."""


class Chapter(NamedTuple):
    """What a chapter's equations give."""

    findings: dict[str, Found]
    """Identifier of an item -> what was computed of it."""
    pictures: tuple[Picture, ...]
