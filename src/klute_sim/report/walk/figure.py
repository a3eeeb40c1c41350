"""Figure of a walk: the mean stride of both legs over able-bodied adults, and the whole walk."""

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from klute_sim.constants import GRAVITY
from klute_sim.gait.reference import load_default_reference
from klute_sim.recording.recording import Recording
from klute_sim.report.style import COMPACT_STYLE, HUMAN_COLOUR, PROSTHESIS_COLOUR, fix_tick_label_size
from klute_sim.walker.outcomes import CURVES, N_PHASES, WalkOutcomes
from klute_sim.walker.person.body import MUSCLES

LEG_COLOURS = {"left": "#ff7f0e", "right": PROSTHESIS_COLOUR}
PANEL_TITLES = {
    "hip": "hip angle [deg] (flexion up)",
    "knee": "knee angle [deg] (flexion up)",
    "ankle": "ankle angle [deg] (dorsiflexion up)",
    "grf_vertical": "vertical ground reaction [body weights] (predicted)",
    "grf_forward": "fore-aft ground reaction [body weights] (predicted)",
}
"""Title of the panel by curve."""


def build_figure(recording: Recording, outcomes: WalkOutcomes) -> Figure:
    """Plot mean and standard deviation over the strides of each leg, muscle activations and the speed."""
    with matplotlib.rc_context(COMPACT_STYLE):
        return _build_figure(recording, outcomes)


def _build_figure(recording: Recording, outcomes: WalkOutcomes) -> Figure:
    provenance = recording.provenance
    figure = Figure(figsize=(11, 11), layout="constrained")
    axes = figure.subplots(4, 2)
    has_prosthesis = provenance["prosthesis"] is not None
    for axis, (curve, title) in zip(axes.flat, PANEL_TITLES.items(), strict=False):
        _plot_curve(axis, outcomes, curve, title, has_prosthesis)
    _plot_activations(axes[2, 1], recording)
    _plot_speed(axes[3, 0], recording)
    if "pressure_command" in recording:
        _plot_device(axes[3, 1], recording)
    else:
        _plot_load(axes[3, 1], recording)
    name = provenance["prosthesis"]["name"] if has_prosthesis else "intact person"
    acute = ", acute" if provenance["is_acute"] else ""
    fall = f"; falls after {outcomes.duration_s:.1f} s" if outcomes.has_fallen else ""
    figure.suptitle(f"{name}, walker {provenance['walker']['name']}{acute}: {provenance['kind']}{fall}")
    fix_tick_label_size(figure)
    return figure


def _plot_curve(axis: Axes, outcomes: WalkOutcomes, curve: str, title: str, has_prosthesis: bool) -> None:
    phase = np.linspace(0.0, 100.0, N_PHASES)
    scale = GRAVITY if curve.startswith("grf") else 1.0
    human = load_default_reference()(CURVES[curve][1], (0.01 * phase) % 1.0) / scale
    axis.plot(phase, human, color=HUMAN_COLOUR, linestyle="--", linewidth=1.0, label="human")
    for side, leg in outcomes.legs.items():
        mean, band = leg.curves[curve], leg.deviations[curve]
        label = "prosthesis" if has_prosthesis and side == "right" else f"{side} leg"
        axis.fill_between(phase, mean - band, mean + band, color=LEG_COLOURS[side], alpha=0.2, linewidth=0)
        axis.plot(phase, mean, color=LEG_COLOURS[side], linewidth=1.4, label=label)
    axis.set_title(title)
    axis.set_xlim(0, 100)
    axis.set_xlabel("gait cycle of the leg [%]")
    axis.legend(fontsize=7, frameon=False)
    axis.grid(alpha=0.25, linewidth=0.5)


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
    axis.set_title("mean activation [1]")
    axis.legend(fontsize=7, frameon=False)


def _plot_speed(axis: Axes, recording: Recording) -> None:
    axis.plot(recording["time"], recording["speed"], color="0.3", linewidth=0.8)
    axis.set_title("forward speed of the hip [m/s]")
    axis.set_xlabel("time [s]")
    axis.grid(alpha=0.25, linewidth=0.5)


def _plot_device(axis: Axes, recording: Recording) -> None:
    """Plot commanded pressure and moment of the device over the last seconds."""
    last = recording.select(recording["time"] > recording["time"][-1] - 4.0)
    axis.plot(last["time"], last["pressure_command"], color="#2ca02c", linewidth=1.2, label="command [bar]")
    axis.plot(last["time"], 0.05 * last["device_moment"], color="#d62728", linewidth=1.0, label="moment [20 N·m]")
    axis.set_title("device: command and moment (plantarflexor up)")
    axis.set_xlabel("time [s]")
    axis.legend(fontsize=7, frameon=False)


def _plot_load(axis: Axes, recording: Recording) -> None:
    """Plot the vertical ground reactions of the last seconds."""
    last = recording.select(recording["time"] > recording["time"][-1] - 4.0)
    weight = float(recording.provenance["options"]["mass_kg"]) * GRAVITY
    for side, colour in LEG_COLOURS.items():
        axis.plot(last["time"], last[f"grf_vertical_{side}"] / weight, color=colour, linewidth=1.0, label=side)
    axis.set_title("vertical ground reaction [body weights]")
    axis.set_xlabel("time [s]")
    axis.legend(fontsize=7, frameon=False)
