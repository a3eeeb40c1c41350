"""Figure of a gait run: joint mechanics, ground reaction, pressure and device forces over the gait cycle."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from klute_sim.constants import GRAVITY
from klute_sim.gait.metrics import compute_gait_metrics, is_level_ground, is_spring_foot
from klute_sim.recording.recording import Recording
from klute_sim.report.gait.reference_text import shorten_reference_name
from klute_sim.report.style import (
    COMMAND_LINE,
    EARLIER_COLOUR,
    HUMAN_BAND_COLOUR,
    HUMAN_LINE,
    PROSTHESIS_COLOUR,
    add_heading,
    add_legend,
    use_style,
)
from klute_sim.types import Array

DESCRIPTION = (
    "Ankle angle, net moment, power, moment over angle and ground reaction of the last stride over the human reference "
    "with its band of one standard deviation; below, pressure and forces of the device."
)
"""Text that stands for the figure where it cannot be seen."""


def build_figure(recording: Recording) -> Figure:
    """Plot the last stride of ``recording`` over the reference and its ±1 sd band, with earlier strides faintly.

    Pressure and forces of the device are left out for a spring foot, which has none.
    """
    rows = 3 if is_spring_foot(recording) else 4
    mass = float(recording.provenance["options"]["mass_kg"])
    weight = mass * GRAVITY
    strides = [recording.select(recording["stride"] == k) for k in range(1, int(recording["stride"][-1]) + 1)]
    with use_style() as create_figure:
        figure = create_figure(0.8 + 2.6 * rows)
        axes = figure.subplots(rows, 2)
        panels = (
            (axes[0, 0], "ankle_angle", 1.0, "ankle angle [deg], dorsiflexion up"),
            (axes[0, 1], "ankle_moment", mass, "net ankle moment [N·m/kg], plantarflexor up"),
            (axes[1, 0], "ankle_power", mass, "net ankle power [W/kg], generation up"),
            (axes[2, 0], "grf_vertical", weight, "vertical ground reaction [body weights], tracked"),
            (axes[2, 1], "grf_forward", weight, "fore-aft ground reaction [body weights], forward up"),
        )
        for axis, channel, scale, title in panels:
            _plot_against_reference(axis, strides, channel, scale, title)
        _plot_moment_over_angle(axes[1, 1], strides, mass)
        if not is_spring_foot(recording):
            _plot_pressure(axes[3, 0], strides[-1])
            _plot_forces(axes[3, 1], strides[-1])
        for axis in axes.flat:
            if axis is not axes[1, 1]:
                axis.set_xlim(0, 100)
                axis.set_xlabel("gait cycle [%]")
        add_heading(figure, _format_heading(recording, len(strides)), axes[0, 0])
    return figure


def _format_heading(recording: Recording, n_strides: int) -> str:
    provenance = recording.provenance
    options = provenance["options"]
    slope = "" if is_level_ground(recording) else f", slope {options['slope_deg']:+g}° (no measured reference)"
    has_swing_contact = compute_gait_metrics(recording).has_swing_contact
    contact_note = "\nthe foot touches the ground in swing: it trips" if has_swing_contact else ""
    mass = float(options["mass_kg"])
    return (
        f"{provenance['device']['name']}, {mass:.4g} kg, {options['speed_m_per_s']:.2f} m/s{slope}, "
        f"stride {n_strides} of {n_strides}\nreference: {provenance['reference']['name']}{contact_note}"
    )


def _plot_against_reference(axis: Axes, strides: list[Recording], channel: str, scale: float, title: str) -> None:
    last = strides[-1]
    phase, human = last["gait_phase"], last[f"reference_{channel}"] / scale
    reference = shorten_reference_name(last.provenance["reference"]["name"])
    if f"reference_{channel}_sd" in last:
        band: Array = last[f"reference_{channel}_sd"] / scale
        axis.fill_between(
            phase, human - band, human + band, color=HUMAN_BAND_COLOUR, linewidth=0.0, label=f"{reference} ±1 sd"
        )
    axis.plot(phase, human, label=_format_reference_label(last), **HUMAN_LINE)
    for number, stride in enumerate(strides[:-1]):
        name = "earlier strides" if number == 0 else None
        axis.plot(stride["gait_phase"], stride[channel] / scale, color=EARLIER_COLOUR, linewidth=0.7, label=name)
    axis.plot(phase, last[channel] / scale, color=PROSTHESIS_COLOUR, linewidth=1.4, label="prosthesis")
    axis.set_title(title)


def _format_reference_label(recording: Recording) -> str:
    name = shorten_reference_name(recording.provenance["reference"]["name"])
    return name if is_level_ground(recording) else f"{name} on level ground, rotated"


def _plot_moment_over_angle(axis: Axes, strides: list[Recording], mass: float) -> None:
    last = strides[-1]
    axis.plot(
        last["reference_ankle_angle"],
        last["reference_ankle_moment"] / mass,
        label=_format_reference_label(last),
        **HUMAN_LINE,
    )
    axis.plot(
        last["ankle_angle"], last["ankle_moment"] / mass, color=PROSTHESIS_COLOUR, linewidth=1.4, label="prosthesis"
    )
    axis.set_title("net ankle moment [N·m/kg] over angle")
    axis.set_xlabel("dorsiflexion [deg]; counter-clockwise: positive net work")


def _plot_pressure(axis: Axes, stride: Recording) -> None:
    phase = stride["gait_phase"]
    axis.plot(phase, stride["pressure"], color="#2ca02c", linewidth=1.8, label="delivered")
    axis.plot(phase, stride["pressure_command"], label="commanded", **COMMAND_LINE)
    axis.set_title("gauge pressure [bar]")
    axis.set_ylim(bottom=0)
    add_legend(axis)


def _plot_forces(axis: Axes, stride: Recording) -> None:
    phase = stride["gait_phase"]
    axis.plot(phase, stride["force"], color="#d62728", linewidth=1.4, label="tendon")
    axis.plot(phase, stride["muscle_force"], color="#9467bd", linewidth=1.0, label="muscle")
    axis.plot(phase, stride["damper_force"], color="#8c564b", linewidth=1.0, label="damper")
    axis.set_title("device forces [N]")
    add_legend(axis)
