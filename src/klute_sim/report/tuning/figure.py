"""Figure of a tuning: tracking error over air consumption, and the gait before and after."""

from collections.abc import Sequence
from typing import TypeAlias

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from klute_sim.recording.recording import Recording
from klute_sim.report.gait.reference_text import shorten_reference_name
from klute_sim.report.style import (
    EARLIER_COLOUR,
    HUMAN_COLOUR,
    HUMAN_LINE,
    PROSTHESIS_COLOUR,
    add_heading,
    add_legend,
    use_style,
)
from klute_sim.types import Array

DESCRIPTION = (
    "Tracking error over air of all simulations (hollow: with a penalty) with the Pareto front, and commanded "
    "pressure, ankle moment and power over the gait cycle before and after tuning."
)
"""Text that stands for the figure where it cannot be seen."""
Point: TypeAlias = tuple[float, float]
"""Air per stride [g] and tracking error [sd²]."""
PARETO_FRONT_COLOUR = "#d62728"


def build_figure(
    evaluations: Sequence[Point],
    penalized: Sequence[Point],
    pareto_front: Sequence[Point],
    before_and_after: Sequence[tuple[Point, bool]],
    recordings: tuple[Recording, Recording],
) -> Figure:
    """Plot all evaluations, the Pareto front, and the last stride of ``recordings`` (before and after tuning).

    ``evaluations`` have no penalty, ``penalized`` have one; ``before_and_after`` are points with whether they have one.
    """
    first, last = (_select_last_stride(recording) for recording in recordings)
    mass = float(recordings[0].provenance["options"]["mass_kg"])
    with use_style() as create_figure:
        figure = create_figure(7.0)
        axes = figure.subplots(2, 2)
        _plot_pareto_front(axes[0, 0], evaluations, penalized, pareto_front, before_and_after)
        _plot_curves(axes[0, 1], first, last, "pressure_command", 1.0, "commanded gauge pressure [bar]")
        _plot_curves(axes[1, 0], first, last, "ankle_moment", mass, "net ankle moment [N·m/kg], plantarflexor up")
        _plot_curves(axes[1, 1], first, last, "ankle_power", mass, "net ankle power [W/kg], generation up")
        add_heading(figure, "gait before and after tuning", axes[1, 0])
    return figure


def _select_last_stride(recording: Recording) -> Recording:
    return recording.select(recording["stride"] == recording["stride"][-1])


def _plot_pareto_front(
    axis: Axes,
    evaluations: Sequence[Point],
    penalized: Sequence[Point],
    pareto_front: Sequence[Point],
    before_and_after: Sequence[tuple[Point, bool]],
) -> None:
    air, tracking = zip(*penalized, strict=True) if penalized else ((), ())
    label = f"{len(penalized)} simulations with a penalty"
    axis.scatter(air, tracking, s=9, facecolors="none", edgecolors=EARLIER_COLOUR, linewidths=0.7, label=label)
    air, tracking = zip(*evaluations, strict=True) if evaluations else ((), ())
    axis.scatter(air, tracking, s=9, color=EARLIER_COLOUR, label=f"{len(evaluations)} without")
    air, tracking = zip(*pareto_front, strict=True) if pareto_front else ((), ())
    axis.plot(air, tracking, color=PARETO_FRONT_COLOUR, drawstyle="steps-post", linewidth=1.2, label="Pareto front")
    styles = (("s", HUMAN_COLOUR, 6.0, "before"), ("*", PROSTHESIS_COLOUR, 12.0, "tuned"))
    for (point, has_penalty), (marker, colour, size, name) in zip(before_and_after, styles, strict=True):
        face = "none" if has_penalty else colour
        axis.plot(*point, marker, color=colour, markerfacecolor=face, markersize=size, label=name)
    axis.set_ylim(0.0, 2.0 * max(tracking_error for (_, tracking_error), _ in before_and_after))
    axis.set_xlabel("air per stride [g]")
    axis.set_title("tracking error [sd²] over air: lower left is better")
    add_legend(axis, max_columns=2)


def _plot_curves(axis: Axes, before: Recording, after: Recording, channel: str, scale: float, label: str) -> None:
    phase: Array = before["gait_phase"]
    if f"reference_{channel}" in before:
        reference = shorten_reference_name(before.provenance["reference"]["name"])
        axis.plot(phase, before[f"reference_{channel}"] / scale, label=reference, **HUMAN_LINE)
    axis.plot(phase, before[channel] / scale, color=EARLIER_COLOUR, linewidth=1.2, label="before")
    axis.plot(after["gait_phase"], after[channel] / scale, color=PROSTHESIS_COLOUR, linewidth=1.4, label="tuned")
    axis.set_xlim(0, 100)
    axis.set_xlabel("gait cycle [%]")
    axis.set_title(label)
