"""Instruments of the prosthesis in the environments, with optional noise and delay."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from klute_sim.gait.rig.sensors import ProsthesisSensors
from klute_sim.gait.rig.setup import GaitRig
from klute_sim.types import Array, Mask

OBSERVATIONS = (
    # name, unit, lowest, highest, typical noise
    ("angle of the ankle hinge, dorsiflexion positive", "rad", -1.0, 1.0, 0.002),
    ("velocity of the ankle hinge, dorsiflexion positive", "rad/s", -50.0, 50.0, 0.05),
    ("shank inclination, forward positive", "rad", -3.2, 3.2, 0.01),
    ("shank angular velocity, forward positive", "rad/s", -50.0, 50.0, 0.02),
    ("axial load in the pylon, compression positive", "body weights", -5.0, 5.0, 0.01),
    ("gauge pressure", "bar", 0.0, 20.0, 0.02),
    ("sine of the estimated gait phase", "1", -1.0, 1.0, 0.0),
    ("cosine of the estimated gait phase", "1", -1.0, 1.0, 0.0),
)
"""Name, unit, lowest and highest value (values outside are clipped) and standard deviation of the noise.

The noise is assumed: an encoder of 0.1 degrees, inertial sensor fusion of half a degree, and gauges of half a percent
of their range. Noise reaches the phase through the load from which it is estimated.
"""
N_MEASURED = 6
"""Number of leading observations that sensors measure; the others are computed."""
LOAD_INDEX = 4
"""Index of the axial load among the observations."""


class Instruments:
    """Instruments of ``n_simulations`` prostheses."""

    def __init__(
        self, gait_rig: GaitRig, n_simulations: int, interval: float, noise_scale: float, delay_intervals: int
    ) -> None:
        """Set up instruments that are read every ``interval`` [s].

        ``noise_scale`` multiplies the typical noise; ``delay_intervals`` is the delay in whole intervals.
        """
        self.sensors, self._noise_scale = ProsthesisSensors(gait_rig, n_simulations, interval), noise_scale
        """Ideal sensors, without noise and delay."""
        self._lower, self._upper = (np.array([row[k] for row in OBSERVATIONS]) for k in (2, 3))
        self._noise_deviation = np.array([row[4] for row in OBSERVATIONS[:N_MEASURED]])
        self._measurement_buffer = np.zeros((n_simulations, 1 + delay_intervals, N_MEASURED))

    @property
    def observations(self) -> NDArray[np.float32]:
        """Return the observations, shape (n, 8); see :data:`OBSERVATIONS`."""
        phase_angle = 2.0 * np.pi * self.sensors.estimate_phase()
        observations = np.column_stack([self._measurement_buffer[:, 0], np.sin(phase_angle), np.cos(phase_angle)])
        if not np.isfinite(observations.sum()):  # the last observation of an episode that failed
            observations = np.nan_to_num(observations)
        return np.asarray(np.clip(observations, self._lower, self._upper), dtype=np.float32)

    def reset(self, mask: Mask, measured: Array, rngs: Sequence[np.random.Generator]) -> None:
        """Restart the instruments in ``mask`` from the measurements ``measured`` (n, 6)."""
        self._measurement_buffer[mask] = self._add_noise(mask, measured, rngs)[mask, None]
        self.sensors.reset(mask)

    def update(self, mask: Mask, measured: Array, rngs: Sequence[np.random.Generator]) -> None:
        """Advance the instruments in ``mask`` by one interval to the ideal measurements ``measured`` (n, 6)."""
        noisy = self._add_noise(mask, measured, rngs)
        self._measurement_buffer[mask, :-1] = self._measurement_buffer[mask, 1:]
        self._measurement_buffer[mask, -1] = noisy[mask]
        self.sensors.update_phase(self._measurement_buffer[:, 0, LOAD_INDEX], mask)

    def _add_noise(self, mask: Mask, measured: Array, rngs: Sequence[np.random.Generator]) -> Array:
        if self._noise_scale == 0.0:
            return measured
        noisy = measured.copy()
        for i in np.flatnonzero(mask).tolist():  # each simulation has its own generator
            noisy[i] += self._noise_scale * self._noise_deviation * rngs[i].standard_normal(N_MEASURED)
        return noisy
