"""Chapter 8: work loops with activation while shortening or while lengthening."""

import numpy as np

from klute_sim.bench.protocols import library as protocols_library
from klute_sim.bench.protocols.workloop import WorkLoopProtocol
from klute_sim.bench.run import BenchResult, BenchTrial, run_protocol
from klute_sim.device.device import Device
from klute_sim.reproduction.curves import ChapterResult, FigureData, LineStyle, PlotLine
from klute_sim.reproduction.item import Outcome
from klute_sim.types import ProgressCallback

ACTIVATION_TABLES = {"concentric": ("table-8.1", "8.5", "8.6"), "eccentric": ("table-8.2", "8.7", "8.8")}
"""Identifier of the table, and numbers of the figures of loops and of work, by activation."""
PHASE_ACTIVATIONS = {0.0: "concentric", 50.0: "eccentric"}
"""Activation by the phase of the cycle [%] at which the pressure rises."""
PLOTTED_VELOCITY = 100.0
"""Velocity [mm/s] of the plotted loops; the highest pressure is plotted at all velocities."""
LINE_STYLES: dict[float, LineStyle] = {1.0: "dotted", 50.0: "dashdot", PLOTTED_VELOCITY: "line", 200.0: "dashed"}
"""Velocity [mm/s] -> style of its loop; the colour is that of the pressure."""


def compute(device: Device, progress: ProgressCallback = lambda fraction, stage: None) -> ChapterResult:
    """Return the findings and figures of chapter 8; ``progress`` receives the completed fraction."""
    protocol = protocols_library.load_protocol("workloop")
    assert isinstance(protocol, WorkLoopProtocol)
    result = run_protocol(device, protocol, progress=progress)
    trials_by_activation: dict[str, dict[tuple[float, float], BenchTrial]] = {name: {} for name in ACTIVATION_TABLES}
    for trial in result.trials:
        conditions = trial.conditions
        trials_by_activation[PHASE_ACTIVATIONS[conditions["phase_pct"]]][
            conditions["pressure_bar"], conditions["velocity_mm_per_s"]
        ] = trial
    findings: dict[str, Outcome] = {}
    work = {
        name: {condition_key: trial.metrics["work_j"] for condition_key, trial in trials.items()}
        for name, trials in trials_by_activation.items()
    }
    for name, (table_id, _, _) in ACTIVATION_TABLES.items():
        findings |= tabulate_work(table_id, work[name])
    min_difference = min(
        work["concentric"][condition_key] - work["eccentric"][condition_key] for condition_key in work["concentric"]
    )
    findings["timing.timing"] = Outcome(
        min_difference,
        min_difference > 0.0,
        f"While shortening {min(work['concentric'].values()):+.1f} to {max(work['concentric'].values()):+.1f} J, while "
        f"lengthening {min(work['eccentric'].values()):+.1f} to {max(work['eccentric'].values()):+.1f} J.",
    )
    findings["figs-8.1-8.4.square"] = _check_square_wave(result)
    figures = []
    for name, (_, loop_number, work_number) in ACTIVATION_TABLES.items():
        figures += [
            _build_loop_figure(loop_number, name, trials_by_activation[name], protocol.rest_s, protocol.cycles),
            _build_work_figure(work_number, name, work[name]),
        ]
    return ChapterResult(findings, tuple(figures))


def tabulate_work(table_id: str, work: dict[tuple[float, float], float]) -> dict[str, Outcome]:
    """Return the findings on a table of net work [J] over pressure [bar] and velocity [mm/s]."""
    findings: dict[str, Outcome] = {}
    pressures, velocities = (sorted({condition_key[k] for condition_key in work}) for k in (0, 1))
    for (pressure, velocity), net_work in work.items():
        findings[f"{table_id}.p{pressure:g}-v{velocity:g}"] = Outcome(net_work)
    work_magnitude = np.abs([[work[p, v] for p in pressures] for v in velocities])
    increase = np.diff(work_magnitude, axis=1) / np.diff(pressures)
    findings[f"{table_id}.grows"] = Outcome(float(increase.min()), bool((increase > 0.0).all()))
    work_at_5_bar = work_magnitude[:, -1]
    ratio = float(work_at_5_bar.max() / work_at_5_bar.min())
    work_text = ", ".join(f"{work[5.0, v]:+.1f} J at {v:g} mm/s" for v in velocities)
    findings[f"{table_id}.velocity"] = Outcome(ratio, True, f"{work_text}.")
    return findings


def _check_square_wave(result: BenchResult) -> Outcome:
    """Return the fraction of time [%] in which the crosshead changes its speed."""
    transition_time, total_time = 0.0, 0.0
    for trial in result.trials:
        time, length = trial.recording["time"], trial.recording["length_command"]
        speed = np.abs(np.diff(length) / np.diff(time))
        set_speed = trial.conditions["velocity_mm_per_s"]
        is_transition = (np.abs(speed - set_speed) > 0.02 * set_speed) & (speed > 0.02 * set_speed)
        transition_time += float(np.diff(time)[is_transition].sum())
        total_time += float(time[-1] - time[0])
    percent = 100.0 * transition_time / total_time
    return Outcome(percent, True)


def _build_loop_figure(
    number: str, activation: str, trials: dict[tuple[float, float], BenchTrial], rest_s: float, n_cycles: int
) -> FigureData:
    lines = []
    for (pressure, velocity), trial in sorted(trials.items()):
        if velocity == PLOTTED_VELOCITY or pressure == max(trials)[0]:
            time, length, force = (trial.recording[c] for c in ("time", "length", "force"))
            # A loop that is drawn further than once closes the gaps of its dashes.
            is_last_cycle = time >= time[-1] - (time[-1] - time[0] - rest_s) / n_cycles
            style = LINE_STYLES[velocity]
            label = f"{pressure:g} bar" if velocity == PLOTTED_VELOCITY else f"{pressure:g} bar, {velocity:g} mm/s"
            loop = length[is_last_cycle], force[is_last_cycle]
            lines.append(PlotLine(label, *loop, style, ordered_value=pressure))
    return FigureData(
        number,
        f"work loops, {activation} activation, {PLOTTED_VELOCITY:g} mm/s unless labelled",
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
        tuple(
            PlotLine(f"{v:g} mm/s", pressures, np.array([work[p, v] for p in pressures]), ordered_value=v)
            for v in velocities
        ),
        assumption_note="stroke, dwell at the ends, damper and tendon",
    )
