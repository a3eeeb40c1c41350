"""Figure of a search with one objective: the objective over the evaluations, and what changed."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from klute_sim.report.style import EARLIER_COLOUR, PROSTHESIS_COLOUR, ZERO_LINE_COLOUR, add_legend, use_style
from klute_sim.types import Array

DESCRIPTION = (
    "Objective of every evaluation with the best so far, and the changes of outcomes and tuned numbers in per cent."
)
"""Text that stands for the figure where it cannot be seen."""
FALL_COLOUR = "#d62728"


def build_figure(
    costs: Sequence[float],
    falls: Sequence[bool],
    outcomes: Mapping[str, tuple[float | None, float | None]],
    variables: Mapping[str, tuple[float | None, float | None]],
) -> Figure:
    """Plot the ``costs`` of all evaluations, and the changes of ``outcomes`` and ``variables`` (before, tuned).

    ``falls`` says in which evaluations somebody falls, or a simulation fails.
    """
    with use_style() as create_figure:
        figure = create_figure(3.4 + 0.3 * max(len(outcomes), len(variables)))
        panels = figure.subplot_mosaic(
            [["objective", "objective"], ["outcomes", "variables"]],
            height_ratios=[2.6, 0.8 + 0.3 * max(len(outcomes), len(variables))],
        )
        _plot_costs(panels["objective"], np.array(costs), np.array(falls, dtype=bool))
        _plot_changes(panels["outcomes"], outcomes, "outcomes: change [%]")
        _plot_changes(panels["variables"], variables, "tuned numbers: change [%]")
    return figure


def _plot_costs(axis: Axes, costs: Array, is_fall: NDArray[np.bool_]) -> None:
    number, walked = np.arange(1, len(costs) + 1), ~is_fall
    axis.plot(number[walked], costs[walked], ".", color=EARLIER_COLOUR, label="evaluations")
    if is_fall.any():
        axis.plot(number[is_fall], costs[is_fall], "x", color=FALL_COLOUR, markersize=4, label="a simulation fails")
    axis.plot(
        number, np.minimum.accumulate(costs), color=PROSTHESIS_COLOUR, drawstyle="steps-post", label="best so far"
    )
    low, first = float(costs.min()), float(costs[0])
    axis.set_ylim(low - 0.1 * max(first - low, 0.1), first + 2.0 * max(first - low, 0.1))  # falls cost far more
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.set_xlabel("evaluation")
    axis.set_title("objective [1], less is better")
    add_legend(axis)


def _plot_changes(axis: Axes, pairs: Mapping[str, tuple[float | None, float | None]], title: str) -> None:
    """Plot the change of each pair (before, tuned) in per cent of the value before."""
    changes = {
        name: 100.0 * (tuned - before) / abs(before)
        for name, (before, tuned) in pairs.items()
        if before and tuned is not None
    }
    bars = axis.barh(list(changes), list(changes.values()), color=PROSTHESIS_COLOUR, height=0.6)
    axis.bar_label(bars, fmt="%+.3g", padding=3)
    axis.axvline(0.0, color=ZERO_LINE_COLOUR, linewidth=0.6)
    axis.margins(x=0.25)
    axis.invert_yaxis()
    axis.grid(visible=False, axis="y")
    axis.set_title(title)
