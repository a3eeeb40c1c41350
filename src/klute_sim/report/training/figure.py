"""Figure of a training: the learning curve, with policy and baseline as evaluated."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from klute_sim.report.style import HUMAN_COLOUR, PROSTHESIS_COLOUR, add_legend, use_style

DESCRIPTION = "Return of an episode over the steps of the training, and those of policy and baseline as evaluated."
"""Text that stands for the figure where it cannot be seen."""


def build_figure(rows: Sequence[Sequence[float]], summary: Mapping[str, Any]) -> Figure:
    """Plot the learning curve ``rows`` (minutes, steps, episodes, return, steps per episode) of the run ``summary``."""
    with use_style() as create_figure:
        figure = create_figure(4.0, 7.0)
        axis = figure.subplots()
        axis.plot(
            [row[1] for row in rows], [row[3] for row in rows], color=PROSTHESIS_COLOUR, label="policy, exploring"
        )
        for name, label, style in (("policy", "policy, evaluated", "-"), ("baseline", summary["baseline_name"], "--")):
            axis.axhline(summary[name]["return"], color=HUMAN_COLOUR, linestyle=style, linewidth=1.0, label=label)
        axis.set_xlabel("environment steps")
        axis.set_ylabel("return of an episode [1]")
        axis.set_title(f"{summary['algorithm'].upper()}, seed {summary['seed']}, {summary['minutes']:.1f} min")
        add_legend(axis)
    return figure
