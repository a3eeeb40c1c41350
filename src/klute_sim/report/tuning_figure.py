"""The picture of a search: tracking against air, and what came out beside what it began with."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from klute_sim.recording.recording import Recording, Samples
from klute_sim.report.figure import EARLIER, HUMAN, OURS, STYLE

FRONT = "#d62728"


def draw(
    tried: Sequence[tuple[float, float]],
    front: Sequence[tuple[float, float]],
    before: tuple[float, float],
    after: tuple[float, float],
    walks: tuple[Recording, Recording],
    path: Path,
) -> None:
    """Write the picture to ``path``. Points are (air [g], tracking [sd^2]); ``walks`` are before and after."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(11, 7.5), layout="constrained")
        axes = figure.subplots(2, 2)
        _pareto(axes[0, 0], tried, front, before, after)
        first, last = (_last_stride(walk) for walk in walks)
        mass = float(walks[0].provenance["options"]["mass_kg"])
        _curves(axes[0, 1], first, last, "pressure_command", 1.0, "commanded pressure [bar]")
        _curves(axes[1, 0], first, last, "ankle_moment", mass, "net ankle moment [N·m/kg]")
        _curves(axes[1, 1], first, last, "ankle_power", mass, "net ankle power [W/kg]")
        for axis in axes.flat:
            axis.grid(alpha=0.25, linewidth=0.5)
        figure.savefig(path, dpi=130)


def _last_stride(recording: Recording) -> Recording:
    return recording.select(recording["stride"] == recording["stride"][-1])


def _pareto(
    axis: Axes,
    tried: Sequence[tuple[float, float]],
    front: Sequence[tuple[float, float]],
    before: tuple[float, float],
    after: tuple[float, float],
) -> None:
    air, apart = zip(*tried, strict=True) if tried else ((), ())
    axis.scatter(air, apart, s=6, color=EARLIER, label=f"{len(tried)} walks")
    air, apart = zip(*front, strict=True) if front else ((), ())
    axis.plot(air, apart, color=FRONT, drawstyle="steps-post", linewidth=1.2, label="nothing beats both")
    axis.plot(*before, "s", color=HUMAN, label="before")
    axis.plot(*after, "*", color=OURS, markersize=12, label="tuned")
    axis.set_ylim(0.0, 2.0 * max(before[1], after[1]))
    axis.set_xlabel("air in a stride [g]")
    axis.set_ylabel("squared distance to the human, summed [sd²]")
    axis.set_title("tracking against air")
    axis.legend(fontsize=7, frameon=False)


def _curves(axis: Axes, before: Recording, after: Recording, channel: str, scale: float, label: str) -> None:
    phase: Samples = before["gait_phase"]
    if f"reference_{channel}" in before:
        axis.plot(phase, before[f"reference_{channel}"] / scale, "--", color=HUMAN, linewidth=1.0, label="human")
    axis.plot(phase, before[channel] / scale, color=EARLIER, linewidth=1.2, label="before")
    axis.plot(after["gait_phase"], after[channel] / scale, color=OURS, linewidth=1.4, label="tuned")
    axis.set_xlim(0, 100)
    axis.set_xlabel("gait cycle [%]")
    axis.set_title(label)
    axis.legend(fontsize=7, frameon=False)
