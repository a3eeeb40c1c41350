"""The picture of a design: force over velocity, and the stride's demand."""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from klute_sim.design.demand import Demand
from klute_sim.design.sizing import Design
from klute_sim.design.velocity import needed_orifice
from klute_sim.report.figure import HUMAN, OURS, STYLE
from klute_sim.units import BAR


def draw(found: Design, path: Path) -> None:
    """Write the picture of ``found`` to ``path``."""
    with matplotlib.rc_context(STYLE):
        _draw(found, path)


def _draw(found: Design, path: Path) -> None:
    rows = 2 if found.demand else 1
    figure = Figure(figsize=(11, 4.2 * rows), layout="constrained")
    axes = figure.subplots(rows, 2, squeeze=False)
    _velocity(axes[0, 0], found)
    _orifice(axes[0, 1], found)
    if found.demand:
        _force(axes[1, 0], found.demand)
        _pressure(axes[1, 1], found.demand, found.choices.supply_pressure)
    for axis in axes.flat:
        axis.grid(alpha=0.25, linewidth=0.5)
    option = found.option
    figure.suptitle(
        f"{found.device.name}: {option.count} × {option.actuator}, {1e3 * option.resting_length:.0f} mm, "
        f"F0 {found.force:.0f} N at {found.choices.supply_pressure / BAR:g} bar"
    )
    figure.savefig(path, dpi=130)


def _velocity(axis: Axes, found: Design) -> None:
    curves, speed = found.curves, 1e3 * found.curves.velocity
    axis.plot(speed, curves.hill / curves.isometric, color="0.75", linewidth=5, label="muscle (Hill)")
    axis.plot(speed, curves.alone / curves.isometric, color="#d62728", linewidth=1.1, label="actuator alone")
    ideal = curves.ideal / curves.isometric
    axis.plot(speed, ideal, color=HUMAN, linestyle="--", linewidth=1.1, label="with ideal damper")
    axis.plot(speed, curves.fixed / curves.isometric, color=OURS, linewidth=1.6, label="with fixed orifices")
    axis.axvline(0.0, color="0.6", linewidth=0.6)
    axis.set_title("force over F0")
    axis.set_xlabel("velocity [mm/s], shortening positive")
    axis.set_ylim(bottom=0.0)
    axis.legend(fontsize=7, frameon=False)


def _orifice(axis: Axes, found: Design) -> None:
    point = found.damper.concentric
    needed = 1e3 * needed_orifice(found.curves, found.damper.bore, point.density, point.discharge)
    speed = 1e3 * found.curves.velocity
    axis.plot(speed, needed, color=HUMAN, linestyle="--", linewidth=1.1, label="needed for Hill (4.6)")
    # One orifice per direction: two levels, with nothing between them.
    for label, end, orifice in (
        ("fixed", speed[-1], found.damper.concentric.orifice),
        (None, speed[0], found.damper.eccentric.orifice),
    ):
        axis.plot([0.0, end], [1e3 * orifice] * 2, color=OURS, linewidth=1.6, label=label)
    axis.axvline(0.0, color="0.6", linewidth=0.6)
    axis.set_title("orifice diameter [mm]")
    axis.set_xlabel("velocity [mm/s], shortening positive")
    axis.set_ylim(bottom=0.0)
    axis.legend(fontsize=7, frameon=False)


def _force(axis: Axes, demand: Demand) -> None:
    phase = 100.0 * demand.phase
    axis.plot(phase, demand.strongest, color="#d62728", linewidth=1.1, label="isometric, supply's pressure")
    axis.plot(phase, demand.commanded, color="#9467bd", linewidth=1.1, label="isometric, its own profile")
    asked = np.where(demand.loaded, demand.tendon - demand.damping, np.nan)
    axis.plot(phase, asked, color=OURS, linestyle="--", linewidth=1.2, label="needed, with damper")
    axis.plot(phase, demand.tendon, color=HUMAN, linewidth=1.6, label="needed by the tendon")
    axis.set_title("force over the stride [N]")
    _over_cycle(axis)


def _pressure(axis: Axes, demand: Demand, supply: float) -> None:
    phase = 100.0 * demand.phase
    axis.plot(phase, demand.needed_pressure / BAR, color=OURS, linewidth=1.6, label="needed")
    axis.axhline(supply / BAR, color="#d62728", linewidth=1.0, linestyle="--", label="supply")
    axis.set_title("gauge pressure over the stride [bar]")
    _over_cycle(axis)
    beside = axis.twinx()
    beside.plot(phase, demand.ratio, color="#2ca02c", linewidth=1.0)
    beside.set_ylabel("muscle length / L0", color="#2ca02c")
    beside.spines["right"].set_visible(True)


def _over_cycle(axis: Axes) -> None:
    axis.set_xlim(0, 100)
    axis.set_ylim(bottom=0.0)
    axis.set_xlabel("gait cycle [%]")
    axis.legend(fontsize=7, frameon=False)
