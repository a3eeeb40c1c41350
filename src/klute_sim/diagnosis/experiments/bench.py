"""Bench trials: a tensile tester prescribes the length of the muscle-tendon unit.

Prescribed channels are interpolated linearly between their samples and denoised only where that is safe
(:mod:`klute_sim.diagnosis.experiments.denoise`): a smooth curve through a quick release would have a larger error than
the noise of its samples.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from klute_sim.datasets.trial import Trial, Use
from klute_sim.device.dynamics import DEAD_TIME_INDEX, get_dead_time
from klute_sim.device.equilibrium import compute_equilibrium_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.experiments.base import (
    COARSE_STEP_FACTOR,
    PRESSURE_PERTURBATION,
    DeviceResponse,
    Experiment,
    PrescribedInput,
    SimulationSetup,
    select_samples,
)
from klute_sim.diagnosis.experiments.denoise import denoise
from klute_sim.types import Array

STEPS_PER_SAMPLE = 10
"""Time steps per sample of the prescribed channels, within the limits of the time step."""
MIN_TIME_STEP, MAX_TIME_STEP = 5e-4, 5e-3
"""Limits of the time step [s]. Below, the integration error vanishes in a load cell's noise; above, steps need not be
longer."""
LENGTH_PERTURBATION = -1e-4
"""Change of the prescribed length [m] that measures the sensitivity to length noise; a bare muscle can only shorten."""
STATIONARY_SPEED = 1e-3
"""Speed [m/s] below which the rig counts as stationary."""


@dataclass(frozen=True, eq=False)
class BenchExperiment(Experiment):
    """A trial on the bench."""

    unit_length: Array = field(kw_only=True)
    """Prescribed length of the muscle-tendon unit [m], one value per time step."""

    @cached_property
    def coarse_variant(self) -> Experiment:
        """The same trial with time steps of up to :data:`MAX_TIME_STEP`."""
        factor = min(COARSE_STEP_FACTOR, int(MAX_TIME_STEP / self.dt + 1e-6))
        if factor < 2:
            return self
        length, command = self.unit_length[factor - 1 :: factor], self.command[factor - 1 :: factor]
        return replace(self, dt=self.dt * factor, unit_length=length, command=command)

    @property
    def prescribed_input(self) -> PrescribedInput:
        """Prescribed length of the muscle-tendon unit."""
        directions = ("shortening", "still", "lengthening")
        return PrescribedInput("prescribed length [mm]", 1e-3, self.unit_length, STATIONARY_SPEED, directions)

    @property
    def has_body(self) -> bool:
        """False: the bench tests the device alone."""
        return False

    @property
    def informative_channels(self) -> tuple[str, ...]:
        """Force and muscle length."""
        return "force", "muscle_length"

    @property
    def length_range(self) -> float:
        """Range of the prescribed length [m]."""
        return float(np.ptp(self.unit_length))

    def simulate(self, setup: SimulationSetup) -> DeviceResponse:
        """Simulate from equilibrium at the first inputs; values are those after each time step.

        The time grid is shifted to the corners of a delayed command: otherwise a rate limit would act up to one time
        step early.
        """
        parameters, length, command, dt = setup.parameters, self.unit_length, self.command, self.dt
        initial_state = compute_equilibrium_state(parameters, float(length[0]), float(command[0]))
        dead_time = get_dead_time(parameters)
        n_delay_steps = math.floor(dead_time / dt + 1e-9)
        shift = max(0.0, dead_time - n_delay_steps * dt)
        if shift > 0.0:
            effects = (
                *parameters.effects[:DEAD_TIME_INDEX],
                n_delay_steps * dt - (dead_time - parameters.effects[DEAD_TIME_INDEX]),
                *parameters.effects[DEAD_TIME_INDEX + 1 :],
            )
            parameters = parameters._replace(effects=effects)
            length = length + shift / dt * np.diff(length, append=length[-1])
        rollout = simulate_rollouts(parameters, length, command, dt, initial_state=initial_state, n_jobs=1)
        time: Array = self.start_time + shift + dt * np.arange(1.0, len(length) + 1.0)
        return DeviceResponse(time, rollout.tension, rollout.pressure, rollout.length)

    def perturb_inputs(self, delay: Callable[[Array], Array]) -> tuple[Experiment, Experiment, Experiment]:
        """Perturb the pressure, perturb the length, and delay the command."""
        return (
            replace(self, command=self.command + PRESSURE_PERTURBATION),
            replace(self, unit_length=self.unit_length + LENGTH_PERTURBATION),
            replace(self, command=delay(self.command)),
        )

    def compute_covariates(self) -> dict[str, Array]:
        """Return pressure, length, their rates, and time."""
        speed = np.gradient(self.unit_length, self.duration / len(self.command))
        pressure_rate = np.gradient(self.command, self.duration / len(self.command))
        return {
            "pressure": self.command,
            "length": self.unit_length,
            "speed": self.smooth(speed),
            "pressure change": self.smooth(np.abs(pressure_rate)),
            "time": np.linspace(0.0, self.duration, len(self.command)),
        }


def prepare_bench_trial(trial: Trial, use: Use) -> BenchExperiment:
    """Return the experiment of a bench ``trial``."""
    length, command = trial.prescribed["length"], trial.prescribed["pressure_command"]
    start_time = max(length.time[0], command.time[0])
    end_time = min(length.time[-1], command.time[-1])
    interval = min(length.sampling_interval, command.sampling_interval)
    dt = interval / max(1, round(interval / min(max(interval / STEPS_PER_SAMPLE, MIN_TIME_STEP), MAX_TIME_STEP)))
    time = start_time + dt * np.arange(1, int((end_time - start_time) / dt + 1e-6) + 1)
    return BenchExperiment(
        name=trial.name,
        group=trial.group,
        use=use,
        device=trial.device,
        start_time=start_time,
        dt=dt,
        unit_length=np.interp(time, length.time, denoise(length.time, length.value)),
        command=np.interp(time, command.time, denoise(command.time, command.value)),
        measured=select_samples(trial, start_time, end_time, time[-1]),
        trusted=trial.trusted,
        limits=trial.limits,
    )
