"""Figure of a joint test: pressures, forces and position of every trial over time."""

from matplotlib.figure import Figure

from klute_sim.datasets.mechanism_channels import normalize_name
from klute_sim.mechanism.run import JointTestResult, JointTrialResult
from klute_sim.report.joint.table import split_name
from klute_sim.report.style import add_heading, get_ordered_colours, get_series_colour, use_style

DESCRIPTION = "Position of the joint, pressures and forces of the devices of every trial over time."
"""Text that stands for the figure where it cannot be seen."""
LINE_STYLES = ("-", "--")
"""Line styles of the devices."""


def build_figure(result: JointTestResult) -> Figure:
    """Plot all trials of ``result``: position of the joint, then pressures and forces of the devices.

    The condition that varies orders the trials and their colours.
    """
    trials, labels, colours = _order_trials(result)
    with use_style() as create_figure:
        figure = create_figure(7.5)
        position, pressure, force = figure.subplots(3, 1, sharex=True)
        for trial, label, colour in zip(trials, labels, colours, strict=True):
            recording = trial.recording
            time = recording["time"]
            position.plot(time, recording[result.position_channel], color=colour, label=label)
            for name, style in zip(map(normalize_name, result.devices), LINE_STYLES, strict=False):
                pressure.plot(time, recording[f"pressure_{name}"], style, color=colour, linewidth=1.0)
                force.plot(time, recording[f"force_{name}"], style, color=colour, linewidth=1.0)
        names = list(result.devices)
        devices = f"{names[0]} (solid)" + (f", {names[1]} (dashed)" if len(names) > 1 else "")
        unit = "deg" if result.unit == "deg" else "mm"
        position.set_title(f"{'angle' if unit == 'deg' else 'position'} [{unit}]")
        pressure.set_title(f"gauge pressure [bar]: {devices}")
        force.set_title(f"force [N]: {devices}")
        force.set_xlabel("time [s]")
        add_heading(figure, f"{result.test}: {result.file.name}", position)
    return figure


def _order_trials(result: JointTestResult) -> tuple[list[JointTrialResult], list[str], list[str]]:
    """Return the trials in the order of the condition that varies, with label and colour; by name if none does."""
    trials = list(result.trials)
    for key in trials[0].conditions:
        values = [trial.conditions[key] for trial in trials]
        if len(set(values)) == len(values) > 1:
            name, unit = split_name(result, key)
            trials.sort(key=lambda trial: trial.conditions[key])
            sign = "+" if min(values) < 0.0 else ""
            labels = [f"{name} {trial.conditions[key]:{sign}.4g} {unit}".rstrip() for trial in trials]
            colours = get_ordered_colours(values)
            return trials, labels, [colours[trial.conditions[key]] for trial in trials]
    return trials, [trial.name for trial in trials], [get_series_colour(k) for k in range(len(trials))]
