"""Figure of a walk: the mean stride of both legs over able-bodied adults, and the whole walk."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from klute_sim.constants import GRAVITY
from klute_sim.gait.reference import load_default_reference
from klute_sim.recording.recording import Recording
from klute_sim.report.style import COMMAND_LINE, HUMAN_LINE, PROSTHESIS_COLOUR, add_heading, add_legend, use_style
from klute_sim.walker.outcomes import CURVES, N_PHASES, WalkOutcomes
from klute_sim.walker.person.body import MUSCLES

DESCRIPTION = (
    "Mean stride of both legs over that of able-bodied adults: hip, knee and ankle angle and ground reaction; below, "
    "mean activation of the muscles, speed, and pressure and moment of the device over time."
)
"""Text that stands for the figure where it cannot be seen."""
LEG_COLOURS = {"left": "#e6842a", "right": PROSTHESIS_COLOUR}
PANEL_TITLES = {
    "hip": "hip angle [deg], flexion up",
    "knee": "knee angle [deg], flexion up",
    "ankle": "ankle angle [deg], dorsiflexion up",
    "grf_vertical": "vertical ground reaction [body weights], predicted",
    "grf_forward": "fore-aft ground reaction [body weights], forward up",
}
"""Title of the panel by curve."""
SHOWN_SECONDS = 4.0
"""Time at the end of the walk over which the device is plotted [s]."""


def build_figure(recording: Recording, outcomes: WalkOutcomes) -> Figure:
    """Plot mean and standard deviation over the strides of each leg, muscle activations and the speed."""
    provenance = recording.provenance
    has_prosthesis = provenance["prosthesis"] is not None
    name = provenance["prosthesis"]["name"] if has_prosthesis else "intact person"
    acute = ", acute" if provenance["is_acute"] else ""
    fall = f"; falls after {outcomes.duration_s:.1f} s" if outcomes.has_fallen else ""
    has_device = "pressure_command" in recording
    rows = 5 if has_device else 4
    with use_style() as create_figure:
        figure = create_figure(0.3 + 2.7 * rows)
        axes = figure.subplots(rows, 2)
        for axis, (curve, title) in zip(axes.flat, PANEL_TITLES.items(), strict=False):
            _plot_curve(axis, outcomes, curve, title, has_prosthesis)
        _plot_activations(axes[2, 1], recording)
        _plot_speed(axes[3, 0], recording)
        _plot_load(axes[3, 1], recording)
        if has_device:
            _plot_device(axes[4], recording)
        heading = f"{name}, walker {provenance['walker']['name']}{acute}: {provenance['kind']}{fall}"
        add_heading(figure, heading, axes[0, 0])
    return figure


def _plot_curve(axis: Axes, outcomes: WalkOutcomes, curve: str, title: str, has_prosthesis: bool) -> None:
    phase = np.linspace(0.0, 100.0, N_PHASES)
    scale = GRAVITY if curve.startswith("grf") else 1.0
    human = load_default_reference()(CURVES[curve][1], (0.01 * phase) % 1.0) / scale
    axis.plot(phase, human, label="human", **HUMAN_LINE)
    for side, leg in outcomes.legs.items():
        mean, band = leg.curves[curve], leg.deviations[curve]
        label = "prosthesis" if has_prosthesis and side == "right" else f"{side} leg"
        axis.fill_between(phase, mean - band, mean + band, color=LEG_COLOURS[side], alpha=0.2, linewidth=0)
        axis.plot(phase, mean, color=LEG_COLOURS[side], linewidth=1.4, label=label)
    axis.set_title(title)
    axis.set_xlim(0, 100)
    axis.set_xlabel("gait cycle of the leg [%]")


def _plot_activations(axis: Axes, recording: Recording) -> None:
    """Plot the mean activation of each muscle of each leg."""
    height = 0.38
    for k, side in enumerate(("left", "right")):
        values = [
            float(recording[f"activation_{muscle}_{side}"].mean())
            if f"activation_{muscle}_{side}" in recording
            else 0.0
            for muscle in MUSCLES
        ]
        axis.barh(np.arange(len(MUSCLES)) + (k - 0.5) * height, values, height, color=LEG_COLOURS[side], label=side)
    axis.set_yticks(range(len(MUSCLES)), [name.replace("_", " ") for name in MUSCLES])
    axis.invert_yaxis()
    axis.set_title("mean activation [1], from 0 to 1")
    axis.grid(visible=False, axis="y")
    axis.locator_params(axis="x", nbins=5)


def _plot_speed(axis: Axes, recording: Recording) -> None:
    axis.plot(recording["time"], recording["speed"], color="0.3", linewidth=0.8)
    axis.set_title("forward speed of the hip [m/s]")
    axis.set_xlabel("time [s]")


def _plot_device(axes: Sequence[Axes], recording: Recording) -> None:
    """Plot pressure and moment of the device over the last seconds."""
    last = recording.select(recording["time"] > recording["time"][-1] - SHOWN_SECONDS)
    pressure, moment = axes
    pressure.plot(last["time"], last["pressure"], color="#2ca02c", linewidth=2.0, label="delivered")
    pressure.plot(last["time"], last["pressure_command"], label="commanded", **COMMAND_LINE)
    pressure.set_title("gauge pressure [bar]")
    add_legend(pressure)
    moment.plot(last["time"], last["device_moment"], color=PROSTHESIS_COLOUR, linewidth=1.4)
    moment.set_title("moment of the device [N·m], plantarflexor up")
    for axis in axes:
        axis.set_xlabel("time [s]")


def _plot_load(axis: Axes, recording: Recording) -> None:
    """Plot the vertical ground reactions of the last seconds."""
    last = recording.select(recording["time"] > recording["time"][-1] - SHOWN_SECONDS)
    weight = float(recording.provenance["options"]["mass_kg"]) * GRAVITY
    for side, colour in LEG_COLOURS.items():
        axis.plot(last["time"], last[f"grf_vertical_{side}"] / weight, color=colour, linewidth=1.0, label=side)
    axis.set_title("vertical ground reaction [body weights]")
    axis.set_xlabel("time [s]")
