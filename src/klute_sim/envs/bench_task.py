"""What ``klute_sim/AnkleBench`` asks for: lengths that the crosshead prescribes, forces or work over them."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.device.files import Device
from klute_sim.rigs.bench.reach import isometric_force

Array = NDArray[np.float64]

TASKS: Mapping[str, str] = MappingProxyType(
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

SHORTEST, LONGEST = 0.88, 0.97
"""Muscle lengths over the resting length between which a just taut unit moves."""
WEAKEST, STRONGEST = 0.1, 0.5
"""Wanted forces over what the muscle pulls with in the middle of its way under all the supply's pressure."""
WAVES, FASTEST = 4, 1.5
"""Sines of random phase in a random course, and the frequency of the fastest [Hz]; the others are fractions of it."""

CLOSE = 0.05
"""Distance from the wanted force that counts as one, over the strongest force."""
EASY_AIR = 0.1
"""Added to the air of a cycle [g]: work that needs no air is worth something finite."""
WORTH = 0.1
"""Reward of a cycle per J/g."""
SMOOTHNESS = -0.05
"""Reward per squared change of the action."""


class Course(NamedTuple):
    """What one episode prescribes, and what it wants."""

    length: Array
    """Of the unit [m], one for each step of the simulation."""
    wanted: Array
    """Force [N] at the end of each interval, and at the start; 0 in the task *work*."""


class Courses:
    """Draws courses for one device."""

    def __init__(self, device: Device, task: str, intervals: int, interval: float, step: float, cycle: float) -> None:
        """Of so many ``intervals``, each of ``interval`` [s], in steps of ``step`` [s]; ``cycle`` [s] in *work*."""
        parameters = device.parameters
        rest, slack = parameters.muscle.resting_length, parameters.tendon.slack_length
        self.middle = slack + 0.5 * (SHORTEST + LONGEST) * rest
        """Of its way [m]."""
        self._swing, self._task, self._cycle = 0.5 * (LONGEST - SHORTEST) * rest, task, cycle
        self.strongest = isometric_force(device, 0.5 * (SHORTEST + LONGEST), parameters.supply.pressure)
        """What the muscle pulls with there under all the supply's pressure [N]."""
        self._time: Array = step * np.arange(1.0 + intervals * round(interval / step), dtype=np.float64)
        self._told: Array = interval * np.arange(1.0 + intervals, dtype=np.float64)

    def draw(self, random: np.random.Generator) -> Course:
        """A course; every cycle of the task *work* is like the first, which begins in the middle, lengthening."""
        if self._task == "work":
            return Course(
                self.middle + self._swing * np.sin(2.0 * np.pi * self._time / self._cycle), np.zeros(len(self._told))
            )
        length = self.middle + self._swing * _wave(self._time, random)
        middle, swing = 0.5 * (STRONGEST + WEAKEST), 0.5 * (STRONGEST - WEAKEST)
        return Course(length, self.strongest * (middle + swing * _wave(self._told, random)))


def _wave(time: Array, random: np.random.Generator) -> Array:
    """A smooth random course within -1 ... 1."""
    frequency = FASTEST * np.arange(1, WAVES + 1) / WAVES
    phase, share = random.uniform(0.0, 2.0 * np.pi, WAVES), random.dirichlet(np.ones(WAVES))
    return np.asarray(np.sin(2.0 * np.pi * np.outer(time, frequency) + phase) @ share)
