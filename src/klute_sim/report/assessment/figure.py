"""Figure of an assessment: the gaits of several prostheses over the person's own ankle."""

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from klute_sim.constants import GRAVITY
from klute_sim.recording.recording import Recording
from klute_sim.report.style import HUMAN_LINE, add_heading, get_series_colour, use_style

MAX_CURVES = 5
"""Maximum number of prostheses in the figure, if the user has fewer; more are hard to tell from each other."""
USER_WIDTH, SHIPPED_WIDTH = 2.2, 1.1
"""Width of the curves of the user's controllers and of shipped ones [points]."""


def build_figure(user_recordings: Mapping[str, Recording], shipped_recordings: Mapping[str, Recording]) -> Figure:
    """Plot the last stride of each run (label -> recording) over the own ankle.

    All ``user_recordings`` are drawn, by thick lines; then the first of the ``shipped_recordings``, as long as
    there are at most :data:`MAX_CURVES`.
    """
    chosen = {**user_recordings, **dict(list(shipped_recordings.items())[: max(0, MAX_CURVES - len(user_recordings))])}
    last_strides = {
        name: recording.select(recording["stride"] == recording["stride"][-1]) for name, recording in chosen.items()
    }
    widths = {name: USER_WIDTH if name in user_recordings else SHIPPED_WIDTH for name in chosen}
    mass = float(next(iter(chosen.values())).provenance["options"]["mass_kg"])
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
            _plot_channel(axis, last_strides, widths, channel, scale, title)
        add_heading(figure, "last stride", axes[0, 0], max_columns=3)
    return figure


def _plot_channel(
    axis: Axes,
    strides: Mapping[str, Recording],
    widths: Mapping[str, float],
    channel: str,
    scale: float,
    title: str,
) -> None:
    first = next(iter(strides.values()))
    if f"reference_{channel}" in first:
        ankle_curve = first[f"reference_{channel}"] / scale
        axis.plot(first["gait_phase"], ankle_curve, label="own ankle", **HUMAN_LINE)
    for number, (name, stride) in enumerate(strides.items()):
        # A thick line below thin ones leaves both visible where they agree.
        axis.plot(
            stride["gait_phase"],
            stride[channel] / scale,
            color=get_series_colour(number),
            linewidth=widths[name],
            zorder=3.0 - 0.1 * widths[name],
            label=name,
        )
    axis.set_title(title)
    axis.set_xlim(0, 100)
    axis.set_xlabel("gait cycle [%]")
