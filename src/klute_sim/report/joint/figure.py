"""Figure of a joint test: pressures, forces and position of every trial over time."""

from matplotlib.figure import Figure

from klute_sim.datasets.mechanism_channels import normalize_name
from klute_sim.mechanism.run import JointTestResult
from klute_sim.report.style import use_style

COLOURS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b")
"""Colours of the trials, used again from the first."""
LINE_STYLES = ("-", "--")
"""Line styles of the devices."""


def build_figure(result: JointTestResult) -> Figure:
    """Plot all trials of ``result``: position of the joint, then pressures and forces of the devices."""
    with use_style() as create_figure:
        figure = create_figure(8.0, 7.0)
        position, pressure, force = figure.subplots(3, 1, sharex=True)
        for k, trial in enumerate(result.trials):
            recording, colour = trial.recording, COLOURS[k % len(COLOURS)]
            time = recording["time"]
            position.plot(time, recording[result.position_channel], color=colour, label=trial.name)
            for name, style in zip(map(normalize_name, result.devices), LINE_STYLES, strict=False):
                pressure.plot(time, recording[f"pressure_{name}"], style, color=colour, linewidth=1.0)
                force.plot(time, recording[f"force_{name}"], style, color=colour, linewidth=1.0)
        names = list(result.devices)
        legend = f"{names[0]} (solid)" + (f", {names[1]} (dashed)" if len(names) > 1 else "")
        position.set_ylabel("angle [deg]" if result.unit == "deg" else "position [mm]")
        figure.legend(*position.get_legend_handles_labels(), loc="outside lower center", ncols=4)
        pressure.set_ylabel("gauge pressure [bar]")
        pressure.set_title(legend)
        force.set_ylabel("force [N]")
        force.set_xlabel("time [s]")
        figure.suptitle(f"{result.test}: {result.file.name}")
        for axis in figure.axes:
            axis.grid(alpha=0.25, linewidth=0.5)
    return figure
