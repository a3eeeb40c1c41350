"""Chapter 7: the musculo-tendon unit, force over velocity at three lengths."""

import numpy as np

from klute_sim.device.files import Device
from klute_sim.device.step import Parameters, settled
from klute_sim.errors import InputError
from klute_sim.laws import mckibben
from klute_sim.reproduce.item import Found
from klute_sim.reproduce.picture import Array, Chapter, Line, Picture
from klute_sim.reproduce.pull import moving
from klute_sim.units import BAR

LENGTHS = (0.31, 0.33, 0.35)
"""Of the whole unit [m] (Fig. 7.6)."""
PRESSURES = (2.0, 3.0, 4.0, 5.0)
"""[bar]"""
SHORTENING = (0.001, 0.01, 0.025, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)
LENGTHENING = (0.001, 0.01, 0.025, 0.05, 0.1, 0.15)
"""[m/s] (assumed: those of chapter 3)."""
TRAVEL = 0.01
"""To either side of where force is read [m] (assumed)."""
AT = 0.33
"""Unit length [m] of Figs. 7.1 and 7.4 (assumed: the middle one)."""


def compute(device: Device) -> Chapter:
    """Everything of chapter 7, of ``device``; raises InputError if it cannot take these lengths."""
    parameters = device.parameters
    shortest = mckibben.lock_length(parameters.muscle) + parameters.tendon.slack_length
    if shortest > min(LENGTHS) - TRAVEL or parameters.tendon.rigid:
        raise InputError(
            f"device '{device.name}' cannot take unit lengths of {1e3 * (min(LENGTHS) - TRAVEL):g} to "
            f"{1e3 * max(LENGTHS):g} mm, which chapter 7 is about"
        )
    velocities = np.array([*(-v for v in reversed(LENGTHENING)), 0.0, *SHORTENING])
    found: dict[str, Found] = {}
    ratios = [settled(parameters, length, 5.0 * BAR).length / parameters.muscle.resting_length for length in LENGTHS]
    still = [moving(parameters, length, TRAVEL, 0.0, 5.0 * BAR) for length in LENGTHS]
    lock = mckibben.lock_length(parameters.muscle) / parameters.muscle.resting_length
    told = ", ".join(f"{1e3 * length:.0f} mm: {ratio:.3f}" for length, ratio in zip(LENGTHS, ratios, strict=True))
    takes = lock < min(ratios) and max(ratios) <= 1.0 and min(still) > 0.0
    found["fig-7.6.lengths"] = Found(min(ratios), takes, f"Muscle length over resting length at 5 bar: {told}.")

    curves = {length: over_velocity(parameters, length, velocities, 5.0) for length in LENGTHS}
    for length, curve in curves.items():
        for speed in (300, 0, -150):
            name = f"fig-7.6.force-{1e3 * length:.0f}-{speed}".replace("--", "-minus-")
            found[name] = Found(float(curve[np.argmin(np.abs(velocities - 1e-3 * speed))]))
    levels = {p: over_velocity(parameters, AT, velocities, p) for p in PRESSURES}
    rest = int(np.flatnonzero(velocities == 0.0)[0])
    isometric = np.array([levels[p][rest] for p in PRESSURES])
    for pressure, force in zip(PRESSURES, isometric, strict=True):
        found[f"fig-7.1.force-{pressure:g}"] = Found(float(force))
    _claims(found, curves, levels, rest)
    picture = Picture(
        "7.6",
        f"{device.name} at 5 bar: force over velocity",
        "velocity, shortening positive [mm/s]",
        "force [N]",
        tuple(Line(f"{1e3 * length:.0f} mm", 1e3 * velocities, curve) for length, curve in curves.items()),
        assumed="damper, tendon, velocities",
    )
    other = Picture(
        "7.1",
        f"{device.name} at {1e3 * AT:.0f} mm: force over velocity",
        "velocity, shortening positive [mm/s]",
        "force [N]",
        tuple(Line(f"{p:g} bar", 1e3 * velocities, curve) for p, curve in levels.items()),
        assumed="damper, tendon, velocities, length",
    )
    return Chapter(found, (other, picture))


def over_velocity(parameters: Parameters, length: float, velocities: Array, pressure: float) -> Array:
    """Force [N] at unit ``length`` [m] over ``velocities`` [m/s], shortening positive, at ``pressure`` [bar]."""
    return np.array([moving(parameters, length, TRAVEL, -float(v), pressure * BAR) for v in velocities])


def _claims(found: dict[str, Found], curves: dict[float, Array], levels: dict[float, Array], rest: int) -> None:
    every = [*curves.values(), *levels.values()]
    rises = np.diff(np.array([levels[p] for p in PRESSURES]), axis=0)
    found["figs-7.4-7.5.pressure"] = Found(
        float(rises[:, rest].min()), bool((rises >= 0.0).all() and (rises[:, rest] > 0.0).all())
    )
    falls = max(float(curve[-1] / curve[rest]) for curve in every)
    found["figs-7.4-7.5.shortening"] = Found(falls, all((np.diff(curve[rest:]) <= 0.0).all() for curve in every))
    climbs = min(float(curve[0] / curve[rest]) for curve in every)
    found["figs-7.4-7.5.lengthening"] = Found(climbs, all((np.diff(curve[: rest + 1]) < 0.0).all() for curve in every))
    longer = np.diff(np.array([curves[length] for length in LENGTHS]), axis=0)
    found["figs-7.4-7.5.length"] = Found(float(longer[:, rest].min()), bool((longer >= 0.0).all()))
    found["figs-7.4-7.5.ratio"] = Found()
