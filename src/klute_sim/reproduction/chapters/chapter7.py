"""Chapter 7: force-velocity curves of the muscle-tendon unit at three lengths."""

from typing import NamedTuple

import numpy as np

from klute_sim.bench.protocols import library as protocols_library
from klute_sim.bench.run import BenchResult, run_protocol
from klute_sim.device.device import Device
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.reproduction.curves import ChapterResult, FigureData, PlotLine
from klute_sim.reproduction.item import Outcome
from klute_sim.types import Array, ProgressCallback
from klute_sim.units import BAR

UNIT_LENGTHS = (0.31, 0.33, 0.35)
"""Lengths of the unit [m] (Fig. 7.6)."""
PRESSURES_BAR = (2.0, 3.0, 4.0, 5.0)
"""Gauge pressures of the curves [bar]."""
REFERENCE_UNIT_LENGTH = 0.33
"""Unit length of Figs. 7.1 and 7.4 [m] (assumed: the middle one)."""


def compute(device: Device, progress: ProgressCallback = lambda fraction, stage: None) -> ChapterResult:
    """Return the findings and figures of chapter 7.

    ``progress`` receives the completed fraction. Raises InputError when ``device`` has no tendon or cannot take the
    lengths.
    """
    parameters = device.parameters
    if parameters.tendon.is_rigid:
        raise InputError(f"device '{device.name}' has no tendon, which chapter 7 is about")
    findings: dict[str, Outcome] = {}
    ratios = [
        compute_equilibrium_state(parameters, length, 5.0 * BAR).length / parameters.muscle.resting_length
        for length in UNIT_LENGTHS
    ]
    protocol = protocols_library.load_protocol("isokinetic-unit")
    by_length = run_protocol(device, protocol, progress=lambda fraction, stage: progress(0.45 * fraction, stage))
    curves = {length: _select_curve(by_length, "unit_length_mm", 1e3 * length) for length in UNIT_LENGTHS}
    pressure_protocol = protocol.model_copy(
        update={"pressures_bar": list(PRESSURES_BAR), "unit_lengths_mm": [1e3 * REFERENCE_UNIT_LENGTH]}
    )
    by_pressure = run_protocol(
        device, pressure_protocol, progress=lambda fraction, stage: progress(0.45 + 0.55 * fraction, stage)
    )
    pressure_curves = {pressure: _select_curve(by_pressure, "pressure_bar", pressure) for pressure in PRESSURES_BAR}

    isometric_forces = [curve.isometric_force for curve in curves.values()]
    lock_ratio = mckibben.lock_length(parameters.muscle) / parameters.muscle.resting_length
    ratio_text = ", ".join(
        f"{1e3 * length:.0f} mm: {ratio:.3f}" for length, ratio in zip(UNIT_LENGTHS, ratios, strict=True)
    )
    lengths_are_feasible = lock_ratio < min(ratios) and max(ratios) <= 1.0 and min(isometric_forces) > 0.0
    findings["fig-7.6.lengths"] = Outcome(
        min(ratios), lengths_are_feasible, f"Muscle length over resting length at 5 bar: {ratio_text}."
    )
    for length, curve in curves.items():
        for speed in (300, 0, -150):
            name = f"fig-7.6.force-{1e3 * length:.0f}-{speed}".replace("--", "-minus-")
            findings[name] = Outcome(float(curve.force[curve.velocity == speed][0]))
    for pressure, curve in pressure_curves.items():
        findings[f"fig-7.1.force-{pressure:g}"] = Outcome(curve.isometric_force)
    findings |= evaluate_claims(list(curves.values()), list(pressure_curves.values()))
    x, y = "velocity, shortening positive [mm/s]", "force [N]"
    lengths = tuple(
        PlotLine(f"{1e3 * length:.0f} mm", c.velocity, c.force, ordered_value=length) for length, c in curves.items()
    )
    pressures = tuple(
        PlotLine(f"{pressure:g} bar", c.velocity, c.force, ordered_value=pressure)
        for pressure, c in pressure_curves.items()
    )
    assumed = "damper, tendon, velocities"
    pressure_figure = FigureData(
        "7.1",
        f"{device.name} at {1e3 * REFERENCE_UNIT_LENGTH:.0f} mm",
        x,
        y,
        pressures,
        assumption_note=f"{assumed}, length",
    )
    length_figure = FigureData("7.6", f"{device.name} at 5 bar", x, y, lengths, assumption_note=assumed)
    return ChapterResult(findings, (pressure_figure, length_figure))


class VelocityCurve(NamedTuple):
    """Force over velocity."""

    velocity: Array
    """Velocity [mm/s], positive while shortening, increasing and including 0."""
    force: Array
    """Force [N]."""

    @property
    def isometric_force(self) -> float:
        """Return the force at rest [N]."""
        return float(self.force[self.velocity == 0.0][0])

    @property
    def shortening_force(self) -> Array:
        """Return the force from rest to the fastest shortening [N]."""
        return self.force[self.velocity >= 0.0]

    @property
    def lengthening_force(self) -> Array:
        """Return the force from the fastest lengthening to rest [N]."""
        return self.force[self.velocity <= 0.0]


def _select_curve(result: BenchResult, key: str, value: float) -> VelocityCurve:
    """Return the trials of ``result`` in which setting ``key`` is ``value``, including the isometric force."""
    trials = [trial for trial in result.trials if abs(trial.conditions[key] - value) < 1e-6]
    points = {trial.conditions["velocity_mm_per_s"]: trial.metrics["force_n"] for trial in trials}
    points[0.0] = trials[0].metrics["isometric_force_n"]
    return VelocityCurve(np.array(sorted(points)), np.array([points[v] for v in sorted(points)]))


def evaluate_claims(length_curves: list[VelocityCurve], pressure_curves: list[VelocityCurve]) -> dict[str, Outcome]:
    """Return the findings on Figs. 7.4 and 7.5.

    ``length_curves`` are ordered by length of the unit, ``pressure_curves`` by pressure in steps of 1 bar.
    """
    findings: dict[str, Outcome] = {}
    curves = [*length_curves, *pressure_curves]
    force_increase = np.diff(np.array([curve.force for curve in pressure_curves]), axis=0)
    isometric_increase = np.diff([curve.isometric_force for curve in pressure_curves])
    is_pulling = np.array([curve.force for curve in pressure_curves])[1:] > 0.0
    findings["figs-7.4-7.5.pressure"] = Outcome(
        float(isometric_increase.min()),
        bool((force_increase[is_pulling] > 0.0).all() and (isometric_increase > 0.0).all()),
    )
    max_shortening_ratio = max(float(curve.shortening_force[-1]) / curve.isometric_force for curve in curves)
    is_decreasing = all(((np.diff(c.shortening_force) < 0.0) | (c.shortening_force[1:] == 0.0)).all() for c in curves)
    findings["figs-7.4-7.5.shortening"] = Outcome(
        max_shortening_ratio, is_decreasing, "None is left where the crosshead outruns the unit."
    )
    min_lengthening_ratio = min(float(curve.lengthening_force[0]) / curve.isometric_force for curve in curves)
    is_increasing = all((np.diff(curve.lengthening_force) < 0.0).all() for curve in curves)
    findings["figs-7.4-7.5.lengthening"] = Outcome(min_lengthening_ratio, is_increasing)
    length_increase = np.diff(np.array([curve.force for curve in length_curves]), axis=0)
    min_increase = float(np.diff([curve.isometric_force for curve in length_curves]).min())
    findings["figs-7.4-7.5.length"] = Outcome(min_increase, bool((length_increase > 0.0).all()))
    findings["figs-7.4-7.5.ratio"] = Outcome()
    return findings
