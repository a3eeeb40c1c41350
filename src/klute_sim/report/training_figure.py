"""Figure of a training: the learning curve, with policy and baseline as evaluated."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from klute_sim.report.style import STYLE, fix_tick_label_size


def build_figure(rows: Sequence[Sequence[float]], summary: Mapping[str, Any]) -> Figure:
    """Plot the learning curve ``rows`` (minutes, steps, episodes, return, steps per episode) of the run ``summary``."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 4.0), layout="constrained")
        axis = figure.subplots()
        axis.plot([row[1] for row in rows], [row[3] for row in rows], color="#1f77b4", label="policy, exploring")
        for name, label, style in (("policy", "policy, evaluated", "-"), ("baseline", summary["baseline_name"], "--")):
            axis.axhline(summary[name]["return"], color="#333333", linestyle=style, linewidth=1.0, label=label)
        axis.set_xlabel("environment steps")
        axis.set_ylabel("episode return")
        axis.set_title(f"{summary['algorithm'].upper()}, seed {summary['seed']}, {summary['minutes']:.1f} min")
        axis.legend()
        axis.grid(alpha=0.25, linewidth=0.5)
        fix_tick_label_size(figure)
    return figure
