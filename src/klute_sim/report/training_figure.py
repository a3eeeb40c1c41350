"""The picture of a training: what episodes were worth, over the steps it took."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from klute_sim.report.style import STYLE


def save_figure(rows: Sequence[Sequence[float]], summary: Mapping[str, Any], path: Path) -> None:
    """Write the learning curve ``rows`` (minutes, steps, episodes, return, steps of an episode) to ``path``."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 4.0), layout="constrained")
        axis = figure.subplots()
        axis.plot(
            [row[1] for row in rows], [row[3] for row in rows], color="#1f77b4", label="policy, while it explores"
        )
        for name, label, style in (("policy", "policy, evaluated", "-"), ("profile", "hand-tuned profile", "--")):
            axis.axhline(summary[name]["return"], color="#333333", linestyle=style, linewidth=1.0, label=label)
        axis.set_xlabel("steps of the environment")
        axis.set_ylabel("return of an episode")
        axis.set_title(f"{summary['algorithm'].upper()}, seed {summary['seed']}, {summary['minutes']:.1f} min")
        axis.legend()
        axis.grid(alpha=0.25, linewidth=0.5)
        figure.savefig(path, dpi=130)
