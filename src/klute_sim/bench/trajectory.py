"""A length over time, piece by piece, with finite speed and acceleration."""

from collections.abc import Callable
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class LengthTrajectory:
    """Where a crosshead is told to be; begins at rest."""

    def __init__(self, start_length: float, rest_time: float) -> None:
        """At ``start`` [m], where it stays for ``rest`` [s]."""
        self.end_time, self.end_length = 0.0, start_length
        """When [s] and where [m] it ends so far."""
        self._segments: list[tuple[float, Callable[[Array], Array]]] = []
        self.hold(rest_time)

    def hold(self, duration: float) -> Self:
        """Stay for ``duration`` [s]."""
        here = self.end_length
        return self.append_segment(duration, lambda t: np.full(len(t), here), here)

    def move(self, target_length: float, speed: float, acceleration: float) -> Self:
        """To ``there`` [m] and to rest, at ``speed`` [m/s] as far as ``acceleration`` [m/s^2] lets it get there."""
        here, way = self.end_length, abs(target_length - self.end_length)
        speed = min(speed, float(np.sqrt(way * acceleration)))
        if speed == 0.0:
            return self
        rise, whole = speed / acceleration, way / speed + speed / acceleration
        sign = np.sign(target_length - here)

        def gone(t: Array) -> Array:
            up, level, down = np.minimum(t, rise), np.maximum(t - rise, 0.0), np.maximum(t - (whole - rise), 0.0)
            return np.asarray(here + sign * (0.5 * acceleration * (up**2 - down**2) + speed * level))

        return self.append_segment(whole, gone, target_length)

    def append_segment(self, duration: float, segment: Callable[[Array], Array], end_length: float) -> Self:
        """Follow ``piece`` (seconds since its begin -> length [m]) for ``duration`` [s], and end ``there`` [m]."""
        self._segments.append((self.end_time, segment))
        self.end_time, self.end_length = self.end_time + duration, end_length
        return self

    def count_samples(self, dt: float) -> int:
        """How many samples it takes, a sample every ``step`` [s]."""
        return int(np.ceil(self.end_time / dt - 1e-9)) + 1

    def sample(self, dt: float) -> tuple[Array, Array]:
        """Time [s] from 0 and length [m], a sample every ``step`` [s], at rest to the end."""
        time: Array = dt * np.arange(self.count_samples(dt), dtype=np.float64)
        length = np.full(len(time), self.end_length)
        begins = [*(begin for begin, _ in self._segments), self.end_time]
        for k, (begin, piece) in enumerate(self._segments):
            own = slice(*np.searchsorted(time, begins[k : k + 2]))
            length[own] = piece(time[own] - begin)
        return time, length


def sample_staircase(time: Array, levels: list[tuple[float, float]] | tuple[tuple[float, float], ...]) -> Array:
    """What stands at each of ``levels`` (time [s], level) from its time on; the first must be there from the start."""
    found: NDArray[Any] = np.empty(len(time))
    for begin, level in levels:
        found[time >= begin - 1e-9] = level
    return found
