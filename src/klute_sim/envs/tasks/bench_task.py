"""What ``klute_sim/AnkleBench`` asks for: lengths that the crosshead prescribes, forces or work over them."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.bench.limits import isometric_force
from klute_sim.device.device import Device

Array = NDArray[np.float64]

BENCH_TASKS: Mapping[str, str] = MappingProxyType(
    {
        "force": "pull with a force that changes smoothly at random while the crosshead moves likewise",
        "work": "do as much work per gram of air as possible over a cycle of the crosshead",
    }
)

OBSERVATIONS = (
    # name, unit, lowest, highest
    ("length of the unit beyond the middle of its way", "cm", -20.0, 20.0),
    ("velocity of the unit, lengthening positive", "m/s", -5.0, 5.0),
    ("force on the load cell, pulling positive", "kN", -20.0, 20.0),
    ("gauge pressure", "bar", 0.0, 20.0),
    ("force wanted; 0 in the task work", "kN", 0.0, 20.0),
)
"""Name, unit, lowest and highest value; what is beyond is clipped."""

MIN_LENGTH_RATIO, MAX_LENGTH_RATIO = 0.88, 0.97
"""Muscle lengths over the resting length between which a just taut unit moves."""
MIN_FORCE_FRACTION, MAX_FORCE_FRACTION = 0.1, 0.5
"""Wanted forces over what the muscle pulls with in the middle of its way under all the supply's pressure."""
N_SINES, MAX_FREQUENCY = 4, 1.5
"""Sines of random phase in a random course, and the frequency of the fastest [Hz]; the others are fractions of it."""

FORCE_ERROR_SCALE = 0.05
"""Distance from the wanted force that counts as one, over the strongest force."""
AIR_MASS_OFFSET_G = 0.1
"""Added to the air of a cycle [g]: work that needs no air is worth something finite."""
WORK_REWARD_WEIGHT = 0.1
"""Reward of a cycle per J/g."""
SMOOTHNESS_WEIGHT = -0.05
"""Reward per squared change of the action."""


class BenchTrajectory(NamedTuple):
    """What one episode prescribes, and what it wants."""

    unit_length: Array
    """Of the unit [m], one for each step of the simulation."""
    target_force: Array
    """Force [N] at the end of each interval, and at the start; 0 in the task *work*."""


class TrajectoryGenerator:
    """Draws courses for one device."""

    def __init__(
        self, device: Device, task: str, n_intervals: int, interval: float, dt: float, cycle_duration: float
    ) -> None:
        """Of so many ``intervals``, each of ``interval`` [s], in steps of ``step`` [s]; ``cycle`` [s] in *work*."""
        parameters = device.parameters
        rest, slack = parameters.muscle.resting_length, parameters.tendon.slack_length
        self.mean_length = slack + 0.5 * (MIN_LENGTH_RATIO + MAX_LENGTH_RATIO) * rest
        """Of its way [m]."""
        self._amplitude, self._task, self._cycle_duration = (
            0.5 * (MAX_LENGTH_RATIO - MIN_LENGTH_RATIO) * rest,
            task,
            cycle_duration,
        )
        self.max_force = isometric_force(
            device, 0.5 * (MIN_LENGTH_RATIO + MAX_LENGTH_RATIO), parameters.supply.max_pressure
        )
        """What the muscle pulls with there under all the supply's pressure [N]."""
        self._time: Array = dt * np.arange(1.0 + n_intervals * round(interval / dt), dtype=np.float64)
        self._control_time: Array = interval * np.arange(1.0 + n_intervals, dtype=np.float64)

    def sample(self, rng: np.random.Generator) -> BenchTrajectory:
        """A course; every cycle of the task *work* is like the first, which begins in the middle, lengthening."""
        if self._task == "work":
            return BenchTrajectory(
                self.mean_length + self._amplitude * np.sin(2.0 * np.pi * self._time / self._cycle_duration),
                np.zeros(len(self._control_time)),
            )
        length = self.mean_length + self._amplitude * _random_wave(self._time, rng)
        middle, swing = 0.5 * (MAX_FORCE_FRACTION + MIN_FORCE_FRACTION), 0.5 * (MAX_FORCE_FRACTION - MIN_FORCE_FRACTION)
        return BenchTrajectory(length, self.max_force * (middle + swing * _random_wave(self._control_time, rng)))


def _random_wave(time: Array, rng: np.random.Generator) -> Array:
    """A smooth random course within -1 ... 1."""
    frequency = MAX_FREQUENCY * np.arange(1, N_SINES + 1) / N_SINES
    phase, share = rng.uniform(0.0, 2.0 * np.pi, N_SINES), rng.dirichlet(np.ones(N_SINES))
    return np.asarray(np.sin(2.0 * np.pi * np.outer(time, frequency) + phase) @ share)
