"""Appearance that figures share: matplotlib rc parameters, colours and resolutions."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "text.parse_math": False,  # users name trials: a dollar sign must stay a dollar sign
}
"""Parameters for ``matplotlib.rc_context`` of figures with few panels."""

COMPACT_STYLE: Any = {"font.size": 8, "axes.titlesize": 9, "axes.spines.top": False, "axes.spines.right": False}
"""Parameters for ``matplotlib.rc_context`` of figures with many panels."""

COMPACT_DPI = 130
"""Resolution [dots per inch] of the files of figures in :data:`COMPACT_STYLE`."""

HUMAN_COLOUR, PROSTHESIS_COLOUR, EARLIER_COLOUR = "0.2", "#1f77b4", "#9ecae1"


def fix_tick_label_size(figure: "Figure") -> None:
    """Set the size of all tick labels of ``figure`` to the current ``font.size``.

    Matplotlib creates most tick labels when it draws. Without this call they have the default size in a figure that is
    saved outside its ``rc_context``.
    """
    import matplotlib

    for axis in figure.axes:
        axis.tick_params(which="both", labelsize=matplotlib.rcParams["font.size"])


@contextmanager
def use_style() -> Iterator[Callable[[float, float], "Figure"]]:
    """Set :data:`STYLE` in the block; yield a function that creates a figure of a width and height [inches]."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        yield lambda width, height: Figure(figsize=(width, height), layout="constrained")
