"""Figure of an assessment: the gaits of several prostheses over the person's own ankle."""

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from klute_sim.constants import GRAVITY
from klute_sim.recording.recording import Recording
from klute_sim.report.style import HUMAN_LINE, add_heading, get_series_colour, use_style

MAX_CURVES = 5
"""Maximum number of prostheses in the figure; more are hard to tell from each other."""


def build_figure(recordings: Mapping[str, Recording]) -> Figure:
    """Plot the last stride of each of ``recordings`` (name -> run), at most :data:`MAX_CURVES`, over the own ankle."""
    last_strides = {
        name: recording.select(recording["stride"] == recording["stride"][-1])
        for name, recording in list(recordings.items())[:MAX_CURVES]
    }
    mass = float(next(iter(recordings.values())).provenance["options"]["mass_kg"])
    weight = mass * GRAVITY
    panels = (
        ("ankle_angle", 1.0, "ankle angle [deg], dorsiflexion up"),
        ("ankle_moment", mass, "net ankle moment [N·m/kg], plantarflexor up"),
        ("ankle_power", mass, "net ankle power [W/kg], generation up"),
        ("pressure", 1.0, "gauge pressure [bar]"),
        ("grf_vertical", weight, "vertical ground reaction [body weights], tracked"),
        ("grf_forward", weight, "fore-aft ground reaction [body weights], forward up"),
    )
    with use_style() as create_figure:
        figure = create_figure(8.5)
        axes = figure.subplots(3, 2)
        for axis, (channel, scale, title) in zip(axes.flat, panels, strict=True):
            _plot_channel(axis, last_strides, channel, scale, title)
        add_heading(figure, "last stride", axes[0, 0], max_columns=3)
    return figure


def _plot_channel(axis: Axes, strides: Mapping[str, Recording], channel: str, scale: float, title: str) -> None:
    first = next(iter(strides.values()))
    if f"reference_{channel}" in first:
        own = first[f"reference_{channel}"] / scale
        axis.plot(first["gait_phase"], own, label="own ankle", **HUMAN_LINE)
    for number, (name, stride) in enumerate(strides.items()):
        axis.plot(
            stride["gait_phase"], stride[channel] / scale, color=get_series_colour(number), linewidth=1.1, label=name
        )
    axis.set_title(title)
    axis.set_xlim(0, 100)
    axis.set_xlabel("gait cycle [%]")
