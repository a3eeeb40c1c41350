"""Chapter 7: the musculo-tendon unit, force over velocity at three lengths."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from klute_sim.device.files import Device
from klute_sim.device.step import settled
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.reproduce.item import Found
from klute_sim.reproduce.picture import Array, Chapter, Line, Picture
from klute_sim.rigs.bench import protocols
from klute_sim.rigs.bench.run import Result, run
from klute_sim.units import BAR

LENGTHS = (0.31, 0.33, 0.35)
"""Of the whole unit [m] (Fig. 7.6)."""
PRESSURES = (2.0, 3.0, 4.0, 5.0)
"""[bar]"""
LESS = 0.95
"""Force over isometric force at the fastest shortening, from which on it counts as less (assumed)."""
AT = 0.33
"""Unit length [m] of Figs. 7.1 and 7.4 (assumed: the middle one)."""


def compute(device: Device, told: Callable[[float], None] = lambda share: None) -> Chapter:
    """Everything of chapter 7, of ``device``; raises InputError if it cannot take these lengths."""
    parameters = device.parameters
    if parameters.tendon.rigid:
        raise InputError(f"device '{device.name}' has no tendon, which chapter 7 is about")
    found: dict[str, Found] = {}
    ratios = [settled(parameters, length, 5.0 * BAR).length / parameters.muscle.resting_length for length in LENGTHS]
    protocol = protocols.load("isokinetic-unit")
    by_length = run(device, protocol, told=lambda share: told(0.45 * share))
    curves = {length: _curve(by_length, "unit_length_mm", 1e3 * length) for length in LENGTHS}
    levels = protocol.model_copy(update={"pressures_bar": list(PRESSURES), "unit_lengths_mm": [1e3 * AT]})
    by_pressure = run(device, levels, told=lambda share: told(0.45 + 0.55 * share))
    at = {pressure: _curve(by_pressure, "pressure_bar", pressure) for pressure in PRESSURES}

    still = [curve.isometric for curve in curves.values()]
    lock = mckibben.lock_length(parameters.muscle) / parameters.muscle.resting_length
    told_ratios = ", ".join(
        f"{1e3 * length:.0f} mm: {ratio:.3f}" for length, ratio in zip(LENGTHS, ratios, strict=True)
    )
    takes = lock < min(ratios) and max(ratios) <= 1.0 and min(still) > 0.0
    found["fig-7.6.lengths"] = Found(min(ratios), takes, f"Muscle length over resting length at 5 bar: {told_ratios}.")
    for length, curve in curves.items():
        for speed in (300, 0, -150):
            name = f"fig-7.6.force-{1e3 * length:.0f}-{speed}".replace("--", "-minus-")
            found[name] = Found(float(curve.force[curve.velocity == speed][0]))
    for pressure, curve in at.items():
        found[f"fig-7.1.force-{pressure:g}"] = Found(curve.isometric)
    _claims(found, list(curves.values()), list(at.values()))
    x, y = "velocity, shortening positive [mm/s]", "force [N]"
    lengths = tuple(Line(f"{1e3 * length:.0f} mm", c.velocity, c.force) for length, c in curves.items())
    pressures = tuple(Line(f"{pressure:g} bar", c.velocity, c.force) for pressure, c in at.items())
    assumed = "damper, tendon, velocities"
    one = Picture("7.1", f"{device.name} at {1e3 * AT:.0f} mm", x, y, pressures, assumed=f"{assumed}, length")
    other = Picture("7.6", f"{device.name} at 5 bar", x, y, lengths, assumed=assumed)
    return Chapter(found, (one, other))


class Curve(NamedTuple):
    """Force over velocity."""

    velocity: Array
    """[mm/s], shortening positive, rising, with 0."""
    force: Array
    """[N]"""

    @property
    def isometric(self) -> float:
        """Force at rest [N]."""
        return float(self.force[self.velocity == 0.0][0])

    @property
    def shortening(self) -> Array:
        """Force from rest to the fastest shortening [N]."""
        return self.force[self.velocity >= 0.0]

    @property
    def lengthening(self) -> Array:
        """Force from the fastest lengthening to rest [N]."""
        return self.force[self.velocity <= 0.0]


def _curve(result: Result, key: str, value: float) -> Curve:
    """The trials of ``result`` whose setting ``key`` is ``value``, and the isometric force between them."""
    trials = [trial for trial in result.trials if abs(trial.setting[key] - value) < 1e-6]
    points = {trial.setting["velocity_mm_per_s"]: trial.readings["force_n"] for trial in trials}
    points[0.0] = trials[0].readings["isometric_force_n"]
    return Curve(np.array(sorted(points)), np.array([points[v] for v in sorted(points)]))


def _claims(found: dict[str, Found], lengths: list[Curve], levels: list[Curve]) -> None:
    every = [*lengths, *levels]
    rises = np.diff(np.array([curve.force for curve in levels]), axis=0)
    still = np.diff([curve.isometric for curve in levels])
    left = np.array([curve.force for curve in levels])[1:] > 0.0
    found["figs-7.4-7.5.pressure"] = Found(float(still.min()), bool((rises[left] > 0.0).all() and (still > 0.0).all()))
    falls = max(float(curve.shortening[-1]) / curve.isometric for curve in every)
    falling = falls < LESS and all(((np.diff(c.shortening) < 0.0) | (c.shortening[1:] == 0.0)).all() for c in every)
    found["figs-7.4-7.5.shortening"] = Found(falls, falling, "None is left where the crosshead outruns the unit.")
    climbs = min(float(curve.lengthening[0]) / curve.isometric for curve in every)
    climbing = climbs > 2.0 - LESS and all((np.diff(curve.lengthening) < 0.0).all() for curve in every)
    found["figs-7.4-7.5.lengthening"] = Found(climbs, climbing)
    longer = np.diff(np.array([curve.force for curve in lengths]), axis=0)
    least = float(np.diff([curve.isometric for curve in lengths]).min())
    found["figs-7.4-7.5.length"] = Found(least, bool((longer > 0.0).all()))
    found["figs-7.4-7.5.ratio"] = Found()
