"""Which of the device's equations does not hold: what each would need added, estimated from what was measured.

A disturbance in one equation shows in several channels. Here each equation is evaluated with the *measured* pressure,
force and length put into it, so what it lacks is not passed on to the others. The same is done with what the fitted
device would have shown, and taken off: what smoothing and sampling do to it drops out. No catalogue is asked, but
instruments are believed.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from klute_sim.dataset.trial import Series
from klute_sim.device.step import NO_MEMORY, Parameters, muscle_side, remembers, tendon_side
from klute_sim.diagnose.experiment import Array, Experiment, Setting, trace
from klute_sim.diagnose.fit import Evidence, Fit
from klute_sim.diagnose.noise import measure, misfit
from klute_sim.units import BAR

SMOOTHED = 0.05
"""Time over which lengths are smoothed to take their rate [s]."""
UNITS = {"supply": ("bar", BAR), "muscle and damper": ("N", 1.0), "tendon": ("N", 1.0)}
"""Equation -> unit that what it lacks is shown in, and that unit in SI."""


class Equation(NamedTuple):
    """What an equation lacks."""

    name: str
    lacks: float
    """Root mean square of what every repeat shows to be missing [SI]; 0 if it holds."""
    certainty: float
    """Its square over the square's standard error under noise alone."""
    noise: float
    """Standard deviation between repeats of the same estimate [SI]."""


def equations(evidence: Evidence, base: Fit) -> list[Equation]:
    """The equations that the measured channels can check, by how surely they do not hold.

    The supply needs the pressure measured; muscle and damper, the force; the tendon, force and muscle length. Where
    the muscle's length was not measured, it follows from the force through the tendon, whose law is then believed.
    Empty without repeats: noise cannot be taken off then.
    """
    settings = base.hypothesis.settings(base.steps, evidence.experiments)
    lacking = [_lacking(e, setting.parameters) for e, setting in zip(evidence.experiments, settings, strict=True)]
    residuals = [{name: series.value for name, series in each.items()} for each in lacking]
    experiments = [replace(e, measured=each) for e, each in zip(evidence.experiments, lacking, strict=True)]
    noise = measure(experiments, residuals)
    found = misfit(experiments, residuals, noise)
    rows = [Equation(name, own.size, own.certainty, own.floor) for name, own in found.items()]
    return sorted(rows, key=lambda row: -row.certainty)


def _lacking(experiment: Experiment, parameters: Parameters) -> dict[str, Series]:
    """What each equation needs added for the measured samples, by equation."""
    shown = _shown(experiment, parameters)
    measured = {channel: series.value for channel, series in experiment.measured.items()}
    clock = next(iter(experiment.measured.values())).time
    if not all(np.array_equal(series.time, clock) for series in experiment.measured.values()):
        return {}
    found = {}
    if "pressure" in measured:
        found["supply"] = measured["pressure"] - shown["pressure"]
    if "force" in measured:
        simulated = {channel: shown[channel] for channel in measured}
        sides = [_sides({**shown, **given}, given, parameters) for given in (measured, simulated)]
        for name in sides[0]:
            found[name] = sides[0][name] - sides[1][name]
    return {name: Series(clock, value) for name, value in found.items()}


def _shown(experiment: Experiment, parameters: Parameters) -> dict[str, Array]:
    """Length, and what the device would have shown, at the samples of the first measured channel of ``experiment``."""
    found = trace(Setting(parameters), experiment)
    clock = next(iter(experiment.measured.values())).time
    grid = experiment.begin + experiment.step * np.arange(1, len(found.tension) + 1)
    values = {
        "unit_length": experiment.unit_length,
        "force": found.tension,
        "pressure": found.pressure,
        "muscle_length": found.length,
    }
    return {"time": clock} | {name: np.interp(clock, grid, value) for name, value in values.items()}


def _sides(values: Mapping[str, Array], given: Mapping[str, Array], parameters: Parameters) -> dict[str, Array]:
    """Force [N] that muscle and damper, and the tendon, need besides their laws to be what the load cell shows."""
    force, whole, found = values["force"], values["unit_length"], {}
    tendon = parameters.tendon
    if "muscle_length" in given:
        length = given["muscle_length"]
        if not tendon.rigid:
            own = [tendon_side(parameters, NO_MEMORY, a, b) for a, b in zip(length, whole, strict=True)]
            found["tendon"] = force - np.array(own)
    elif tendon.rigid:
        length = whole - tendon.slack_length
    else:
        length = whole - tendon.slack_length - _stretch(parameters, force)
    if not remembers(parameters):  # what an effect remembers was not measured
        interval = float(np.median(np.diff(values["time"])))
        window = max(5, 2 * round(0.5 * SMOOTHED / interval) + 1)
        if len(length) > window:
            rate = savgol_filter(length, window, 2, deriv=1, delta=interval)
            rows = zip(values["pressure"], length, rate, strict=True)
            found["muscle and damper"] = force - np.array([muscle_side(parameters, NO_MEMORY, *row) for row in rows])
    return found


def _stretch(parameters: Parameters, force: Array) -> Array:
    """Tendon stretch [m] at ``force`` [N]: the law turned round, a line between its points."""
    slack = parameters.tendon.slack_length
    grid = np.linspace(0.0, 0.5 * slack, 2001)
    table = [tendon_side(parameters, NO_MEMORY, 0.0, slack + x) for x in grid]
    return np.interp(force, table, grid)
