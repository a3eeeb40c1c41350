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
_LOWER, _UPPER = (np.array([row[k] for row in OBSERVATIONS]) for k in (2, 3))
NOISE_DEVIATION = np.array([row[4] for row in OBSERVATIONS[:N_MEASURED]])
"""Typical standard deviations of the noise of the measured observations, in their units."""


class NoisyMeasurements:
    """Measurements of ``n_simulations`` simulations with noise and delay."""

    def __init__(self, n_simulations: int, noise_deviation: Array, delay_intervals: int) -> None:
        """Set up measurements with ``noise_deviation`` (number of measurements), in their units.

        ``delay_intervals`` is the delay in whole intervals.
        """
        self._noise_deviation = noise_deviation
        self._buffer = np.zeros((n_simulations, 1 + delay_intervals, len(noise_deviation)))

    @property
    def values(self) -> Array:
        """Return the delayed measurements (n, number of measurements), as a view."""
        return self._buffer[:, 0]

    def reset(self, mask: Mask, measured: Array, rngs: Sequence[np.random.Generator]) -> None:
        """Restart the simulations in ``mask`` from the ideal measurements ``measured``."""
        self._buffer[mask] = self._add_noise(mask, measured, rngs)[mask, None]

    def update(self, mask: Mask, measured: Array, rngs: Sequence[np.random.Generator]) -> None:
        """Advance the simulations in ``mask`` by one interval to the ideal measurements ``measured``."""
        noisy = self._add_noise(mask, measured, rngs)
        self._buffer[mask, :-1] = self._buffer[mask, 1:]
        self._buffer[mask, -1] = noisy[mask]

    def _add_noise(self, mask: Mask, measured: Array, rngs: Sequence[np.random.Generator]) -> Array:
        if not self._noise_deviation.any():
            return measured
        noisy = measured.copy()
        for i in np.flatnonzero(mask).tolist():  # each simulation has its own generator
            noisy[i] += self._noise_deviation * rngs[i].standard_normal(len(self._noise_deviation))
        return noisy


def build_observations(measured: Array, phase: Array) -> NDArray[np.float32]:
    """Return the observations (n, 8), see :data:`OBSERVATIONS`, from ``measured`` (n, 6) and estimated ``phase`` (n,).

    A value that is not finite, as in the last observation of an episode that failed, becomes finite.
    """
    phase_angle = 2.0 * np.pi * phase
    observations = np.column_stack([measured, np.sin(phase_angle), np.cos(phase_angle)])
    if not np.isfinite(observations.sum()):
        observations = np.nan_to_num(observations)
    return np.asarray(np.minimum(np.maximum(observations, _LOWER), _UPPER), dtype=np.float32)


class Instruments:
    """Instruments of ``n_simulations`` prostheses on the gait rig."""

    def __init__(
        self, gait_rig: GaitRig, n_simulations: int, interval: float, noise_scale: float, delay_intervals: int
    ) -> None:
        """Set up instruments that are read every ``interval`` [s].

        ``noise_scale`` multiplies the typical noise; ``delay_intervals`` is the delay in whole intervals.
        """
        self.sensors = ProsthesisSensors(gait_rig, n_simulations, interval)
        """Ideal sensors, without noise and delay."""
        self._measurements = NoisyMeasurements(n_simulations, noise_scale * NOISE_DEVIATION, delay_intervals)

    @property
    def observations(self) -> NDArray[np.float32]:
        """Return the observations, shape (n, 8); see :data:`OBSERVATIONS`."""
        return build_observations(self._measurements.values, self.sensors.estimate_phase())

    def reset(self, mask: Mask, measured: Array, rngs: Sequence[np.random.Generator]) -> None:
        """Restart the instruments in ``mask`` from the measurements ``measured`` (n, 6)."""
        self._measurements.reset(mask, measured, rngs)
        self.sensors.reset(mask)

    def update(self, mask: Mask, measured: Array, rngs: Sequence[np.random.Generator]) -> None:
        """Advance the instruments in ``mask`` by one interval to the ideal measurements ``measured`` (n, 6)."""
        self._measurements.update(mask, measured, rngs)
        self.sensors.update_phase(self._measurements.values[:, LOAD_INDEX], mask)
