"""What a prosthesis on the rig senses, of many simulations at once.

Everything is an array with one entry per simulation, so that one walk and a batch of them are the same code.
"""

import numpy as np
from numpy.typing import NDArray

from klute_sim.controllers.feedback import SensorReadings
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.reference import GRAVITY
from klute_sim.gait.rig.setup import GaitRig
from klute_sim.units import BAR

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FOOT_STRIKE_LOAD_BW, TOE_OFF_LOAD_BW = 0.10, 0.05
"""Load [body weights] above which the foot has struck, and below which it has left."""
MIN_STRIDE_FRACTION, MAX_STRIDE_FRACTION, FIRST_STRIKE_FRACTION = 0.6, 1.6, 0.1
"""Of the usual stride time: the least and the most a stride is taken for; until when a strike is the first one's."""


class ProsthesisSensors:
    """Of ``count`` simulations, read every ``interval`` [s]."""

    def __init__(self, gait_rig: GaitRig, n_simulations: int, interval: float) -> None:
        """All of one rig, whose stride time is the wearer's usual one."""
        model, joint = gait_rig.model, gait_rig.model.joint(PROSTHESIS_PREFIX + "ankle")
        self._ankle_qpos_index, self._ankle_dof_index = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._load_cell_index = int(model.sensor(PROSTHESIS_PREFIX + "load_cell").adr[0]) + 2
        self._pressure_index, self._interval = gait_rig.actuator.act_address, interval
        self._body_weight, self._nominal_stride_time, self._slope = (
            np.empty(n_simulations),
            np.empty(n_simulations),
            np.empty(n_simulations),
        )
        self.assign_gait_rig(slice(None), gait_rig)
        self._in_stance: Mask = np.zeros(n_simulations, dtype=np.bool_)
        self._time_since_strike = np.zeros(n_simulations)
        self._stride_time = self._nominal_stride_time.copy()

    def assign_gait_rig(self, index: int | slice, gait_rig: GaitRig) -> None:
        """Simulations at ``place`` are of this rig from their next beginning on; it differs in walker and ground."""
        self._body_weight[index], self._nominal_stride_time[index] = (
            gait_rig.options.mass * GRAVITY,
            gait_rig.trajectory.stride_time,
        )
        self._slope[index] = gait_rig.options.slope

    def reset(self, mask: Mask) -> None:
        """Forget what was estimated of simulations that start anew, at heel strike."""
        self._in_stance[mask], self._time_since_strike[mask], self._stride_time[mask] = (
            False,
            0.0,
            self._nominal_stride_time[mask],
        )

    def measure_load(self, sensordata: Array) -> Array:
        """(n,) compression of the pylon [body weights]."""
        return np.asarray(-sensordata[:, self._load_cell_index] / self._body_weight)

    def estimate_phase(self) -> Array:
        """(n,) estimated phase (0-1)."""
        return np.asarray(np.minimum(self._time_since_strike / self._stride_time, 1.0))

    def update_phase(self, load: Array, mask: Mask) -> None:
        """An interval later: time since the last foot strike over the time between the last two."""
        self._time_since_strike += self._interval * mask
        strikes = mask & ~self._in_stance & (load > FOOT_STRIKE_LOAD_BW)
        if strikes.any():
            # A bounce within the stride is no stride. The wearer's cadence is known well enough to tell.
            counts = strikes & (self._time_since_strike > MIN_STRIDE_FRACTION * self._nominal_stride_time)
            self._stride_time = np.where(
                counts,
                np.minimum(self._time_since_strike, MAX_STRIDE_FRACTION * self._nominal_stride_time),
                self._stride_time,
            )
            self._time_since_strike = np.where(
                counts | (strikes & (self._time_since_strike < FIRST_STRIKE_FRACTION * self._nominal_stride_time)),
                0.0,
                self._time_since_strike,
            )
        self._in_stance = np.where(
            mask, load > np.where(self._in_stance, TOE_OFF_LOAD_BW, FOOT_STRIKE_LOAD_BW), self._in_stance
        )

    def read(self, qpos: Array, qvel: Array, act: Array, sensordata: Array) -> tuple[Array, ...]:
        """Columns of (n,) in the order of :class:`~klute_sim.controllers.feedback.Sensed`, pressure in bar.

        Inclination is to gravity, as an inertial sensor has it; the model's is to the ground's normal.
        """
        return (
            -qpos[:, self._ankle_qpos_index],
            -qvel[:, self._ankle_dof_index],
            qpos[:, 2] + qpos[:, 3] - self._slope,
            qvel[:, 2] + qvel[:, 3],
            self.measure_load(sensordata),
            act[:, self._pressure_index],
            self.estimate_phase(),
        )


def to_sensor_readings(columns: tuple[Array, ...]) -> SensorReadings:
    """Of one simulation, from :meth:`Senses.read`."""
    angle, rate, shank, shank_rate, load, bar, phase = (float(column[0]) for column in columns)
    return SensorReadings(angle, rate, shank, shank_rate, load, bar * BAR, phase)
