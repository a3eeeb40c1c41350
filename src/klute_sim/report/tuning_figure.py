"""The picture of a search: tracking against air, and what came out beside what it began with."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from klute_sim.recording.recording import Array, Recording
from klute_sim.report.gait.figure import COMPACT_STYLE, EARLIER_COLOUR, HUMAN_COLOUR, PROSTHESIS_COLOUR

PARETO_FRONT_COLOUR = "#d62728"


def save_figure(
    evaluations: Sequence[tuple[float, float]],
    pareto_front: Sequence[tuple[float, float]],
    before: tuple[float, float],
    after: tuple[float, float],
    recordings: tuple[Recording, Recording],
    path: Path,
) -> None:
    """Write the picture to ``path``. Points are (air [g], tracking [sd^2]); ``walks`` are before and after."""
    with matplotlib.rc_context(COMPACT_STYLE):
        figure = Figure(figsize=(11, 7.5), layout="constrained")
        axes = figure.subplots(2, 2)
        _plot_pareto_front(axes[0, 0], evaluations, pareto_front, before, after)
        first, last = (_select_last_stride(walk) for walk in recordings)
        mass = float(recordings[0].provenance["options"]["mass_kg"])
        _plot_curves(axes[0, 1], first, last, "pressure_command", 1.0, "commanded pressure [bar]")
        _plot_curves(axes[1, 0], first, last, "ankle_moment", mass, "net ankle moment [N·m/kg]")
        _plot_curves(axes[1, 1], first, last, "ankle_power", mass, "net ankle power [W/kg]")
        for axis in axes.flat:
            axis.grid(alpha=0.25, linewidth=0.5)
        figure.savefig(path, dpi=130)


def _select_last_stride(recording: Recording) -> Recording:
    return recording.select(recording["stride"] == recording["stride"][-1])


def _plot_pareto_front(
    axis: Axes,
    evaluations: Sequence[tuple[float, float]],
    pareto_front: Sequence[tuple[float, float]],
    before: tuple[float, float],
    after: tuple[float, float],
) -> None:
    air, apart = zip(*evaluations, strict=True) if evaluations else ((), ())
    axis.scatter(air, apart, s=6, color=EARLIER_COLOUR, label=f"{len(evaluations)} walks")
    air, apart = zip(*pareto_front, strict=True) if pareto_front else ((), ())
    axis.plot(air, apart, color=PARETO_FRONT_COLOUR, drawstyle="steps-post", linewidth=1.2, label="nothing beats both")
    axis.plot(*before, "s", color=HUMAN_COLOUR, label="before")
    axis.plot(*after, "*", color=PROSTHESIS_COLOUR, markersize=12, label="tuned")
    axis.set_ylim(0.0, 2.0 * max(before[1], after[1]))
    axis.set_xlabel("air in a stride [g]")
    axis.set_ylabel("squared distance to the human, summed [sd²]")
    axis.set_title("tracking against air")
    axis.legend(fontsize=7, frameon=False)


def _plot_curves(axis: Axes, before: Recording, after: Recording, channel: str, scale: float, label: str) -> None:
    phase: Array = before["gait_phase"]
    if f"reference_{channel}" in before:
        axis.plot(phase, before[f"reference_{channel}"] / scale, "--", color=HUMAN_COLOUR, linewidth=1.0, label="human")
    axis.plot(phase, before[channel] / scale, color=EARLIER_COLOUR, linewidth=1.2, label="before")
    axis.plot(after["gait_phase"], after[channel] / scale, color=PROSTHESIS_COLOUR, linewidth=1.4, label="tuned")
    axis.set_xlim(0, 100)
    axis.set_xlabel("gait cycle [%]")
    axis.set_title(label)
    axis.legend(fontsize=7, frameon=False)
