"""Residuals of the device's equations, estimated from measured channels.

A disturbance in one equation shows in several channels. Here, the equations of muscle, damper and tendon are evaluated
with the *measured* pressure, force and length, so that the misfit of one equation is not passed on to the others; the
supply's equation is evaluated with the command. The same is done with channels simulated under the measured pressure,
and the difference removes the influence of smoothing and sampling. The device is that of the final fit without the
added effects, so its own numbers are not biased by them. Instruments are assumed to be correct. The ankle of a walk is
in :mod:`~klute_sim.diagnosis.localization.gait_equations`, joints and devices of a mechanism are in
:mod:`~klute_sim.diagnosis.localization.joint_equations`.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.dynamics import DeviceParameters, has_internal_state
from klute_sim.diagnosis.experiments.base import Experiment, SimulationSetup
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.gait import GaitExperiment
from klute_sim.diagnosis.experiments.mechanism import MechanismExperiment
from klute_sim.diagnosis.experiments.simulator import simulate_extrapolated
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.localization.device_equations import compute_force_residuals, find_unlimited_samples
from klute_sim.diagnosis.localization.gait_equations import compute_walk_residual_series
from klute_sim.diagnosis.localization.joint_equations import (
    compute_mechanism_residual_series,
    list_mechanism_equations,
    name_equation,
)
from klute_sim.diagnosis.noise.misfit import Misfit, estimate_misfit, is_significant
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from klute_sim.effects import catalogue
from klute_sim.laws.pneumatics import SupplyParameters
from klute_sim.types import Array
from klute_sim.units import BAR

INSTANT_PRESSURE_RATE = 1e12
"""Pressure rate [Pa/s] of a regulator that follows every step instantly."""
MIN_SAMPLES = 10
"""Minimum number of samples of a trial."""
NEGLIGIBLE_FRACTION = 0.1
"""Fraction of the largest residual, relative to noise, below which a residual is negligible."""
EQUATION_UNITS = {
    "supply": ("bar", BAR),
    "muscle and damper": ("N", 1.0),
    "muscle, damper or tendon": ("N", 1.0),
    "tendon": ("N", 1.0),
    "ankle": ("N·m", 1.0),
    "hinge joint": ("N·m", 1.0),
    "hinge joint or its devices": ("N·m", 1.0),
    "slide joint": ("N", 1.0),
    "slide joint or its devices": ("N", 1.0),
}
"""Display unit of each kind of equation's residual, and this unit in SI."""


class EquationResidual(NamedTuple):
    """Residual of one equation."""

    kind: str
    """Kind of the equation, a key of :data:`EQUATION_UNITS`."""
    rms: float
    """Root mean square [SI] of the residual that all repeats share; 0 if the equation holds."""
    significance: float
    """Mean square over its standard error under noise alone."""
    noise_std: float
    """Standard deviation [SI] of the residual between repeats."""
    part: str | None = None
    """Joint or device of a mechanism that the equation belongs to; None on the other rigs."""

    @property
    def name(self) -> str:
        """Kind and part of the equation."""
        return name_equation(self.kind, self.part)


def select_significant_equations(equation_residuals: Sequence[EquationResidual]) -> list[EquationResidual]:
    """Return the residuals that are neither noise nor negligible.

    A residual below :data:`NEGLIGIBLE_FRACTION` of the largest (relative to noise) is negligible: a large misfit in one
    equation moves the whole device, and the influence of smoothing on the others is then not removed completely.
    """
    largest = max((r.rms / r.noise_std for r in equation_residuals), default=0.0)
    return [
        r
        for r in equation_residuals
        if is_significant(Misfit(r.rms, r.significance, r.noise_std))
        and r.rms > NEGLIGIBLE_FRACTION * largest * r.noise_std
    ]


def compute_equation_residuals(data: WeightedData, final_fit: Fit) -> list[EquationResidual]:
    """Return the residuals of the equations that the measured channels can check, most significant first.

    The supply needs the pressure; muscle and damper, and the tendon, need force and muscle length. Without a measured
    muscle length, the force gives it through the tendon, and only the three together can be checked. The ankle of a
    walk needs force and ankle angle; the unit length follows from this angle. The list is empty without repeats, and on
    the bench where channels have different clocks. Muscle, damper and tendon are not checked in a device with internal
    states. A mechanism has equations of its joints and devices.
    """
    experiments, hypothesis = data.experiments, final_fit.hypothesis
    base = replace(hypothesis, terms=())
    setups = base.build_setups(final_fit.x[: base.n_prior_parameters], experiments)
    series = [_compute_series(e, setup) for e, setup in zip(experiments, setups, strict=True)]
    residuals = [{name: equation.value for name, equation in trial.items()} for trial in series]
    trials = [replace(e, measured=trial) for e, trial in zip(experiments, series, strict=True)]
    noise = estimate_noise_from_repeats(trials, residuals)
    misfits = estimate_misfit(trials, residuals, noise)
    parts = {
        name: equation
        for e in experiments
        if isinstance(e, MechanismExperiment)
        for name, equation in list_mechanism_equations(e).items()
    }
    equations = []
    for name, misfit in misfits.items():
        kind, part = parts.get(name, (name, None))
        equations.append(EquationResidual(kind, misfit.rms, misfit.significance, misfit.noise_rms, part))
    return sorted(equations, key=lambda equation: -equation.significance)


def _compute_series(experiment: Experiment, setup: SimulationSetup) -> dict[str, TimeSeries]:
    """Return the residual of each equation of ``experiment``, by the name of the equation."""
    if isinstance(experiment, BenchExperiment):
        return _compute_residual_series(experiment, setup.parameters)
    if isinstance(experiment, GaitExperiment):
        return compute_walk_residual_series(experiment, setup)
    return compute_mechanism_residual_series(experiment, setup) if isinstance(experiment, MechanismExperiment) else {}


def _compute_residual_series(experiment: BenchExperiment, parameters: DeviceParameters) -> dict[str, TimeSeries]:
    """Return the residual of each equation at the measured samples."""
    measured = {channel: series.value for channel, series in experiment.measured.items()}
    time = next(iter(experiment.measured.values())).time
    has_common_clock = all(np.array_equal(series.time, time) for series in experiment.measured.values())
    if not has_common_clock or len(time) < MIN_SAMPLES:
        return {}
    residuals, simulated = {}, _simulate_samples(experiment, parameters)
    if "pressure" in measured:
        residuals["supply"] = measured["pressure"] - simulated["pressure"]
        experiment, parameters = _with_measured_pressure(experiment, parameters)
        simulated = _simulate_samples(experiment, parameters)
    if "force" in measured and not has_internal_state(parameters):  # internal states are not measured
        measured_residuals, simulated_residuals = (
            compute_force_residuals({**simulated, **channels}, channels, parameters)
            for channels in (measured, {channel: simulated[channel] for channel in measured})
        )
        for name in measured_residuals:
            residuals[name] = measured_residuals[name] - simulated_residuals[name]
    is_inside = find_unlimited_samples(measured, experiment.limits)
    return {name: TimeSeries(time[is_inside], value[is_inside]) for name, value in residuals.items()}


def _with_measured_pressure(
    experiment: BenchExperiment, parameters: DeviceParameters
) -> tuple[BenchExperiment, DeviceParameters]:
    """Return ``experiment`` with the measured pressure as command, and an ideal supply without effects."""
    series = experiment.measured["pressure"]
    grid = experiment.start_time + experiment.dt * np.arange(1, len(experiment.command) + 1)
    pressure = np.where(grid < series.time[0], experiment.command, np.interp(grid, series.time, series.value))
    supply = SupplyParameters(parameters.supply.max_pressure, INSTANT_PRESSURE_RATE, parameters.supply.temperature)
    effects = catalogue.select_effects(
        parameters.effects, lambda slot: not catalogue.get_effects()[slot.effect].acts_in_supply
    )
    return replace(experiment, command=pressure), parameters._replace(supply=supply, effects=effects)


def _simulate_samples(experiment: BenchExperiment, parameters: DeviceParameters) -> dict[str, Array]:
    """Return time, unit length and simulated channels at the samples of the first measured channel."""
    response = simulate_extrapolated(SimulationSetup(parameters), experiment)
    time = next(iter(experiment.measured.values())).time
    grid = experiment.start_time + experiment.dt * np.arange(1, len(experiment.command) + 1)
    values = {"force": response.tension, "pressure": response.pressure, "muscle_length": response.muscle_length}
    inputs = {"time": time, "unit_length": np.interp(time, grid, experiment.unit_length)}
    return inputs | {name: np.interp(time, response.time, value) for name, value in values.items()}
