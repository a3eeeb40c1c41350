"""Chapter 3: the McKibben actuators in motion on the bench (Figs. 3.7 to 3.9)."""

import numpy as np

from klute_sim.bench.protocols import library as protocols_library
from klute_sim.bench.run import BenchResult, run_protocol
from klute_sim.device.device import Device, load_device
from klute_sim.laws import hill
from klute_sim.laws import hill_tables as tables
from klute_sim.recording.recording import Recording
from klute_sim.reproduction import printed
from klute_sim.reproduction.curves import ChapterResult, FigureData, PlotLine, PlotSurface
from klute_sim.reproduction.item import Outcome
from klute_sim.types import Array, ProgressCallback

LENGTH_RATIO, PRESSURE_BAR = 0.96, 5.0
"""Muscle length over resting length, and gauge pressure [bar], of Fig. 3.9."""
SLOW_VELOCITY, FAST_VELOCITY = 1.0, 300.0
"""Velocities of the two printed forces [mm/s]."""
PEAK_VELOCITY = 300.0
"""Velocity V0 of the abscissa of Fig. 3.9 [mm/s] (assumed: the fastest test)."""
SURFACE_LENGTH_RATIOS = np.linspace(0.87, 0.99, 13)
"""Length ratios of the surfaces (assumed: the strokes of the source are lost)."""


def compute(progress: ProgressCallback = lambda fraction, stage: None) -> ChapterResult:
    """Return the findings and figures of the actuators in motion; ``progress`` receives the completed fraction."""
    protocol = protocols_library.load_protocol("isokinetic").model_copy(update={"pressures_bar": [PRESSURE_BAR]})
    single_result = run_protocol(
        load_device("klute-3-4"), protocol, progress=lambda fraction, stage: progress(0.5 * fraction, stage)
    )
    # The source lengthened the pair at its shortening speeds.
    both_ways = protocol.model_copy(update={"eccentric_mm_per_s": protocol.model_dump()["concentric_mm_per_s"]})
    pair_result = run_protocol(
        load_pair(), both_ways, progress=lambda fraction, stage: progress(0.5 + 0.5 * fraction, stage)
    )
    force = {t.conditions["velocity_mm_per_s"]: t.metrics["force_n"] for t in single_result.trials}
    findings = {"fig-3.9.slow": Outcome(force[SLOW_VELOCITY]), "fig-3.9.fast": Outcome(force[FAST_VELOCITY])}
    findings["fig-3.9.loss"] = Outcome(round(100.0 * (force[FAST_VELOCITY] / force[SLOW_VELOCITY] - 1.0), 2))
    spread = 100.0 * (max(force.values()) - min(force.values())) / force[SLOW_VELOCITY]
    length_dependence = float(np.ptp(next(iter(_tabulate_force(single_result)[2]))))
    findings["fig-3.7.velocity"] = Outcome(
        spread,
        length_dependence > 1.0,
        f"Over lengths of {SURFACE_LENGTH_RATIOS[0]:g} to {SURFACE_LENGTH_RATIOS[-1]:g} of rest: "
        f"{length_dependence:.0f} N.",
    )
    for row, result in (("fig-3.7", single_result), ("fig-3.8", pair_result)):
        speeds = [trial.conditions["velocity_mm_per_s"] for trial in result.trials]
        findings[f"{row}.concentric"], findings[f"{row}.eccentric"] = (
            Outcome(max(speeds)),
            Outcome(-min(speeds)),
        )
    for speed in (500, 300, 200):
        findings[f"fig-3.7.ripple-{speed}"] = Outcome()
    return ChapterResult(
        findings,
        (
            _build_surface_figure("3.7", single_result),
            _build_surface_figure("3.8", pair_result),
            _build_velocity_figure(force),
        ),
    )


def load_pair() -> Device:
    """Return the two bare 3/4 in actuators of Fig. 3.8."""
    return load_device("klute-3-4").with_changes({"muscle.count": 2, "muscle.resting_length_mm": 250.0}, "Fig. 3.8")


def _tabulate_force(result: BenchResult) -> tuple[Array, Array, Array]:
    """Return length ratios, velocities [mm/s] and the force in motion [N] of shape (velocities, lengths)."""
    rest = 1e3 * result.device.parameters.muscle.resting_length
    trials = sorted(result.trials, key=lambda trial: trial.conditions["velocity_mm_per_s"])
    rows = [_interpolate_force(trial.recording, rest * SURFACE_LENGTH_RATIOS) for trial in trials]
    return SURFACE_LENGTH_RATIOS, np.array([trial.conditions["velocity_mm_per_s"] for trial in trials]), np.array(rows)


def _interpolate_force(recording: Recording, lengths: Array) -> Array:
    """Return the force [N] at which the moving muscle passes ``lengths`` [mm]."""
    length, force = recording["muscle_length"], recording["force"]
    is_moving = np.abs(np.gradient(length)) > 0.5 * np.abs(np.gradient(length)).max()
    order = np.argsort(length[is_moving])
    return np.asarray(np.interp(lengths, length[is_moving][order], force[is_moving][order]))


def _build_surface_figure(number: str, result: BenchResult) -> FigureData:
    lengths, velocities, force = _tabulate_force(result)
    rest = 1e3 * result.device.parameters.muscle.resting_length
    return FigureData(
        number,
        f"{'one 3/4 in actuator' if number == '3.7' else 'two 3/4 in actuators'}, resting length {rest:.0f} mm, 5 bar",
        "λ1 = L/L0",
        "velocity [mm/s]",
        surface=PlotSurface(lengths, velocities, force),
        z_label="force [N]",
        assumption_note="the range of lengths",
    )


def _build_velocity_figure(force: dict[float, float]) -> FigureData:
    relative = np.linspace(-0.5, 1.0, 151)
    velocity = np.array(sorted(force))
    # Relative to the isometric force of the actuator, as for the muscles.
    relative_force = np.array([force[v] for v in velocity]) / force[SLOW_VELOCITY]
    edges = [hill.HillCurve(value, value) for value in hill.DESIGN_ENVELOPE.a]
    curves = [np.array([hill.force_velocity(law, 1.0, float(v)) for v in relative]) for law in edges]
    p = printed.get_published_numbers()
    measured = np.array([p["fig-3.9.slow"], p["fig-3.9.fast"]])
    generic = np.array([hill.force_velocity(tables.GENERIC_HILL_CURVE, 1.0, float(v)) for v in relative])
    return FigureData(
        "3.9",
        "3/4 in at 0.96 of resting length, 5 bar, and the envelope",
        "V/V0",
        "F/F0",
        (
            PlotLine("envelope, a/F0 = 0.12", relative, curves[0], "dashed", 7),
            PlotLine("envelope, a/F0 = 0.41", relative, curves[1], "dotted", 7),
            PlotLine("generic muscle", relative, generic),
            PlotLine("actuator, model", velocity / PEAK_VELOCITY, relative_force),
            PlotLine(
                "actuator, printed",
                np.array([SLOW_VELOCITY, FAST_VELOCITY]) / PEAK_VELOCITY,
                measured / measured[0],
                "points",
            ),
        ),
        (-0.5, 1.0),
        (0.0, 1.4),
        assumption_note="V0 = 300 mm/s",
    )
