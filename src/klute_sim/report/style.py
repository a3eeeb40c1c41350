"""Appearance that all figures share: width, type sizes, colours, resolution, and legends beside the curves."""

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

FIGURE_WIDTH_INCHES = 9.0
"""Width of a figure with panels side by side [inches]; its type stays legible at the width of a page."""
DPI = 130
"""Resolution of the files of figures [dots per inch]."""
STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "figure.titlesize": 10.5,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.5,
    "text.parse_math": False,  # users name trials: a dollar sign must stay a dollar sign
}
"""Parameters for ``matplotlib.rc_context``."""

HUMAN_COLOUR, HUMAN_BAND_COLOUR = "0.2", "0.87"
HUMAN_LINE: Any = {"color": HUMAN_COLOUR, "linestyle": "--", "linewidth": 1.0, "zorder": 3.0}
"""Line of measured human gait; it stays visible where a simulated one agrees."""
COMMAND_LINE: Any = {"color": "0.1", "linestyle": "--", "linewidth": 0.9, "zorder": 3.0}
"""Line of a command; it stays visible where the quantity follows it."""
PROSTHESIS_COLOUR, EARLIER_COLOUR = "#1f77b4", "#9ecae1"
MEASURED_COLOUR, ZERO_LINE_COLOUR = "0.15", "0.6"
SERIES_COLOURS = ("#1f77b4", "#e6842a", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#17becf", "#e377c2")
"""Colours of series without an order, used again from the first."""
MAX_COLOUR_FRACTION = 0.85
"""Fraction of the colour map for the largest of ordered values; its yellow end is hard to see on white."""
LEGEND_ROW_POINTS = 13.0
"""Height of a row of a legend [points]."""


def get_series_colour(index: int) -> str:
    """Return the colour of series number ``index`` of series without an order."""
    return SERIES_COLOURS[index % len(SERIES_COLOURS)]


def get_ordered_colours(values: Collection[float]) -> dict[float, str]:
    """Return value -> colour for values of an ordered quantity: the larger the value, the brighter."""
    import matplotlib
    import numpy as np
    from matplotlib.colors import to_hex

    ordered = sorted(set(values))
    colour_map = matplotlib.colormaps["viridis"]
    fractions = np.linspace(0.0, MAX_COLOUR_FRACTION, len(ordered)).tolist()
    return {value: to_hex(colour_map(fraction)) for value, fraction in zip(ordered, fractions, strict=True)}


def add_legend(axis: "Axes", max_columns: int = 4) -> None:
    """Add the legend of ``axis`` between its title and its panel, where it covers no curve.

    Call it after the title is set; without a labelled artist there is no legend.
    """
    handles, labels = axis.get_legend_handles_labels()
    if not handles:
        return
    columns = min(max_columns, len(labels))
    axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, borderaxespad=0.15, borderpad=0.1)
    axis.set_title(axis.get_title(), pad=6.0 + LEGEND_ROW_POINTS * -(-len(labels) // columns))


def add_heading(figure: "Figure", text: str, entries: "Axes | list[Line2D]", max_columns: int = 4) -> None:
    """Add the heading ``text`` of ``figure``, and below it the legend that its panels share.

    ``entries`` are labelled artists, or the panel that has them; without any there is no legend.
    """
    handles = entries if isinstance(entries, list) else entries.get_legend_handles_labels()[0]
    if not handles:
        figure.suptitle(text)
        return
    size, ncols = STYLE["figure.titlesize"], min(max_columns, len(handles))
    legend = figure.legend(handles=handles, loc="outside upper center", ncols=ncols, title=text, title_fontsize=size)
    legend.get_title().set_multialignment("center")


def save_figure(figure: "Figure", path: Path) -> None:
    """Write ``figure`` as PNG to ``path``, which appears complete or not at all."""
    from klute_sim.recording.atomic_file import replace_atomically

    with replace_atomically(path) as temporary:
        figure.savefig(temporary, dpi=DPI, format="png")


@contextmanager
def use_style() -> Iterator[Callable[..., "Figure"]]:
    """Set :data:`STYLE` in the block; yield a function that creates a figure.

    The function takes the height [inches] and optionally the width [inches], by default :data:`FIGURE_WIDTH_INCHES`.
    """
    import matplotlib

    from klute_sim.report.notebook_figure import NotebookFigure

    figures: list[NotebookFigure] = []

    def create_figure(height: float, width: float = FIGURE_WIDTH_INCHES) -> NotebookFigure:
        figures.append(NotebookFigure(figsize=(width, height), layout="constrained"))
        return figures[-1]

    with matplotlib.rc_context(STYLE):
        yield create_figure
        # Matplotlib creates most tick labels when it draws, which is outside this block.
        for figure in figures:
            for axis in figure.axes:
                axis.tick_params(which="both", labelsize=STYLE["font.size"])
