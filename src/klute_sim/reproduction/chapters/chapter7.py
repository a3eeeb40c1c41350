"""Chapter 7: the musculo-tendon unit, force over velocity at three lengths."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from klute_sim.bench.protocols import library as protocols_library
from klute_sim.bench.run import BenchResult, run_protocol
from klute_sim.device.device import Device
from klute_sim.device.dynamics import compute_equilibrium_state
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.reproduction.curves import Array, ChapterResult, FigureData, PlotLine
from klute_sim.reproduction.item import Finding
from klute_sim.units import BAR

UNIT_LENGTHS = (0.31, 0.33, 0.35)
"""Of the whole unit [m] (Fig. 7.6)."""
PRESSURES_BAR = (2.0, 3.0, 4.0, 5.0)
"""[bar]"""
MAX_DECREASED_FORCE_RATIO = 0.95
"""Force over isometric force at the fastest shortening, from which on it counts as less (assumed)."""
REFERENCE_UNIT_LENGTH = 0.33
"""Unit length [m] of Figs. 7.1 and 7.4 (assumed: the middle one)."""


def compute(device: Device, progress: Callable[[float], None] = lambda share: None) -> ChapterResult:
    """Everything of chapter 7, of ``device``; raises InputError if it cannot take these lengths."""
    parameters = device.parameters
    if parameters.tendon.is_rigid:
        raise InputError(f"device '{device.name}' has no tendon, which chapter 7 is about")
    found: dict[str, Finding] = {}
    ratios = [
        compute_equilibrium_state(parameters, length, 5.0 * BAR).length / parameters.muscle.resting_length
        for length in UNIT_LENGTHS
    ]
    protocol = protocols_library.load_protocol("isokinetic-unit")
    by_length = run_protocol(device, protocol, progress=lambda share: progress(0.45 * share))
    curves = {length: _select_curve(by_length, "unit_length_mm", 1e3 * length) for length in UNIT_LENGTHS}
    levels = protocol.model_copy(
        update={"pressures_bar": list(PRESSURES_BAR), "unit_lengths_mm": [1e3 * REFERENCE_UNIT_LENGTH]}
    )
    by_pressure = run_protocol(device, levels, progress=lambda share: progress(0.45 + 0.55 * share))
    at = {pressure: _select_curve(by_pressure, "pressure_bar", pressure) for pressure in PRESSURES_BAR}

    still = [curve.isometric_force for curve in curves.values()]
    lock = mckibben.lock_length(parameters.muscle) / parameters.muscle.resting_length
    told_ratios = ", ".join(
        f"{1e3 * length:.0f} mm: {ratio:.3f}" for length, ratio in zip(UNIT_LENGTHS, ratios, strict=True)
    )
    takes = lock < min(ratios) and max(ratios) <= 1.0 and min(still) > 0.0
    found["fig-7.6.lengths"] = Finding(
        min(ratios), takes, f"Muscle length over resting length at 5 bar: {told_ratios}."
    )
    for length, curve in curves.items():
        for speed in (300, 0, -150):
            name = f"fig-7.6.force-{1e3 * length:.0f}-{speed}".replace("--", "-minus-")
            found[name] = Finding(float(curve.force[curve.velocity == speed][0]))
    for pressure, curve in at.items():
        found[f"fig-7.1.force-{pressure:g}"] = Finding(curve.isometric_force)
    _add_claims(found, list(curves.values()), list(at.values()))
    x, y = "velocity, shortening positive [mm/s]", "force [N]"
    lengths = tuple(PlotLine(f"{1e3 * length:.0f} mm", c.velocity, c.force) for length, c in curves.items())
    pressures = tuple(PlotLine(f"{pressure:g} bar", c.velocity, c.force) for pressure, c in at.items())
    assumed = "damper, tendon, velocities"
    one = FigureData(
        "7.1",
        f"{device.name} at {1e3 * REFERENCE_UNIT_LENGTH:.0f} mm",
        x,
        y,
        pressures,
        assumption_note=f"{assumed}, length",
    )
    other = FigureData("7.6", f"{device.name} at 5 bar", x, y, lengths, assumption_note=assumed)
    return ChapterResult(found, (one, other))


class VelocityCurve(NamedTuple):
    """Force over velocity."""

    velocity: Array
    """[mm/s], shortening positive, rising, with 0."""
    force: Array
    """[N]"""

    @property
    def isometric_force(self) -> float:
        """Force at rest [N]."""
        return float(self.force[self.velocity == 0.0][0])

    @property
    def shortening_force(self) -> Array:
        """Force from rest to the fastest shortening [N]."""
        return self.force[self.velocity >= 0.0]

    @property
    def lengthening_force(self) -> Array:
        """Force from the fastest lengthening to rest [N]."""
        return self.force[self.velocity <= 0.0]


def _select_curve(result: BenchResult, key: str, value: float) -> VelocityCurve:
    """The trials of ``result`` whose setting ``key`` is ``value``, and the isometric force between them."""
    trials = [trial for trial in result.trials if abs(trial.conditions[key] - value) < 1e-6]
    points = {trial.conditions["velocity_mm_per_s"]: trial.metrics["force_n"] for trial in trials}
    points[0.0] = trials[0].metrics["isometric_force_n"]
    return VelocityCurve(np.array(sorted(points)), np.array([points[v] for v in sorted(points)]))


def _add_claims(
    findings: dict[str, Finding], length_curves: list[VelocityCurve], pressure_curves: list[VelocityCurve]
) -> None:
    every = [*length_curves, *pressure_curves]
    rises = np.diff(np.array([curve.force for curve in pressure_curves]), axis=0)
    still = np.diff([curve.isometric_force for curve in pressure_curves])
    left = np.array([curve.force for curve in pressure_curves])[1:] > 0.0
    findings["figs-7.4-7.5.pressure"] = Finding(
        float(still.min()), bool((rises[left] > 0.0).all() and (still > 0.0).all())
    )
    falls = max(float(curve.shortening_force[-1]) / curve.isometric_force for curve in every)
    falling = falls < MAX_DECREASED_FORCE_RATIO and all(
        ((np.diff(c.shortening_force) < 0.0) | (c.shortening_force[1:] == 0.0)).all() for c in every
    )
    findings["figs-7.4-7.5.shortening"] = Finding(falls, falling, "None is left where the crosshead outruns the unit.")
    climbs = min(float(curve.lengthening_force[0]) / curve.isometric_force for curve in every)
    climbing = climbs > 2.0 - MAX_DECREASED_FORCE_RATIO and all(
        (np.diff(curve.lengthening_force) < 0.0).all() for curve in every
    )
    findings["figs-7.4-7.5.lengthening"] = Finding(climbs, climbing)
    longer = np.diff(np.array([curve.force for curve in length_curves]), axis=0)
    least = float(np.diff([curve.isometric_force for curve in length_curves]).min())
    findings["figs-7.4-7.5.length"] = Finding(least, bool((longer > 0.0).all()))
    findings["figs-7.4-7.5.ratio"] = Finding()
