"""Length trajectories, built from segments with finite speed and acceleration, and staircase signals."""

from collections.abc import Callable, Sequence
from typing import Self

import numpy as np

from klute_sim.types import Array


class LengthTrajectory:
    """Commanded unit length over time; starts at rest."""

    def __init__(self, start_length: float, rest_time: float) -> None:
        """Start at ``start_length`` [m] and rest there for ``rest_time`` [s]."""
        self.end_time, self.end_length = 0.0, start_length
        """Time [s] and length [m] at which the trajectory ends so far."""
        self._segments: list[tuple[float, Callable[[Array], Array]]] = []
        self.hold(rest_time)

    def hold(self, duration: float) -> Self:
        """Append a hold of the current length for ``duration`` [s]."""
        length = self.end_length
        return self.append_segment(duration, lambda t: np.full(len(t), length), length)

    def move(self, target_length: float, speed: float, acceleration: float) -> Self:
        """Append a move to ``target_length`` [m], at rest there, with a trapezoidal velocity profile.

        The velocity reaches ``speed`` [m/s] unless ``acceleration`` [m/s^2] is too low for the distance.
        """
        start, distance = self.end_length, abs(target_length - self.end_length)
        speed = min(speed, float(np.sqrt(distance * acceleration)))
        if speed == 0.0:
            return self
        rise_time, duration = speed / acceleration, distance / speed + speed / acceleration
        sign = np.sign(target_length - start)

        def compute_length(t: Array) -> Array:
            rising = np.minimum(t, rise_time)
            level = np.maximum(t - rise_time, 0.0)
            falling = np.maximum(t - (duration - rise_time), 0.0)
            return np.asarray(start + sign * (0.5 * acceleration * (rising**2 - falling**2) + speed * level))

        return self.append_segment(duration, compute_length, target_length)

    def append_segment(self, duration: float, segment: Callable[[Array], Array], end_length: float) -> Self:
        """Append a ``segment`` (time since its start [s] -> length [m]) of ``duration`` [s] to ``end_length`` [m]."""
        self._segments.append((self.end_time, segment))
        self.end_time, self.end_length = self.end_time + duration, end_length
        return self

    def count_samples(self, dt: float) -> int:
        """Return the number of samples of the trajectory with one sample every ``dt`` [s]."""
        return int(np.ceil(self.end_time / dt - 1e-9)) + 1

    def sample(self, dt: float) -> tuple[Array, Array]:
        """Return time [s] from 0 and length [m] with one sample every ``dt`` [s], at rest at the end."""
        time: Array = dt * np.arange(self.count_samples(dt), dtype=np.float64)
        length = np.full(len(time), self.end_length)
        starts = [*(start for start, _ in self._segments), self.end_time]
        for k, (start, segment) in enumerate(self._segments):
            samples = slice(*np.searchsorted(time, starts[k : k + 2]))
            length[samples] = segment(time[samples] - start)
        return time, length


def sample_staircase(time: Array, levels: Sequence[tuple[float, float]]) -> Array:
    """Return a staircase signal at ``time`` [s]: each of ``levels`` (start time [s], level) holds until the next.

    The first level must start at or before the first sample.
    """
    signal: Array = np.empty(len(time))
    for start, level in levels:
        signal[time >= start - 1e-9] = level
    return signal
