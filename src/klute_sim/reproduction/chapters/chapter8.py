"""Chapter 8: work loops, with pressure while shortening or while lengthening."""

from collections.abc import Callable

import numpy as np

from klute_sim.bench.protocols import library as protocols_library
from klute_sim.bench.run import BenchResult, BenchTrial, run_protocol
from klute_sim.device.device import Device
from klute_sim.reproduction.curves import ChapterResult, FigureData, PlotLine
from klute_sim.reproduction.item import Finding

ACTIVATION_TABLES = {"concentric": ("table-8.1", "8.5", "8.6"), "eccentric": ("table-8.2", "8.7", "8.8")}
"""Activation -> row, number of the figure with loops, and of the one with work."""
PHASE_ACTIVATIONS = {0.0: "concentric", 50.0: "eccentric"}
"""Where in the cycle the pressure comes on [%] -> activation."""
PLOTTED_VELOCITY = 100.0
"""Velocity [mm/s] of the loops that are drawn at every pressure; of the others, the highest is."""


def compute(device: Device, progress: Callable[[float], None] = lambda share: None) -> ChapterResult:
    """Everything of chapter 8, of ``device``."""
    result = run_protocol(device, protocols_library.load_protocol("workloop"), progress=progress)
    by: dict[str, dict[tuple[float, float], BenchTrial]] = {name: {} for name in ACTIVATION_TABLES}
    for trial in result.trials:
        setting = trial.conditions
        by[PHASE_ACTIVATIONS[setting["phase_pct"]]][setting["pressure_bar"], setting["velocity_mm_per_s"]] = trial
    found: dict[str, Finding] = {}
    work = {name: {place: trial.metrics["work_j"] for place, trial in trials.items()} for name, trials in by.items()}
    for name, (row, _, _) in ACTIVATION_TABLES.items():
        _add_table(found, row, work[name])
    least = min(work["concentric"][place] - work["eccentric"][place] for place in work["concentric"])
    found["timing.timing"] = Finding(
        least,
        least > 0.0,
        f"While shortening {min(work['concentric'].values()):+.1f} to {max(work['concentric'].values()):+.1f} J, while "
        f"lengthening {min(work['eccentric'].values()):+.1f} to {max(work['eccentric'].values()):+.1f} J.",
    )
    found["figs-8.1-8.4.square"] = _check_square_wave(result)
    pictures = []
    for name, (_, loops, works) in ACTIVATION_TABLES.items():
        pictures += [_build_loop_figure(loops, name, by[name]), _build_work_figure(works, name, work[name])]
    return ChapterResult(found, tuple(pictures))


def _add_table(findings: dict[str, Finding], row: str, work: dict[tuple[float, float], float]) -> None:
    pressures, velocities = (sorted({place[k] for place in work}) for k in (0, 1))
    for (pressure, velocity), joules in work.items():
        findings[f"{row}.p{pressure:g}-v{velocity:g}"] = Finding(joules)
    size = np.abs([[work[p, v] for p in pressures] for v in velocities])
    rises = np.diff(size, axis=1) / np.diff(pressures)
    findings[f"{row}.grows"] = Finding(float(rises.min()), bool((rises > 0.0).all()))
    at_5 = size[:, -1]
    ratio = float(at_5.max() / at_5.min())
    told = ", ".join(f"{work[5.0, v]:+.1f} J at {v:g} mm/s" for v in velocities)
    findings[f"{row}.velocity"] = Finding(ratio, ratio > 1.05, f"{told}.")


def _check_square_wave(result: BenchResult) -> Finding:
    """Share of the time that the crosshead is on its way from one speed to another."""
    between, whole = 0.0, 0.0
    for trial in result.trials:
        time, length = trial.recording["time"], trial.recording["length_command"]
        speed = np.abs(np.diff(length) / np.diff(time))
        set_speed = trial.conditions["velocity_mm_per_s"]
        other = (np.abs(speed - set_speed) > 0.02 * set_speed) & (speed > 0.02 * set_speed)
        between += float(np.diff(time)[other].sum())
        whole += float(time[-1] - time[0])
    share = 100.0 * between / whole
    return Finding(share, share < 5.0)


def _build_loop_figure(number: str, activation: str, trials: dict[tuple[float, float], BenchTrial]) -> FigureData:
    lines = []
    for (pressure, velocity), trial in sorted(trials.items()):
        if velocity == PLOTTED_VELOCITY or pressure == max(trials)[0]:
            time, length, force = (trial.recording[c] for c in ("time", "length", "force"))
            last = time >= 0.5 * (time[0] + time[-1])
            usual = velocity == PLOTTED_VELOCITY
            label = f"{pressure:g} bar" if usual else f"{pressure:g} bar, {velocity:g} mm/s"
            lines.append(PlotLine(label, length[last], force[last], "line" if usual else "dotted"))
    return FigureData(
        number,
        f"work loops, {activation} activation, {PLOTTED_VELOCITY:g} mm/s where nothing is said",
        "unit length [mm]",
        "force [N]",
        tuple(lines),
        assumption_note="stroke, dwell at the ends, damper and tendon",
    )


def _build_work_figure(number: str, activation: str, work: dict[tuple[float, float], float]) -> FigureData:
    velocities = sorted({velocity for _, velocity in work})
    pressures = np.array(sorted({pressure for pressure, _ in work}))
    return FigureData(
        number,
        f"net work per cycle, {activation} activation",
        "pressure [bar]",
        "net work [J]",
        tuple(PlotLine(f"{v:g} mm/s", pressures, np.array([work[p, v] for p in pressures])) for v in velocities),
        assumption_note="stroke, dwell at the ends, damper and tendon",
    )
