"""What a prosthesis senses: noisy and late if asked for, and the gait phase that can be told from it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

OBSERVATIONS = (
    # name, unit, lowest, highest, typical noise
    ("ankle angle, dorsiflexion positive", "rad", -1.0, 1.0, 0.002),
    ("ankle velocity, dorsiflexion positive", "rad/s", -50.0, 50.0, 0.05),
    ("shank inclination, forward positive", "rad", -3.2, 3.2, 0.01),
    ("shank angular velocity, forward positive", "rad/s", -50.0, 50.0, 0.02),
    ("axial load in the pylon, compression positive", "body weights", -5.0, 5.0, 0.01),
    ("gauge pressure", "bar", 0.0, 20.0, 0.02),
    ("sine of the estimated gait phase", "1", -1.0, 1.0, 0.0),
    ("cosine of the estimated gait phase", "1", -1.0, 1.0, 0.0),
)
"""Name, unit, lowest and highest value (what is beyond is clipped), and the noise's standard deviation (assumed: an
encoder of 0.1 degrees, an inertial sensor's fusion to half a degree, gauges of half a percent of their range). Noise
reaches the phase through the load that it is told from."""
MEASURED = 6
"""The first of them come from sensors, the others are worked out."""
LOAD = 4

STRIKE, SWING = 0.10, 0.05
"""Load [body weights] above which the foot has struck, and below which it has left."""
SHORTEST, LONGEST, EARLY = 0.6, 1.6, 0.1
"""Of the usual stride time: the least and the most a stride is taken for; until when a strike is the first one's."""


class Senses:
    """Of ``count`` prostheses."""

    def __init__(self, count: int, interval: float, noise: float, delay: int) -> None:
        """Read every ``interval`` [s], with ``noise`` times the typical noise, ``delay`` whole intervals late."""
        self._interval, self._noise = interval, noise
        self._lowest, self._highest = (np.array([row[k] for row in OBSERVATIONS]) for k in (2, 3))
        self._typical = np.array([row[4] for row in OBSERVATIONS[:MEASURED]])
        self._read = np.zeros((count, 1 + delay, MEASURED))
        self._standing: Mask = np.zeros(count, dtype=np.bool_)
        self._since, self._period, self._usual = np.zeros(count), np.ones(count), np.ones(count)

    @property
    def phase(self) -> Array:
        """(n,) estimated phase of the stride [0-1]: time since the last foot strike over that between the last two."""
        return np.minimum(self._since / self._period, 1.0)

    @property
    def observed(self) -> NDArray[np.float32]:
        """(n, 8) :data:`OBSERVATIONS`."""
        turn = 2.0 * np.pi * self.phase
        sensed = np.column_stack([self._read[:, 0], np.sin(turn), np.cos(turn)])
        if not np.isfinite(sensed.sum()):  # the last observation of an episode that failed
            sensed = np.nan_to_num(sensed)
        return np.asarray(np.clip(sensed, self._lowest, self._highest), dtype=np.float32)

    def begin(self, which: Mask, measured: Array, stride_time: Array, randoms: Sequence[np.random.Generator]) -> None:
        """Forget the episodes of ``which``; ``measured`` (n, 6) is how they start, ``stride_time`` (n,) [s] usual."""
        self._read[which] = self._noisy(which, measured, randoms)[which, None]
        self._standing[which], self._since[which] = False, 0.0
        self._usual[which] = self._period[which] = stride_time[which]

    def turn(self, which: Mask, measured: Array, randoms: Sequence[np.random.Generator]) -> None:
        """An interval has passed in ``which``; ``measured`` (n, 6) is what a perfect sensor would read."""
        noisy = self._noisy(which, measured, randoms)
        self._read[which, :-1] = self._read[which, 1:]
        self._read[which, -1] = noisy[which]
        self._estimate_phase(self._read[:, 0, LOAD], which)

    def _noisy(self, which: Mask, measured: Array, randoms: Sequence[np.random.Generator]) -> Array:
        if self._noise == 0.0:
            return measured
        noisy = measured.copy()
        for i in np.flatnonzero(which).tolist():  # every simulation has its own random numbers
            noisy[i] += self._noise * self._typical * randoms[i].standard_normal(MEASURED)
        return noisy

    def _estimate_phase(self, load: Array, which: Mask) -> None:
        """Time since the last foot strike over the time between the last two."""
        self._since += self._interval * which
        strikes = which & ~self._standing & (load > STRIKE)
        if strikes.any():
            # A bounce within the stride is no stride. The wearer's cadence is known well enough to tell.
            counts = strikes & (self._since > SHORTEST * self._usual)
            self._period = np.where(counts, np.minimum(self._since, LONGEST * self._usual), self._period)
            self._since = np.where(counts | (strikes & (self._since < EARLY * self._usual)), 0.0, self._since)
        self._standing = np.where(which, load > np.where(self._standing, SWING, STRIKE), self._standing)
