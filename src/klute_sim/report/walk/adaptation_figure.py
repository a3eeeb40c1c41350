"""Figure of an adaptation: the cost of every walk, and the best so far."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from klute_sim.report.style import EARLIER_COLOUR, PROSTHESIS_COLOUR, add_legend, use_style

DESCRIPTION = "Cost of every walk of the search, and the best so far."
"""Text that stands for the figure where it cannot be seen."""


def build_figure(costs: Sequence[float]) -> Figure:
    """Plot the ``costs`` of all walks in their order; the scale is logarithmic, because falls cost far more."""
    number, best = np.arange(1, len(costs) + 1), np.minimum.accumulate(costs)
    with use_style() as create_figure:
        figure = create_figure(4.0, 7.0)
        axis = figure.subplots()
        axis.plot(number, costs, ".", color=EARLIER_COLOUR, markersize=3.0, label="walks")
        axis.plot(number, best, color=PROSTHESIS_COLOUR, drawstyle="steps-post", label="best so far")
        axis.set_yscale("log")
        axis.set_xlabel("walk of the search")
        axis.set_title("cost [1], less is better")
        add_legend(axis)
    return figure
