"""Residuals of the equations of a walk: those of the device, and the equation of motion of the ankle.

The net moment of tendon, return spring, bumper, damping, weight and ground reaction turns the foot
(:mod:`klute_sim.laws.foot`). Evaluated with the *measured* tension and angle, it does not contain the misfit of muscle,
damper and tendon, and these do not contain that of the ankle
(:mod:`~klute_sim.diagnosis.localization.equation_residuals`). Friction and end stops of the device are contained in the
residuals of measured and simulated channels alike, and cancel in their difference.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from klute_sim.datasets.trial import SensorLimits, TimeSeries
from klute_sim.device.dynamics import DeviceParameters, has_internal_state
from klute_sim.diagnosis.experiments.base import SimulationSetup
from klute_sim.diagnosis.experiments.gait import GaitExperiment
from klute_sim.diagnosis.experiments.registration import Registration
from klute_sim.diagnosis.experiments.simulator import simulate_extrapolated
from klute_sim.diagnosis.localization.device_equations import (
    compute_force_residuals,
    count_smoothed_samples,
    find_unlimited_samples,
)
from klute_sim.diagnosis.noise.repeats import has_sample_near
from klute_sim.gait.replay.rollout import ReplayInputs
from klute_sim.laws import foot as law
from klute_sim.laws.foot import Foot, FootInputs
from klute_sim.types import Array

MAX_GAP_INTERVALS = 1.5
"""Time between two samples, in sampling intervals, above which the series is divided there."""


class WalkSegment(NamedTuple):
    """A part of a walk without gaps, on the clock of the measured ankle angle."""

    measured: Mapping[str, Array]
    """Measured channels [SI]."""
    simulated: Mapping[str, Array]
    """The same channels, simulated [SI]."""
    time: Array
    """Time in the trial [s]."""
    alignment: float
    """Ankle angle that is measured at a neutral hinge [rad], dorsiflexion positive."""
    foot: Foot
    """The foot."""
    inputs: ReplayInputs
    """Prescribed inputs at these times."""

    @property
    def sampling_interval(self) -> float:
        """Time between samples [s]."""
        return float(np.median(np.diff(self.time)))

    def compute_hinge_angle(self, ankle_angle: Array) -> Array:
        """Return the angle of the hinge [rad], plantarflexion positive, for measured or simulated ``ankle_angle``.

        A foot that bends does so in proportion to the moment of the ground reaction; the time that it takes is
        neglected.
        """
        bending = -self.foot.keel_compliance * self.inputs.ground_moment
        return bending - (ankle_angle - self.alignment)

    def compute_unit_length(self, ankle_angle: Array) -> Array:
        """Return the length of the muscle-tendon unit [m]."""
        angles = self.compute_hinge_angle(ankle_angle)
        return np.array([law.unit_length(self.foot, float(angle)) for angle in angles])

    def compute_ankle_residual(self) -> Array:
        """Return the moment [N.m], plantarflexion positive, that the ankle's equation lacks."""
        return self._compute_missing_moment(self.measured) - self._compute_missing_moment(self.simulated)

    def _compute_missing_moment(self, channels: Mapping[str, Array]) -> Array:
        """Return inertia times acceleration of the foot minus all moments but friction and end stops [N.m]."""
        angle, step = self.compute_hinge_angle(channels["ankle_angle"]), self.sampling_interval
        window = count_smoothed_samples(step)
        smooth, velocity, acceleration = (savgol_filter(angle, window, 2, deriv=k, delta=step) for k in range(3))
        foot, inputs = self.foot, self.inputs
        missing = []
        for k, (q, tension) in enumerate(zip(smooth, channels["force"], strict=True)):
            instant = FootInputs(*(float(series[k]) for series in inputs[: len(FootInputs._fields)]))
            moment = (
                tension * law.moment_arm(foot, q)
                - foot.spring_stiffness * (q - foot.spring_rest_angle)
                - foot.ankle_damping * velocity[k]
                + foot.bumper_stiffness * max(0.0, -q - foot.bumper_onset_angle)
                + law.gravity_and_inertia_moment(foot, q, instant)
                + instant.ground_moment
            )
            missing.append(foot.inertia * (instant.shank_angular_acceleration + acceleration[k]) - moment)
        return np.array(missing)


def compute_walk_residual_series(experiment: GaitExperiment, setup: SimulationSetup) -> dict[str, TimeSeries]:
    """Return the residual of each equation at the samples of the ankle angle; empty without this angle."""
    parts = [
        _compute_segment_residuals(segment, experiment.limits, setup.parameters)
        for segment in divide_walk(experiment, setup)
    ]
    return {
        name: TimeSeries(*(np.concatenate([getattr(part[name], key) for part in parts]) for key in TimeSeries._fields))
        for name in (parts[0] if parts else ())
    }


def _compute_segment_residuals(
    segment: WalkSegment, limits: Mapping[str, SensorLimits], parameters: DeviceParameters
) -> dict[str, TimeSeries]:
    residuals, measured = {}, segment.measured
    if "pressure" in measured:
        residuals["supply"] = measured["pressure"] - segment.simulated["pressure"]
    if "force" in measured:
        residuals["ankle"] = segment.compute_ankle_residual()
    if {"force", "pressure"} <= measured.keys() and not has_internal_state(parameters):
        measured_residuals, simulated_residuals = (
            compute_force_residuals(
                {**channels, "time": segment.time, "unit_length": segment.compute_unit_length(channels["ankle_angle"])},
                channels,
                parameters,
            )
            for channels in (measured, segment.simulated)
        )
        for name in measured_residuals:
            residuals[name] = measured_residuals[name] - simulated_residuals[name]
    is_inside = find_unlimited_samples(measured, limits)
    return {name: TimeSeries(segment.time[is_inside], value[is_inside]) for name, value in residuals.items()}


def divide_walk(experiment: GaitExperiment, setup: SimulationSetup) -> Iterator[WalkSegment]:
    """Yield the parts without gaps of ``experiment``, simulated with ``setup``; none without a measured ankle angle.

    Other channels are interpolated to the samples of the ankle angle, except where they have a gap. The motion of the
    limb in its socket is neglected in measured and simulated channels alike.
    """
    if "ankle_angle" not in experiment.measured:
        return
    response = simulate_extrapolated(setup, experiment)
    registration, foot = Registration(*setup.registration), experiment.build_foot(setup)
    inputs = experiment.correct_inputs(registration)
    grid = experiment.start_time + experiment.dt * np.arange(len(experiment.command))
    clock = experiment.measured["ankle_angle"].time
    interval = float(np.median(np.diff(clock)))
    clock = clock[np.all([has_sample_near(series.time, clock) for series in experiment.measured.values()], axis=0)]
    for time in np.split(clock, 1 + np.flatnonzero(np.diff(clock) > MAX_GAP_INTERVALS * interval)):
        if len(time) <= count_smoothed_samples(interval):
            continue
        yield WalkSegment(
            {name: np.interp(time, series.time, series.value) for name, series in experiment.measured.items()},
            {name: np.interp(time, response.time, response.read_channel(name)) for name in experiment.measured},
            time,
            experiment.alignment + registration.ankle_zero,
            foot,
            ReplayInputs(*(np.interp(time, grid, series) for series in inputs)),
        )
