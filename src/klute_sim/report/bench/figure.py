"""Figures of bench runs: one layout for each kind of test."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from klute_sim.bench.run import BenchResult, BenchTrial
from klute_sim.report.style import (
    ZERO_LINE_COLOUR,
    add_heading,
    add_legend,
    get_ordered_colours,
    get_series_colour,
    use_style,
)
from klute_sim.types import Array

DESCRIPTIONS = {
    "isometric": "Isometric force over the length of the muscle, one curve for each pressure.",
    "isokinetic": "Force over shortening velocity, absolute and over the isometric one, for each pressure and length.",
    "quick-release": "Force over time around a release, and lowest and recovered force over the size of the release.",
    "step": "Commanded and delivered pressure, and force, over time after steps of pressure.",
    "frequency": "Gain and phase of pressure and force over the frequency of the pressure command.",
    "creep": "Force over the logarithm of time after a step of length, one curve for each pressure.",
    "workloop": "Work loops, force over length, and the pressure over the cycle, for each velocity and pressure.",
    "identification": "Length, pressure and force of every trial over time.",
}
"""Kind of test -> text that stands for its figure where it cannot be seen."""
DIRECTION_ARROW_SIZE = 13
"""Size of the arrows on a work loop [points]."""
CreateFigure = Callable[..., Figure]
"""Function of :func:`klute_sim.report.style.use_style` that creates a figure of a height and width [inches]."""
Plot = tuple[Figure, Axes | None]
"""Figure, and the panel with the legend that belongs to all panels; None: the panels have their own legends."""
MAX_LOOP_COLUMNS = 2
"""Maximum number of work loops side by side."""
LINE_STYLES = ("-", "--", ":", "-.")
"""Line styles of the lengths, or of the velocities, at one pressure."""


def build_figure(result: BenchResult) -> Figure:
    """Plot the trials of ``result`` in the layout for its kind of test."""
    rig = "MuJoCo tester" if result.use_mujoco else "device only"
    with use_style() as create_figure:
        figure, legend_axis = _PLOTTERS[result.protocol.kind](result, create_figure)
        heading = f"{result.protocol.name}: {result.device.name}, {rig}"
        if legend_axis is None:
            figure.suptitle(heading)
        else:
            add_heading(figure, heading, legend_axis)
    return figure


def _group_trials(trials: Iterable[BenchTrial], *keys: str) -> dict[tuple[float, ...], list[BenchTrial]]:
    """Group ``trials`` by their conditions ``keys``; groups are in the order of their first trials."""
    groups: dict[tuple[float, ...], list[BenchTrial]] = {}
    for trial in trials:
        groups.setdefault(tuple(trial.conditions[key] for key in keys), []).append(trial)
    return groups


def _get_values(trials: list[BenchTrial], key: str) -> list[float]:
    return [(trial.conditions | trial.metrics)[key] for trial in trials]


def _set_labels(axis: Axes, x_label: str, y_label: str, title: str = "") -> None:
    axis.set_xlabel(x_label)
    axis.set_ylabel(y_label)
    axis.set_title(title)


def _get_pressure_colours(trials: Iterable[BenchTrial]) -> dict[float, str]:
    """Return pressure [bar] -> colour, darker for lower pressures."""
    return get_ordered_colours({trial.conditions["pressure_bar"] for trial in trials})


def _plot_isometric(result: BenchResult, create_figure: CreateFigure) -> Plot:
    figure = create_figure(5.0, 7.0)
    axis = figure.subplots()
    colours = _get_pressure_colours(result.trials)
    for (bar,), trials in _group_trials(result.trials, "pressure_bar").items():
        points = sorted(zip(_get_values(trials, "muscle_ratio"), _get_values(trials, "force_n"), strict=True))
        axis.plot(*np.transpose(points), marker="o", markersize=3, color=colours[bar], label=f"{bar:g} bar")
    axis.axhline(0.0, color=ZERO_LINE_COLOUR, linewidth=0.6)
    _set_labels(axis, "muscle length / resting length", "force [N]", "isometric force")
    return figure, axis


def _plot_isokinetic(result: BenchResult, create_figure: CreateFigure) -> Plot:
    figure = create_figure(5.0)
    absolute, normalised = figure.subplots(1, 2)
    key = "muscle_ratio" if "muscle_ratio" in result.trials[0].conditions else "unit_length_mm"
    length_label = "muscle at {:g} of rest" if key == "muscle_ratio" else "unit at {:g} mm"
    has_muscle = result.device.spec.muscle is not None
    length_unit = 1e3 * result.device.parameters.muscle.resting_length if has_muscle else 1.0
    speed_unit = "resting lengths / s" if has_muscle else "mm/s"
    groups = _group_trials(result.trials, "pressure_bar", key)
    colours, lengths = _get_pressure_colours(result.trials), sorted({length for _, length in groups})
    for k, ((bar, length), trials) in enumerate(groups.items()):
        velocity, force = np.array(_get_values(trials, "velocity_mm_per_s")), np.array(_get_values(trials, "force_n"))
        style: Any = {
            "marker": "o",
            "markersize": 3,
            "color": colours[bar],
            "linestyle": LINE_STYLES[lengths.index(length) % len(LINE_STYLES)],
            "label": f"{bar:g} bar, {length_label.format(length)}",
        }
        absolute.plot(velocity, force, **style)
        # Concentric rings keep coinciding curves visible.
        ring: Any = {"markersize": 3.0 + 9.0 * (1.0 - (k + 1) / len(groups)), "markerfacecolor": "none"}
        normalised.plot(
            velocity / length_unit, _get_values(trials, "force_ratio"), **{**style, **ring, "linewidth": 1.0}
        )
    _set_labels(absolute, "shortening velocity of the unit [mm/s]", "force [N]", "force-velocity")
    _set_labels(
        normalised,
        f"shortening velocity [{speed_unit}]",
        "force / isometric force at that length",
        "normalised",
    )
    for axis in (absolute, normalised):
        axis.axvline(0.0, color=ZERO_LINE_COLOUR, linewidth=0.6)
        low, high = axis.get_ylim()
        axis.set_ylim(min(0.0, low), high + 0.05 * max(high, 0.0))  # keeps the markers inside
    return figure, absolute


def _plot_quick_release(result: BenchResult, create_figure: CreateFigure) -> Plot:
    groups = _group_trials(result.trials, "pressure_bar")
    figure = create_figure(0.4 + 3.4 * len(groups))
    axes = figure.subplots(len(groups), 2, squeeze=False)
    for (traces, forces), ((bar,), trials) in zip(axes, groups.items(), strict=True):
        colours = get_ordered_colours({trial.conditions["release_mm"] for trial in trials})
        for trial in trials:
            time = 1e3 * (trial.recording["time"] - _find_motion_interval(trial)[0])
            is_shown = (time >= -20.0) & (time <= 200.0)
            label = f"release {trial.conditions['release_mm']:.3g} mm"
            traces.plot(
                time[is_shown],
                trial.recording["force"][is_shown],
                color=colours[trial.conditions["release_mm"]],
                label=label,
            )
        _set_labels(traces, "time since the start of the release [ms]", "force [N]", f"{bar:g} bar")
        add_legend(traces, max_columns=3)
        release, before = _get_values(trials, "release_mm"), trials[0].metrics["force_before_n"]
        for key, label in (("force_lowest_n", "lowest"), ("force_after_n", "recovered")):
            forces.plot([0, *release], [1.0, *np.array(_get_values(trials, key)) / before], marker="o", label=label)
        _set_labels(forces, "release [mm]", "force / force before the release", f"{bar:g} bar")
        add_legend(forces)
    return figure, None


def _find_motion_interval(trial: BenchTrial) -> tuple[float, float]:
    """Return the times [s] of the first and last change of the length command."""
    moving = np.flatnonzero(np.diff(trial.recording["length_command"]))
    time = trial.recording["time"]
    return float(time[moving[0]]), float(time[moving[-1] + 1])


def _plot_step_test(result: BenchResult, create_figure: CreateFigure) -> Plot:
    figure = create_figure(7.0)
    pressure, force = figure.subplots(2, 1, sharex=True)
    colours = _get_pressure_colours(result.trials)
    for trial in result.trials:
        time, colour = trial.recording["time"], colours[trial.conditions["pressure_bar"]]
        label = f"{trial.conditions['pressure_bar']:g} bar"
        pressure.plot(time, trial.recording["pressure"], color=colour, label=label)
        pressure.plot(time, trial.recording["pressure_command"], color="0.3", linestyle="--", linewidth=0.6)
        force.plot(time, trial.recording["force"], color=colour, label=label)
    _set_labels(pressure, "", "gauge pressure [bar]", "delivered, and commanded (dashed)")
    _set_labels(force, "time [s]", "force [N]")
    return figure, pressure


def _plot_identification(result: BenchResult, create_figure: CreateFigure) -> Plot:
    figure = create_figure(9.0)
    length, pressure, force = figure.subplots(3, 1, sharex=True)
    for k, trial in enumerate(result.trials):
        time = trial.recording["time"]
        length.plot(time, trial.recording["length"], color=get_series_colour(k), label=trial.name)
        pressure.plot(time, trial.recording["pressure"], color=get_series_colour(k))
        pressure.plot(time, trial.recording["pressure_command"], color="0.3", linestyle="--", linewidth=0.6)
        force.plot(time, trial.recording["force"], color=get_series_colour(k))
    _set_labels(length, "", "unit length [mm]")
    _set_labels(pressure, "", "gauge pressure [bar]", "delivered, and commanded (dashed)")
    _set_labels(force, "time [s]", "force [N]")
    return figure, length


def _plot_frequency_response(result: BenchResult, create_figure: CreateFigure) -> Plot:
    figure = create_figure(7.0)
    axes = figure.subplots(2, 2, sharex=True)
    colours = _get_pressure_colours(result.trials)
    for (bar,), trials in _group_trials(result.trials, "pressure_bar").items():
        frequency = _get_values(trials, "frequency_hz")
        for column, (channel, unit) in enumerate((("pressure", ""), ("force", "_n_per_bar"))):
            style: Any = {"marker": "o", "markersize": 3, "color": colours[bar], "label": f"around {bar:g} bar"}
            gain = np.array(_get_values(trials, f"{channel}_gain{unit}"))
            reference_gain = 1.0 if channel == "pressure" else gain[0]
            if channel == "force":
                style["label"] += f": 0 dB is {reference_gain:.4g} N/bar"
            axes[0, column].semilogx(frequency, 20.0 * np.log10(gain / reference_gain), **style)
            axes[1, column].semilogx(frequency, _unwrap_degrees(_get_values(trials, f"{channel}_phase_deg")), **style)
    amplitude = result.trials[0].conditions["amplitude_bar"]
    _set_labels(axes[0, 0], "", "gain [dB]", f"pressure, command ±{amplitude:g} bar")
    _set_labels(axes[0, 1], "", "gain [dB re lowest frequency]", f"force, command ±{amplitude:g} bar")
    for axis in axes[1]:
        _set_labels(axis, "frequency [Hz]", "phase [deg] (negative: lag)")
    for axis in axes[0]:
        axis.set_ylim(min(-3.0, axis.get_ylim()[0]), max(1.0, axis.get_ylim()[1]))
        add_legend(axis, max_columns=1)
    return figure, None


def _unwrap_degrees(degrees: list[float]) -> Any:
    return np.degrees(np.unwrap(np.radians(degrees)))


def _plot_creep(result: BenchResult, create_figure: CreateFigure) -> Plot:
    figure = create_figure(5.0, 7.0)
    axis = figure.subplots()
    colours = _get_pressure_colours(result.trials)
    for trial in result.trials:
        time = trial.recording["time"] - _find_motion_interval(trial)[1]
        is_shown, slope = time > 0.05, trial.metrics["creep_pct_per_decade"]
        bar = trial.conditions["pressure_bar"]
        label = f"{bar:g} bar: {slope:.2g} % per decade"
        axis.semilogx(time[is_shown], trial.recording["force"][is_shown], color=colours[bar], label=label)
    axis.set_ylim(bottom=0.0)
    _set_labels(axis, "time since the length step [s]", "force [N]", "force after a length step")
    return figure, axis


def _plot_work_loops(result: BenchResult, create_figure: CreateFigure) -> Plot:
    protocol: Any = result.protocol
    by_phase = _group_trials(result.trials, "phase_pct")
    if len(by_phase) > 2:
        return _plot_phase_sweep(result, create_figure)
    panels = [group for trials in by_phase.values() for group in _group_trials(trials, "velocity_mm_per_s").values()]
    columns = min(MAX_LOOP_COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = create_figure(0.4 + 5.2 * rows)
    axes = figure.subplots(2 * rows, columns, squeeze=False, sharey="row")
    colours = _get_pressure_colours(result.trials)
    for number, group in enumerate(panels):
        row, column = divmod(number, columns)
        loop, pressure = axes[2 * row, column], axes[2 * row + 1, column]
        for trial in group:
            bar, work = trial.conditions["pressure_bar"], trial.metrics["work_j"]
            _plot_last_cycle(loop, pressure, trial, protocol, colours[bar], f"{bar:g} bar: {work:+.3g} J")
        name, velocity = group[0].name.split("_")[0], group[0].conditions["velocity_mm_per_s"]
        _set_labels(loop, "unit length [mm]", "force [N]" if column == 0 else "", f"{name}, {velocity:g} mm/s")
        _set_labels(pressure, "cycle [%]", "gauge pressure [bar]" if column == 0 else "")
        add_legend(loop, max_columns=2)
    for unused in range(len(panels), rows * columns):
        for axis in axes[2 * (unused // columns) : 2 * (unused // columns) + 2, unused % columns]:
            axis.set_axis_off()
    return figure, None


def _plot_last_cycle(loop: Axes, pressure: Axes, trial: BenchTrial, protocol: Any, colour: str, label: str) -> None:
    """Plot force over length, and pressure over the cycle, for the last cycle of ``trial``."""
    time = trial.recording["time"]
    period = (time[-1] - protocol.rest_s) / protocol.cycles
    last = trial.recording.select(time >= time[-1] - period - 1e-9)
    loop.plot(last["length"], last["force"], color=colour, linewidth=1.0, label=label)
    loop.xaxis.set_major_locator(MaxNLocator(5))
    _add_direction_arrows(loop, last["length"], last["force"], colour)
    cycle_pct = 100.0 * (last["time"] - last["time"][0]) / period
    pressure.plot(cycle_pct, last["pressure"], color=colour, linewidth=1.0)


def _add_direction_arrows(loop: Axes, length: Array, force: Array, colour: str) -> None:
    """Mark the direction of a work loop with one arrow halfway along shortening and one halfway along lengthening."""
    middle, turn = 0.5 * (length.min() + length.max()), int(length.argmin())
    for branch in (slice(0, turn + 1), slice(turn, len(length))):
        tip = int(np.argmin(np.abs(length[branch] - middle))) + branch.start
        tail = max(tip - max(1, len(length) // 50), 0)
        head: Any = {
            "arrowstyle": "-|>",
            "color": colour,
            "mutation_scale": DIRECTION_ARROW_SIZE,
            "shrinkA": 0,
            "shrinkB": 0,
            "linewidth": 0,
        }
        loop.annotate("", (length[tip], force[tip]), (length[tail], force[tail]), arrowprops=head)


def _plot_phase_sweep(result: BenchResult, create_figure: CreateFigure) -> Plot:
    """Plot net work over the phase of activation, and the loops of the first velocity and pressure."""
    figure = create_figure(7.5)
    (work, loop), (pressure, empty) = figure.subplots(2, 2)
    empty.set_axis_off()
    groups = _group_trials(result.trials, "velocity_mm_per_s", "pressure_bar")
    colours, velocities = _get_pressure_colours(result.trials), sorted({velocity for velocity, _ in groups})
    for (velocity, bar), trials in groups.items():
        style = LINE_STYLES[velocities.index(velocity) % len(LINE_STYLES)]
        label = f"{velocity:g} mm/s, {bar:g} bar"
        points = sorted(zip(_get_values(trials, "phase_pct"), _get_values(trials, "work_j"), strict=True))
        work.plot(*np.transpose(points), style, marker="o", markersize=3, color=colours[bar], label=label)
    (velocity, bar), trials = next(iter(groups.items()))
    phase_colours = get_ordered_colours({trial.conditions["phase_pct"] for trial in trials})
    for trial in trials:
        phase = trial.conditions["phase_pct"]
        _plot_last_cycle(loop, pressure, trial, result.protocol, phase_colours[phase], f"onset at {phase:g} %")
    work.axhline(0.0, color=ZERO_LINE_COLOUR, linewidth=0.6)
    _set_labels(work, "phase of pressure onset [% of the cycle]", "net work per cycle [J]", "net work, output positive")
    _set_labels(loop, "unit length [mm]", "force [N]", f"loops at {velocity:g} mm/s, {bar:g} bar, by phase")
    _set_labels(pressure, "cycle [%]", "gauge pressure [bar]", "pressure, by phase")
    empty.legend(*loop.get_legend_handles_labels(), title="phase of onset", loc="center", ncols=2)
    add_legend(work, max_columns=2)
    return figure, None


_PLOTTERS: dict[str, Callable[[BenchResult, CreateFigure], Plot]] = {
    "isometric": _plot_isometric,
    "isokinetic": _plot_isokinetic,
    "quick-release": _plot_quick_release,
    "step": _plot_step_test,
    "frequency": _plot_frequency_response,
    "creep": _plot_creep,
    "workloop": _plot_work_loops,
    "identification": _plot_identification,
}
