"""A length over time, piece by piece, with finite speed and acceleration."""

from collections.abc import Callable
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Path:
    """Where a crosshead is told to be; begins at rest."""

    def __init__(self, start: float, rest: float) -> None:
        """At ``start`` [m], where it stays for ``rest`` [s]."""
        self.end, self.here = 0.0, start
        """When [s] and where [m] it ends so far."""
        self._pieces: list[tuple[float, Callable[[Array], Array]]] = []
        self.hold(rest)

    def hold(self, duration: float) -> Self:
        """Stay for ``duration`` [s]."""
        here = self.here
        return self.then(duration, lambda t: np.full(len(t), here), here)

    def move(self, there: float, speed: float, acceleration: float) -> Self:
        """To ``there`` [m] and to rest, at ``speed`` [m/s] as far as ``acceleration`` [m/s^2] lets it get there."""
        here, way = self.here, abs(there - self.here)
        speed = min(speed, float(np.sqrt(way * acceleration)))
        if speed == 0.0:
            return self
        rise, whole = speed / acceleration, way / speed + speed / acceleration
        sign = np.sign(there - here)

        def gone(t: Array) -> Array:
            up, level, down = np.minimum(t, rise), np.maximum(t - rise, 0.0), np.maximum(t - (whole - rise), 0.0)
            return np.asarray(here + sign * (0.5 * acceleration * (up**2 - down**2) + speed * level))

        return self.then(whole, gone, there)

    def then(self, duration: float, piece: Callable[[Array], Array], there: float) -> Self:
        """Follow ``piece`` (seconds since its begin -> length [m]) for ``duration`` [s], and end ``there`` [m]."""
        self._pieces.append((self.end, piece))
        self.end, self.here = self.end + duration, there
        return self

    def samples(self, step: float) -> int:
        """How many samples it takes, a sample every ``step`` [s]."""
        return int(np.ceil(self.end / step - 1e-9)) + 1

    def sampled(self, step: float) -> tuple[Array, Array]:
        """Time [s] from 0 and length [m], a sample every ``step`` [s], at rest to the end."""
        time: Array = step * np.arange(self.samples(step), dtype=np.float64)
        length = np.full(len(time), self.here)
        begins = [*(begin for begin, _ in self._pieces), self.end]
        for k, (begin, piece) in enumerate(self._pieces):
            own = slice(*np.searchsorted(time, begins[k : k + 2]))
            length[own] = piece(time[own] - begin)
        return time, length


def stairs(time: Array, levels: list[tuple[float, float]] | tuple[tuple[float, float], ...]) -> Array:
    """What stands at each of ``levels`` (time [s], level) from its time on; the first must be there from the start."""
    found: NDArray[Any] = np.empty(len(time))
    for begin, level in levels:
        found[time >= begin - 1e-9] = level
    return found
