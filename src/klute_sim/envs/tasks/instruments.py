"""The instruments of the environment's prostheses: noisy and late if asked for."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from klute_sim.gait.rig.sensors import ProsthesisSensors
from klute_sim.gait.rig.setup import GaitRig

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
N_MEASURED = 6
"""The first of them come from sensors, the others are worked out."""
LOAD_INDEX = 4


class Instruments:
    """Of ``count`` prostheses."""

    def __init__(
        self, gait_rig: GaitRig, n_simulations: int, interval: float, noise_scale: float, delay_intervals: int
    ) -> None:
        """Read every ``interval`` [s], with ``noise`` times the typical noise, ``delay`` whole intervals late."""
        self.sensors, self._noise_scale = ProsthesisSensors(gait_rig, n_simulations, interval), noise_scale
        """Without either."""
        self._lower, self._upper = (np.array([row[k] for row in OBSERVATIONS]) for k in (2, 3))
        self._noise_deviation = np.array([row[4] for row in OBSERVATIONS[:N_MEASURED]])
        self._measurement_buffer = np.zeros((n_simulations, 1 + delay_intervals, N_MEASURED))

    @property
    def observations(self) -> NDArray[np.float32]:
        """(n, 8) :data:`OBSERVATIONS`."""
        turn = 2.0 * np.pi * self.sensors.estimate_phase()
        sensed = np.column_stack([self._measurement_buffer[:, 0], np.sin(turn), np.cos(turn)])
        if not np.isfinite(sensed.sum()):  # the last observation of an episode that failed
            sensed = np.nan_to_num(sensed)
        return np.asarray(np.clip(sensed, self._lower, self._upper), dtype=np.float32)

    def reset(self, mask: Mask, measured: Array, rngs: Sequence[np.random.Generator]) -> None:
        """Forget the episodes of ``which``; ``measured`` (n, 6) is how they start."""
        self._measurement_buffer[mask] = self._add_noise(mask, measured, rngs)[mask, None]
        self.sensors.reset(mask)

    def update(self, mask: Mask, measured: Array, rngs: Sequence[np.random.Generator]) -> None:
        """An interval has passed in ``which``; ``measured`` (n, 6) is what perfect sensors read."""
        noisy = self._add_noise(mask, measured, rngs)
        self._measurement_buffer[mask, :-1] = self._measurement_buffer[mask, 1:]
        self._measurement_buffer[mask, -1] = noisy[mask]
        self.sensors.update_phase(self._measurement_buffer[:, 0, LOAD_INDEX], mask)

    def _add_noise(self, mask: Mask, measured: Array, rngs: Sequence[np.random.Generator]) -> Array:
        if self._noise_scale == 0.0:
            return measured
        noisy = measured.copy()
        for i in np.flatnonzero(mask).tolist():  # every simulation has its own random numbers
            noisy[i] += self._noise_scale * self._noise_deviation * rngs[i].standard_normal(N_MEASURED)
        return noisy
