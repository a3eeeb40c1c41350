"""The instruments of the environment's prostheses: noisy and late if asked for."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from klute_sim.rigs.gait.assembly import Assembly
from klute_sim.rigs.gait.senses import Senses

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


class Instruments:
    """Of ``count`` prostheses."""

    def __init__(self, rig: Assembly, count: int, interval: float, noise: float, delay: int) -> None:
        """Read every ``interval`` [s], with ``noise`` times the typical noise, ``delay`` whole intervals late."""
        self.senses, self._noise = Senses(rig, count, interval), noise
        """Without either."""
        self._lowest, self._highest = (np.array([row[k] for row in OBSERVATIONS]) for k in (2, 3))
        self._typical = np.array([row[4] for row in OBSERVATIONS[:MEASURED]])
        self._read = np.zeros((count, 1 + delay, MEASURED))

    @property
    def observed(self) -> NDArray[np.float32]:
        """(n, 8) :data:`OBSERVATIONS`."""
        turn = 2.0 * np.pi * self.senses.phase()
        sensed = np.column_stack([self._read[:, 0], np.sin(turn), np.cos(turn)])
        if not np.isfinite(sensed.sum()):  # the last observation of an episode that failed
            sensed = np.nan_to_num(sensed)
        return np.asarray(np.clip(sensed, self._lowest, self._highest), dtype=np.float32)

    def begin(self, which: Mask, measured: Array, randoms: Sequence[np.random.Generator]) -> None:
        """Forget the episodes of ``which``; ``measured`` (n, 6) is how they start."""
        self._read[which] = self._noisy(which, measured, randoms)[which, None]
        self.senses.begin(which)

    def turn(self, which: Mask, measured: Array, randoms: Sequence[np.random.Generator]) -> None:
        """An interval has passed in ``which``; ``measured`` (n, 6) is what perfect sensors read."""
        noisy = self._noisy(which, measured, randoms)
        self._read[which, :-1] = self._read[which, 1:]
        self._read[which, -1] = noisy[which]
        self.senses.move_on(self._read[:, 0, LOAD], which)

    def _noisy(self, which: Mask, measured: Array, randoms: Sequence[np.random.Generator]) -> Array:
        if self._noise == 0.0:
            return measured
        noisy = measured.copy()
        for i in np.flatnonzero(which).tolist():  # every simulation has its own random numbers
            noisy[i] += self._noise * self._typical * randoms[i].standard_normal(MEASURED)
        return noisy
