"""Trajectories of ``klute_sim/AnkleBench``: prescribed crosshead lengths and target forces."""

from typing import NamedTuple

import numpy as np

from klute_sim.bench.limits import isometric_force
from klute_sim.device.device import Device
from klute_sim.types import Array

MIN_LENGTH_RATIO, MAX_LENGTH_RATIO = 0.88, 0.97
"""Range of muscle length over resting length in which the just taut unit moves."""
MIN_FORCE_FRACTION, MAX_FORCE_FRACTION = 0.1, 0.5
"""Range of the target force over the maximum force, that of the muscle at mid travel and supply pressure."""
N_SINES, MAX_FREQUENCY = 4, 1.5
"""Number of sines of random phase in a random trajectory, and the highest frequency [Hz]; the others are fractions
of it.
"""


class BenchTrajectory(NamedTuple):
    """Prescribed lengths and target forces of one episode."""

    unit_length: Array
    """Length of the unit [m] at each simulation step."""
    target_force: Array
    """Target force [N] at the start and at the end of each interval; 0 in the task *work*."""


class TrajectoryGenerator:
    """Random generator of trajectories for one device."""

    def __init__(
        self, device: Device, task: str, n_intervals: int, interval: float, dt: float, cycle_duration: float
    ) -> None:
        """Set up trajectories of ``n_intervals`` intervals of ``interval`` [s] in steps of ``dt`` [s].

        ``cycle_duration`` [s] is the period of the task *work*.
        """
        parameters = device.parameters
        resting_length, slack_length = parameters.muscle.resting_length, parameters.tendon.slack_length
        self.mean_length = slack_length + 0.5 * (MIN_LENGTH_RATIO + MAX_LENGTH_RATIO) * resting_length
        """Length of the unit at mid travel [m]."""
        self._amplitude = 0.5 * (MAX_LENGTH_RATIO - MIN_LENGTH_RATIO) * resting_length
        self._task, self._cycle_duration = task, cycle_duration
        self.max_force = isometric_force(
            device, 0.5 * (MIN_LENGTH_RATIO + MAX_LENGTH_RATIO), parameters.supply.max_pressure
        )
        """Isometric force of the muscle at mid travel and supply pressure [N]."""
        self._time: Array = dt * np.arange(1.0 + n_intervals * round(interval / dt), dtype=np.float64)
        self._control_time: Array = interval * np.arange(1.0 + n_intervals, dtype=np.float64)

    def sample(self, rng: np.random.Generator) -> BenchTrajectory:
        """Return a trajectory; all cycles of the task *work* are equal and begin at mid travel, lengthening."""
        if self._task == "work":
            return BenchTrajectory(
                self.mean_length + self._amplitude * np.sin(2.0 * np.pi * self._time / self._cycle_duration),
                np.zeros(len(self._control_time)),
            )
        length = self.mean_length + self._amplitude * random_wave(self._time, MAX_FREQUENCY, rng)
        mean_force = 0.5 * (MAX_FORCE_FRACTION + MIN_FORCE_FRACTION)
        force_amplitude = 0.5 * (MAX_FORCE_FRACTION - MIN_FORCE_FRACTION)
        return BenchTrajectory(
            length,
            self.max_force * (mean_force + force_amplitude * random_wave(self._control_time, MAX_FREQUENCY, rng)),
        )


def random_wave(time: Array, max_frequency: float, rng: np.random.Generator) -> Array:
    """Return a smooth random signal within -1 and 1 of frequencies up to ``max_frequency`` [Hz]."""
    frequency = max_frequency * np.arange(1, N_SINES + 1) / N_SINES
    phase, weights = rng.uniform(0.0, 2.0 * np.pi, N_SINES), rng.dirichlet(np.ones(N_SINES))
    return np.asarray(np.sin(2.0 * np.pi * np.outer(time, frequency) + phase) @ weights)
