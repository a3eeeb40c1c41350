"""Figure of a design: force and orifices over velocity, and the demand of a stride."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from klute_sim.report.style import HUMAN_COLOUR, PROSTHESIS_COLOUR, ZERO_LINE_COLOUR, add_legend, use_style
from klute_sim.sizing.evaluation.demand import StrideDemand
from klute_sim.sizing.evaluation.velocity import compute_required_orifices
from klute_sim.sizing.sizing import Design
from klute_sim.units import BAR

DESCRIPTION = (
    "Force and orifice diameters over the velocity of the muscle-tendon unit and, for a person, the force and the "
    "pressure that a stride demands beside what the device has."
)
"""Text that stands for the figure where it cannot be seen."""


def build_figure(design: Design) -> Figure:
    """Plot force and orifice diameters of ``design`` over velocity and, for a gait, demand and supply over a stride."""
    demand, option = design.demand, design.selected
    with use_style() as create_figure:
        rows = 2 if demand else 1
        figure = create_figure(0.4 + 3.7 * rows)
        axes = figure.subplots(rows, 2, squeeze=False)
        _plot_force_velocity(axes[0, 0], design)
        _plot_orifice_diameters(axes[0, 1], design)
        if demand:
            _plot_force_demand(axes[1, 0], demand)
            _plot_pressure_demand(axes[1, 1], demand, design.choices.supply_pressure)
        figure.suptitle(
            f"{design.device.name}: {option.count} × {option.actuator}, {1e3 * option.resting_length:.0f} mm, "
            f"F0 {design.isometric_force:.0f} N at {design.choices.supply_pressure / BAR:g} bar"
        )
    return figure


def _plot_force_velocity(axis: Axes, design: Design) -> None:
    curves, speed = design.curves, 1e3 * design.curves.velocity
    axis.plot(speed, curves.muscle / curves.isometric, color="0.75", linewidth=5, label="muscle (Hill)")
    axis.plot(speed, curves.actuator_only / curves.isometric, color="#d62728", linewidth=1.1, label="actuator only")
    ideal = curves.ideal_damper / curves.isometric
    axis.plot(speed, ideal, color=HUMAN_COLOUR, linestyle="--", linewidth=1.1, label="with ideal damper")
    axis.plot(
        speed,
        curves.fixed_orifices / curves.isometric,
        color=PROSTHESIS_COLOUR,
        linewidth=1.6,
        label="with fixed orifices",
    )
    axis.axvline(0.0, color=ZERO_LINE_COLOUR, linewidth=0.6)
    axis.set_title("force / F0")
    axis.set_xlabel("velocity [mm/s], shortening positive")
    axis.set_ylim(bottom=0.0)
    add_legend(axis, max_columns=2)


def _plot_orifice_diameters(axis: Axes, design: Design) -> None:
    point = design.damper.concentric
    required = 1e3 * compute_required_orifices(
        design.curves, design.damper.bore, point.oil_density, point.discharge_coefficient
    )
    speed = 1e3 * design.curves.velocity
    axis.plot(speed, required, color=HUMAN_COLOUR, linestyle="--", linewidth=1.1, label="required for Hill (4.6)")
    # Each direction has its own orifice: two separate levels.
    for label, end, orifice in (
        ("fixed", speed[-1], design.damper.concentric.orifice_diameter),
        (None, speed[0], design.damper.eccentric.orifice_diameter),
    ):
        axis.plot([0.0, end], [1e3 * orifice] * 2, color=PROSTHESIS_COLOUR, linewidth=1.6, label=label)
    axis.axvline(0.0, color=ZERO_LINE_COLOUR, linewidth=0.6)
    axis.set_title("orifice diameter [mm]")
    axis.set_xlabel("velocity [mm/s], shortening positive")
    axis.set_ylim(bottom=0.0)
    add_legend(axis, max_columns=2)


def _plot_force_demand(axis: Axes, demand: StrideDemand) -> None:
    phase = 100.0 * demand.phase
    axis.plot(phase, demand.max_isometric_force, color="#d62728", linewidth=1.1, label="isometric, supply pressure")
    axis.plot(
        phase, demand.commanded_isometric_force, color="#9467bd", linewidth=1.1, label="isometric, commanded pressure"
    )
    required = np.where(demand.is_loaded, demand.tendon_force - demand.damping_force, np.nan)
    axis.plot(phase, required, color=PROSTHESIS_COLOUR, linestyle="--", linewidth=1.2, label="required, with damper")
    axis.plot(phase, demand.tendon_force, color=HUMAN_COLOUR, linewidth=1.6, label="required by the tendon")
    axis.set_title("force over the stride [N]")
    _format_gait_cycle_axis(axis)


def _plot_pressure_demand(axis: Axes, demand: StrideDemand, supply_pressure: float) -> None:
    phase = 100.0 * demand.phase
    axis.plot(phase, demand.required_pressure / BAR, color=PROSTHESIS_COLOUR, linewidth=1.6, label="required")
    axis.axhline(supply_pressure / BAR, color="#d62728", linewidth=1.0, linestyle="--", label="supply")
    axis.set_title("gauge pressure over the stride [bar]")
    _format_gait_cycle_axis(axis)
    ratio_axis = axis.twinx()
    ratio_axis.plot(phase, demand.length_ratio, color="#2ca02c", linewidth=1.0)
    ratio_axis.set_ylabel("muscle length / L0", color="#2ca02c")
    ratio_axis.spines["right"].set_visible(True)
    ratio_axis.grid(visible=False)


def _format_gait_cycle_axis(axis: Axes) -> None:
    axis.set_xlim(0, 100)
    axis.set_ylim(bottom=0.0)
    axis.set_xlabel("gait cycle [%]")
    add_legend(axis, max_columns=2)
