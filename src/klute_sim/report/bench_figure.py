"""The picture of a bench run, per kind of test."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from klute_sim.recording.recording import Samples
from klute_sim.report.figure import STYLE
from klute_sim.rigs.bench.run import Result, Trial

COLOURS = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22", "#17becf")


def draw(result: Result, path: Path) -> None:
    """Write the picture of ``result`` to ``path``."""
    with matplotlib.rc_context(STYLE):
        figure = _KINDS[result.protocol.kind](result)
        where = "MuJoCo tester" if result.mujoco else "device alone"
        figure.suptitle(f"{result.protocol.name}: {result.device.name}, {where}")
        for axis in figure.axes:
            axis.grid(alpha=0.25, linewidth=0.5)
        figure.savefig(path, dpi=130)


def _groups(trials: Iterable[Trial], *keys: str) -> dict[tuple[float, ...], list[Trial]]:
    """Trials by their settings of ``keys``, in their order."""
    found: dict[tuple[float, ...], list[Trial]] = {}
    for trial in trials:
        found.setdefault(tuple(trial.setting[key] for key in keys), []).append(trial)
    return found


def _read(trials: list[Trial], key: str) -> list[float]:
    return [(trial.setting | trial.readings)[key] for trial in trials]


def _label(axis: Axes, across: str, up: str, title: str = "") -> None:
    axis.set_xlabel(across)
    axis.set_ylabel(up)
    axis.set_title(title)


def _legend(axis: Axes) -> None:
    if axis.get_legend_handles_labels()[0]:
        axis.legend(fontsize=7, frameon=False)


def _colour(k: int) -> str:
    return COLOURS[k % len(COLOURS)]


def _isometric(result: Result) -> Figure:
    figure = Figure(figsize=(7, 5), layout="constrained")
    axis = figure.subplots()
    for k, ((bar,), trials) in enumerate(_groups(result.trials, "pressure_bar").items()):
        points = sorted(zip(_read(trials, "muscle_ratio"), _read(trials, "force_n"), strict=True))
        axis.plot(*np.transpose(points), marker="o", markersize=3, color=_colour(k), label=f"{bar:g} bar")
    axis.axhline(0.0, color="0.6", linewidth=0.6)
    _label(axis, "muscle length / resting length", "force [N]", "isometric force")
    _legend(axis)
    return figure


def _isokinetic(result: Result) -> Figure:
    figure = Figure(figsize=(11, 5), layout="constrained")
    plain, normal = figure.subplots(1, 2)
    key = "muscle_ratio" if "muscle_ratio" in result.trials[0].setting else "unit_length_mm"
    at = "muscle at {:g} of rest" if key == "muscle_ratio" else "unit at {:g} mm"
    rest = 1e3 * result.device.parameters.muscle.resting_length
    groups = _groups(result.trials, "pressure_bar", key)
    for k, ((bar, place), trials) in enumerate(groups.items()):
        velocity, force = np.array(_read(trials, "velocity_mm_per_s")), np.array(_read(trials, "force_n"))
        style: Any = {"marker": "o", "markersize": 3, "color": _colour(k), "label": f"{bar:g} bar, {at.format(place)}"}
        plain.plot(velocity, force, **style)
        # Rings inside of rings: curves that lie on each other all show.
        ring: Any = {"markersize": 3.0 + 9.0 * (1.0 - (k + 1) / len(groups)), "markerfacecolor": "none"}
        normal.plot(velocity / rest, _read(trials, "force_ratio"), **{**style, **ring, "linewidth": 1.0})
    _label(plain, "shortening velocity of the unit [mm/s]", "force [N]", "force-velocity")
    _label(
        normal,
        "shortening velocity of the unit [resting lengths of the muscle / s]",
        "force / isometric force at that length",
        "normalised",
    )
    for axis in (plain, normal):
        axis.axvline(0.0, color="0.6", linewidth=0.6)
        low, high = axis.get_ylim()
        axis.set_ylim(min(0.0, low), high + 0.05 * max(high, 0.0))  # clear of the markers
    _legend(plain)
    return figure


def _quick_release(result: Result) -> Figure:
    groups = _groups(result.trials, "pressure_bar")
    figure = Figure(figsize=(11, 4 * len(groups)), layout="constrained")
    axes = figure.subplots(len(groups), 2, squeeze=False)
    for (traces, left), ((bar,), trials) in zip(axes, groups.items(), strict=True):
        for k, trial in enumerate(trials):
            time = 1e3 * (trial.recording["time"] - _moves(trial)[0])
            show = (time >= -20.0) & (time <= 200.0)
            label = f"{trial.setting['release_mm']:.3g} mm"
            traces.plot(time[show], trial.recording["force"][show], color=_colour(k), label=label)
        _label(traces, "time since the release began [ms]", "force [N]", f"{bar:g} bar")
        _legend(traces)
        release, before = _read(trials, "release_mm"), trials[0].readings["force_before_n"]
        for key, label in (("force_lowest_n", "lowest"), ("force_after_n", "come back")):
            left.plot([0, *release], [1.0, *np.array(_read(trials, key)) / before], marker="o", label=label)
        _label(left, "release [mm]", "force / force before", f"{bar:g} bar")
        _legend(left)
    return figure


def _moves(trial: Trial) -> tuple[float, float]:
    """When [s] the crosshead is first and last told to move."""
    moving = np.flatnonzero(np.diff(trial.recording["length_command"]))
    time = trial.recording["time"]
    return float(time[moving[0]]), float(time[moving[-1] + 1])


def _step(result: Result) -> Figure:
    figure = Figure(figsize=(10, 7), layout="constrained")
    pressure, force = figure.subplots(2, 1, sharex=True)
    for k, trial in enumerate(result.trials):
        time, label = trial.recording["time"], f"{trial.setting['pressure_bar']:g} bar"
        pressure.plot(time, trial.recording["pressure"], color=_colour(k), label=label)
        pressure.plot(time, trial.recording["pressure_command"], color="0.3", linestyle="--", linewidth=0.6)
        force.plot(time, trial.recording["force"], color=_colour(k), label=label)
    _label(pressure, "", "gauge pressure [bar]", "delivered, and commanded (dashed)")
    _label(force, "time [s]", "force [N]")
    _legend(pressure)
    return figure


def _frequency(result: Result) -> Figure:
    figure = Figure(figsize=(11, 7), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    for k, ((bar,), trials) in enumerate(_groups(result.trials, "pressure_bar").items()):
        frequency = _read(trials, "frequency_hz")
        for column, (channel, unit) in enumerate((("pressure", ""), ("force", "_n_per_bar"))):
            style: Any = {"marker": "o", "markersize": 3, "color": _colour(k), "label": f"around {bar:g} bar"}
            gain = np.array(_read(trials, f"{channel}_gain{unit}"))
            against = 1.0 if channel == "pressure" else gain[0]
            if channel == "force":
                style["label"] += f": 0 dB is {against:.4g} N/bar"
            axes[0, column].semilogx(frequency, 20.0 * np.log10(gain / against), **style)
            axes[1, column].semilogx(frequency, _unwrapped(_read(trials, f"{channel}_phase_deg")), **style)
    amplitude = result.trials[0].setting["amplitude_bar"]
    _label(axes[0, 0], "", "gain [dB]", f"pressure, command ±{amplitude:g} bar")
    _label(axes[0, 1], "", "gain [dB against the lowest frequency]", f"force, command ±{amplitude:g} bar")
    for axis in axes[1]:
        _label(axis, "frequency [Hz]", "phase [deg] (negative: late)")
    for axis in axes[0]:
        axis.set_ylim(min(-3.0, axis.get_ylim()[0]), max(1.0, axis.get_ylim()[1]))
        _legend(axis)
    return figure


def _unwrapped(degrees: list[float]) -> Any:
    return np.degrees(np.unwrap(np.radians(degrees)))


def _creep(result: Result) -> Figure:
    figure = Figure(figsize=(7, 5), layout="constrained")
    axis = figure.subplots()
    for k, trial in enumerate(result.trials):
        time = trial.recording["time"] - _moves(trial)[1]
        show, slope = time > 0.05, trial.readings["creep_pct_per_decade"]
        label = f"{trial.setting['pressure_bar']:g} bar: {slope:.2g} % per decade"
        axis.semilogx(time[show], trial.recording["force"][show], color=_colour(k), label=label)
    axis.set_ylim(bottom=0.0)
    _label(axis, "time since the length step [s]", "force [N]", "force after a step of the length")
    _legend(axis)
    return figure


def _workloop(result: Result) -> Figure:
    protocol: Any = result.protocol
    by_phase = _groups(result.trials, "phase_pct")
    if len(by_phase) > 2:
        return _phases(result)
    velocities = protocol.velocities_mm_per_s
    figure = Figure(figsize=(3.3 * len(velocities) + 0.5, 5.4 * len(by_phase)), layout="constrained")
    axes = figure.subplots(2 * len(by_phase), len(velocities), squeeze=False, sharey="row")
    for row, trials in enumerate(by_phase.values()):
        for column, ((velocity,), own) in enumerate(_groups(trials, "velocity_mm_per_s").items()):
            loop, pressure = axes[2 * row, column], axes[2 * row + 1, column]
            for k, trial in enumerate(own):
                work = trial.readings["work_j"]
                _cycle(loop, pressure, trial, protocol, k, f"{trial.setting['pressure_bar']:g} bar: {work:+.3g} J")
            name = own[0].name.split("_")[0]
            _label(loop, "unit length [mm]", "force [N]" if column == 0 else "", f"{name}, {velocity:g} mm/s")
            _label(pressure, "cycle [%]", "gauge pressure [bar]" if column == 0 else "")
            low, high = loop.get_ylim()
            loop.set_ylim(low, max(high, 1.45 * max(_read(trials, "force_max_n"))))  # room for the legend
            _legend(loop)
    return figure


def _cycle(loop: Axes, pressure: Axes, trial: Trial, protocol: Any, k: int, label: str) -> None:
    """The last cycle of ``trial``."""
    time = trial.recording["time"]
    period = (time[-1] - protocol.rest_s) / protocol.cycles
    last = trial.recording.select(time >= time[-1] - period - 1e-9)
    loop.plot(last["length"], last["force"], color=_colour(k), linewidth=1.0, label=label)
    loop.xaxis.set_major_locator(MaxNLocator(5))
    _arrows(loop, last["length"], last["force"], _colour(k))
    share = 100.0 * (last["time"] - last["time"][0]) / period
    pressure.plot(share, last["pressure"], color=_colour(k), linewidth=1.0)


def _arrows(loop: Axes, length: Samples, force: Samples, colour: str) -> None:
    """The direction in which a loop is run through: a head halfway along the shortening, and one along the return."""
    middle, turn = 0.5 * (length.min() + length.max()), int(length.argmin())
    for way in (slice(0, turn + 1), slice(turn, len(length))):
        at = int(np.argmin(np.abs(length[way] - middle))) + way.start
        before = max(at - max(1, len(length) // 50), 0)
        head: Any = {
            "arrowstyle": "-|>",
            "color": colour,
            "mutation_scale": 13,
            "shrinkA": 0,
            "shrinkB": 0,
            "linewidth": 0,
        }
        loop.annotate("", (length[at], force[at]), (length[before], force[before]), arrowprops=head)


def _phases(result: Result) -> Figure:
    """Net work over the phase of activation, and the loops of the first setting."""
    figure = Figure(figsize=(11, 7), layout="constrained")
    (work, loop), (pressure, empty) = figure.subplots(2, 2)
    empty.set_axis_off()
    groups = _groups(result.trials, "velocity_mm_per_s", "pressure_bar")
    for k, ((velocity, bar), trials) in enumerate(groups.items()):
        label = f"{velocity:g} mm/s, {bar:g} bar"
        points = sorted(zip(_read(trials, "phase_pct"), _read(trials, "work_j"), strict=True))
        work.plot(*np.transpose(points), marker="o", markersize=3, color=_colour(k), label=label)
    (velocity, bar), trials = next(iter(groups.items()))
    for k, trial in enumerate(trials):
        _cycle(loop, pressure, trial, result.protocol, k, f"{trial.setting['phase_pct']:g} %")
    work.axhline(0.0, color="0.6", linewidth=0.6)
    _label(work, "phase at which the pressure comes on [% of the cycle]", "net work per cycle [J]", "work done")
    _label(loop, "unit length [mm]", "force [N]", f"loops at {velocity:g} mm/s, {bar:g} bar, by phase")
    _label(pressure, "cycle [%]", "gauge pressure [bar]", "pressure, by phase")
    empty.legend(*loop.get_legend_handles_labels(), title="phase", loc="upper left", frameon=False)
    _legend(work)
    return figure


_KINDS: dict[str, Callable[[Result], Figure]] = {
    "isometric": _isometric,
    "isokinetic": _isokinetic,
    "quick-release": _quick_release,
    "step": _step,
    "frequency": _frequency,
    "creep": _creep,
    "workloop": _workloop,
}
