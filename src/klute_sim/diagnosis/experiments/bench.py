"""Trials of a tensile tester: the length of the whole muscle-tendon unit is prescribed.

Prescribed channels are interpolated linearly between their samples, which are rid of noise only where that is safe
(:mod:`klute_sim.diagnosis.experiments.denoise`): a smooth curve through a quick release is wrong by more than the noise of its
samples.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from klute_sim.datasets.trial import Trial, Use
from klute_sim.device.dynamics import DEAD_TIME_INDEX, compute_equilibrium_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.experiments.base import (
    COARSE_STEP_FACTOR,
    PRESSURE_PERTURBATION,
    Array,
    DeviceResponse,
    Experiment,
    PrescribedInput,
    SimulationSetup,
    select_samples,
)
from klute_sim.diagnosis.experiments.denoise import denoise

STEPS_PER_SAMPLE = 10
MIN_TIME_STEP, MAX_TIME_STEP = 5e-4, 5e-3
"""Time steps [s]: with a shorter one the error is lost in a load cell's noise; a longer one is not needed."""
LENGTH_PERTURBATION = -1e-4
"""By how much the length is moved to see what its noise does [m]: towards where a bare muscle can go."""

STATIONARY_SPEED = 1e-3
"""Speed [m/s] below which the rig holds still."""


@dataclass(frozen=True, eq=False)
class BenchExperiment(Experiment):
    """A trial of the bench."""

    unit_length: Array = field(kw_only=True)
    """[m], one per step."""

    @cached_property
    def coarse_variant(self) -> Experiment:
        """See :class:`Experiment`."""
        many = min(COARSE_STEP_FACTOR, int(MAX_TIME_STEP / self.dt + 1e-6))
        if many < 2:
            return self
        length, command = self.unit_length[many - 1 :: many], self.command[many - 1 :: many]
        return replace(self, dt=self.dt * many, unit_length=length, command=command)

    @property
    def prescribed_input(self) -> PrescribedInput:
        """See :class:`Experiment`."""
        motions = ("shortening", "still", "lengthening")
        return PrescribedInput("prescribed length [mm]", 1e-3, self.unit_length, STATIONARY_SPEED, motions)

    @property
    def has_body(self) -> bool:
        """See :class:`Experiment`: the device alone is on the bench."""
        return False

    @property
    def informative_channels(self) -> tuple[str, ...]:
        """See :class:`Experiment`."""
        return "force", "muscle_length"

    @property
    def length_range(self) -> float:
        """See :class:`Experiment`."""
        return float(np.ptp(self.unit_length))

    def simulate(self, setup: SimulationSetup) -> DeviceResponse:
        """From rest at its first inputs, after each step.

        Steps are put where a delayed command has its corners: a rate that is limited would begin up to a step early.
        """
        parameters, length, command, step = setup.parameters, self.unit_length, self.command, self.dt
        start = compute_equilibrium_state(parameters, float(length[0]), float(command[0]))
        whole = math.floor(parameters.effects[DEAD_TIME_INDEX] / step + 1e-9)
        shift = max(0.0, parameters.effects[DEAD_TIME_INDEX] - whole * step)
        if shift > 0.0:
            late = (*parameters.effects[:DEAD_TIME_INDEX], whole * step, *parameters.effects[DEAD_TIME_INDEX + 1 :])
            parameters = parameters._replace(effects=late)
            length = length + shift / step * np.diff(length, append=length[-1])
        found = simulate_rollouts(parameters, length, command, step, initial_state=start, n_jobs=1)
        time: Array = self.start_time + shift + step * np.arange(1.0, len(length) + 1.0)
        return DeviceResponse(time, found.tension, found.pressure, found.length)

    def perturb_inputs(self, delay: Callable[[Array], Array]) -> tuple[Experiment, Experiment, Experiment]:
        """See :class:`Experiment`; what else is prescribed is the length."""
        return (
            replace(self, command=self.command + PRESSURE_PERTURBATION),
            replace(self, unit_length=self.unit_length + LENGTH_PERTURBATION),
            replace(self, command=delay(self.command)),
        )

    def compute_covariates(self) -> dict[str, Array]:
        """See :class:`Experiment`."""
        speed = np.gradient(self.unit_length, self.duration / len(self.command))
        rate = np.gradient(self.command, self.duration / len(self.command))
        return {
            "pressure": self.command,
            "length": self.unit_length,
            "speed": self.smooth(speed),
            "pressure change": self.smooth(np.abs(rate)),
            "time": np.linspace(0.0, self.duration, len(self.command)),
        }


def prepare_bench_trial(trial: Trial, use: Use) -> BenchExperiment:
    """``trial`` made ready."""
    length, command = trial.prescribed["length"], trial.prescribed["pressure_command"]
    begin = max(length.time[0], command.time[0])
    end = min(length.time[-1], command.time[-1])
    interval = min(length.sampling_interval, command.sampling_interval)
    step = interval / max(1, round(interval / min(max(interval / STEPS_PER_SAMPLE, MIN_TIME_STEP), MAX_TIME_STEP)))
    grid = begin + step * np.arange(1, int((end - begin) / step + 1e-6) + 1)
    return BenchExperiment(
        name=trial.name,
        group=trial.group,
        use=use,
        device=trial.device,
        start_time=begin,
        dt=step,
        unit_length=np.interp(grid, length.time, denoise(length.time, length.value)),
        command=np.interp(grid, command.time, denoise(command.time, command.value)),
        measured=select_samples(trial, begin, end, grid[-1]),
        trusted=trial.trusted,
    )
