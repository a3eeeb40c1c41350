"""Which of the device's equations lacks something: what each would need added, estimated from what was measured.

A disturbance in one equation shows in several channels. Here the equations of muscle, damper and tendon are evaluated
with the *measured* pressure, force and length put into them, so that what one lacks is not passed on to the others; the
supply's, with the command. The same is done with what the device would have shown under the measured pressure, and
taken off: what smoothing and sampling do drops out. The device is that of the final fit, less the effects that were
found: its own numbers are then not bent to make up for them. Instruments are believed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from klute_sim.datasets.trial import Series
from klute_sim.device.dynamics import (
    ZERO_INTERNAL_STATE,
    DeviceParameters,
    compute_muscle_damper_force,
    compute_tendon_force,
    has_internal_state,
)
from klute_sim.diagnosis.experiments.base import Array, SimulationSetup, simulate_extrapolated
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit, WeightedData
from klute_sim.diagnosis.noise.repeats import Misfit, estimate_misfit, estimate_noise_from_repeats, is_significant
from klute_sim.effects import catalogue
from klute_sim.laws.pneumatics import Supply
from klute_sim.units import BAR

INSTANT_PRESSURE_RATE = 1e12
"""Rate of a regulator [Pa/s] that follows every step."""
SMOOTHING_TIME = 0.05
"""Time over which lengths are smoothed to take their rate [s]."""
EQUATION_UNITS = {
    "supply": ("bar", BAR),
    "muscle and damper": ("N", 1.0),
    "muscle, damper or tendon": ("N", 1.0),
    "tendon": ("N", 1.0),
}
"""Equation -> unit that what it lacks is shown in, and that unit in SI."""


class EquationResidual(NamedTuple):
    """What an equation lacks."""

    name: str
    rms: float
    """Root mean square of what every repeat shows to be missing [SI]; 0 if it holds."""
    z_score: float
    """Its square over the square's standard error under noise alone."""
    noise_std: float
    """Standard deviation between repeats of the same estimate [SI]."""


def select_significant_equations(equation_residuals: Sequence[EquationResidual]) -> list[EquationResidual]:
    """Those of ``found`` whose lack is neither noise nor negligible.

    Less than a tenth of the largest (in units of the noise) is negligible, too: a large lack in one equation moves the
    whole device, and what smoothing does to the others is then not quite what is taken off.
    """
    largest = max((each.rms / each.noise_std for each in equation_residuals), default=0.0)
    return [
        each
        for each in equation_residuals
        if is_significant(Misfit(each.rms, each.z_score, each.noise_std)) and each.rms > 0.1 * largest * each.noise_std
    ]


def compute_equation_residuals(data: WeightedData, final_fit: Fit) -> list[EquationResidual]:
    """The equations that the measured channels can check, by how surely they lack something.

    The supply needs the pressure measured; muscle and damper, force and muscle length, and the tendon likewise. Where
    the muscle's length was not measured, it follows from the force through the tendon, and only the three together
    can be checked. Empty without repeats (noise cannot be taken off then), where channels have clocks of their own,
    and for all but the supply of a device that remembers; and for walks, where the unit's length is not prescribed.
    """
    given = [e for e in data.experiments if isinstance(e, BenchExperiment)]
    plain = Hypothesis(final_fit.hypothesis.device, final_fit.hypothesis.uncertainties, final_fit.hypothesis.noise_std)
    settings = plain.build_setups(final_fit.x[: plain.n_device_parameters], given)
    lacking = [_compute_residual_series(e, setting.parameters) for e, setting in zip(given, settings, strict=True)]
    residuals = [{name: series.value for name, series in each.items()} for each in lacking]
    experiments = [replace(e, measured=each) for e, each in zip(given, lacking, strict=True)]
    noise = estimate_noise_from_repeats(experiments, residuals)
    found = estimate_misfit(experiments, residuals, noise)
    rows = [EquationResidual(name, own.rms, own.significance, own.noise_rms) for name, own in found.items()]
    return sorted(rows, key=lambda row: -row.z_score)


def _compute_residual_series(experiment: BenchExperiment, parameters: DeviceParameters) -> dict[str, Series]:
    """What each equation needs added for the measured samples, by equation."""
    measured = {channel: series.value for channel, series in experiment.measured.items()}
    clock = next(iter(experiment.measured.values())).time
    alike = all(np.array_equal(series.time, clock) for series in experiment.measured.values())
    if not alike or len(clock) < 10:
        return {}
    found, shown, fed = {}, _simulate_samples(experiment, parameters), parameters
    if "pressure" in measured:
        found["supply"] = measured["pressure"] - shown["pressure"]
        under, fed = _with_measured_pressure(experiment, parameters)
        shown = _simulate_samples(under, fed)
    if "force" in measured and not has_internal_state(fed):  # what an effect remembers was not measured
        simulated = {channel: shown[channel] for channel in measured}
        sides = [_compute_force_residuals({**shown, **given}, given, fed) for given in (measured, simulated)]
        for name in sides[0]:
            found[name] = sides[0][name] - sides[1][name]
    return {name: Series(clock, value) for name, value in found.items()}


def _with_measured_pressure(
    experiment: BenchExperiment, parameters: DeviceParameters
) -> tuple[BenchExperiment, DeviceParameters]:
    """``experiment`` with the measured pressure for its command, and a supply without effects that follows at once."""
    series = experiment.measured["pressure"]
    grid = experiment.start_time + experiment.dt * np.arange(1, len(experiment.command) + 1)
    pressure = np.where(grid < series.time[0], experiment.command, np.interp(grid, series.time, series.value))
    supply = Supply(parameters.supply.max_pressure, INSTANT_PRESSURE_RATE, parameters.supply.temperature)
    effects = list(parameters.effects)
    for slot in catalogue.get_device_slots():
        if effects[slot.switch_index] and catalogue.get_effects()[slot.effect].acts_in_supply:
            effects[slot.switch_index] = 0.0
            effects[0] -= 1.0
            effects[slot.switch_index + 1 : slot.switch_index + 1 + len(slot.form.parameters)] = [0.0] * len(
                slot.form.parameters
            )
    return replace(experiment, command=pressure), parameters._replace(supply=supply, effects=tuple(effects))


def _simulate_samples(experiment: BenchExperiment, parameters: DeviceParameters) -> dict[str, Array]:
    """Length, and what the device would have shown, at the samples of the first measured channel of ``experiment``."""
    found = simulate_extrapolated(SimulationSetup(parameters), experiment)
    clock = next(iter(experiment.measured.values())).time
    grid = experiment.start_time + experiment.dt * np.arange(1, len(experiment.command) + 1)
    values = {"force": found.tension, "pressure": found.pressure, "muscle_length": found.length}
    inputs = {"time": clock, "unit_length": np.interp(clock, grid, experiment.unit_length)}
    return inputs | {name: np.interp(clock, found.time, value) for name, value in values.items()}


def _compute_force_residuals(
    values: Mapping[str, Array], channels: Mapping[str, Array], parameters: DeviceParameters
) -> dict[str, Array]:
    """Force [N] that muscle and damper, and the tendon, need besides their laws to be what the load cell shows."""
    force, whole, found, name = values["force"], values["unit_length"], {}, "muscle and damper"
    tendon = parameters.tendon
    if "muscle_length" in channels:
        length = channels["muscle_length"]
        if not tendon.is_rigid:
            own = [
                compute_tendon_force(parameters, ZERO_INTERNAL_STATE, a, b) for a, b in zip(length, whole, strict=True)
            ]
            found["tendon"] = force - np.array(own)
    elif tendon.is_rigid:
        length = whole - tendon.slack_length
    else:
        length, name = (
            whole - tendon.slack_length - _solve_tendon_stretch(parameters, force),
            "muscle, damper or tendon",
        )
    interval = float(np.median(np.diff(values["time"])))
    window = max(5, 2 * round(0.5 * SMOOTHING_TIME / interval) + 1)
    if len(length) > window:
        rate = savgol_filter(length, window, 2, deriv=1, delta=interval)
        rows = zip(values["pressure"], length, rate, strict=True)
        found[name] = force - np.array(
            [compute_muscle_damper_force(parameters, ZERO_INTERNAL_STATE, *row) for row in rows]
        )
    return found


def _solve_tendon_stretch(parameters: DeviceParameters, force: Array) -> Array:
    """Tendon stretch [m] at ``force`` [N]: the law turned round, a line between its points."""
    slack = parameters.tendon.slack_length
    grid = np.linspace(0.0, 0.5 * slack, 2001)
    table = [compute_tendon_force(parameters, ZERO_INTERNAL_STATE, 0.0, slack + x) for x in grid]
    return np.interp(force, table, grid)
