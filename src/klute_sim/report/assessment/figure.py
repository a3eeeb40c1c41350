"""Figure of an assessment: the gaits of several prostheses over the person's own ankle."""

from collections.abc import Mapping

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from klute_sim.constants import GRAVITY
from klute_sim.recording.recording import Recording
from klute_sim.report.style import COMPACT_STYLE, HUMAN_COLOUR, fix_tick_label_size

MAX_CURVES = 5
"""Maximum number of prostheses in the figure; more are hard to tell from each other."""


def build_figure(recordings: Mapping[str, Recording]) -> Figure:
    """Plot the last stride of each of ``recordings`` (name -> run), at most :data:`MAX_CURVES`, over the own ankle."""
    last_strides = {
        name: recording.select(recording["stride"] == recording["stride"][-1])
        for name, recording in list(recordings.items())[:MAX_CURVES]
    }
    mass = float(next(iter(recordings.values())).provenance["options"]["mass_kg"])
    with matplotlib.rc_context({**COMPACT_STYLE, "text.parse_math": False}):
        figure = Figure(figsize=(11, 7.5), layout="constrained")
        axes = figure.subplots(2, 3)
        _plot_channel(axes[0, 0], last_strides, "ankle_angle", 1.0, "ankle angle [deg], dorsiflexion up")
        _plot_channel(axes[0, 1], last_strides, "ankle_moment", mass, "net ankle moment [N·m/kg]")
        _plot_channel(axes[0, 2], last_strides, "ankle_power", mass, "net ankle power [W/kg]")
        _plot_channel(axes[1, 0], last_strides, "grf_vertical", mass * GRAVITY, "vertical load [body weights]")
        _plot_channel(axes[1, 1], last_strides, "grf_forward", mass * GRAVITY, "fore-aft load [body weights]")
        _plot_channel(axes[1, 2], last_strides, "pressure", 1.0, "gauge pressure [bar]")
        axes[0, 0].legend(fontsize=7, frameon=False)
        fix_tick_label_size(figure)
    return figure


def _plot_channel(axis: Axes, strides: Mapping[str, Recording], channel: str, scale: float, title: str) -> None:
    first = next(iter(strides.values()))
    if f"reference_{channel}" in first:
        own = first[f"reference_{channel}"] / scale
        axis.plot(first["gait_phase"], own, "--", color=HUMAN_COLOUR, linewidth=1.6, label="own ankle")
    for number, (name, stride) in enumerate(strides.items()):
        axis.plot(stride["gait_phase"], stride[channel] / scale, color=f"C{number}", linewidth=1.1, label=name)
    axis.set_title(title)
    axis.set_xlim(0, 100)
    axis.set_xlabel("gait cycle [%]")
    axis.grid(alpha=0.25, linewidth=0.5)
