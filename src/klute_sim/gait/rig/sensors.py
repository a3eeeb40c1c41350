"""Sensors of the prosthesis on the gait rig, for many simulations at once.

All quantities are arrays with one entry per simulation, so that one gait run and a batch use the same code.
"""

import numpy as np

from klute_sim.constants import GRAVITY
from klute_sim.controllers.feedback import SensorReadings
from klute_sim.gait.body import PROSTHESIS_PREFIX
from klute_sim.gait.rig.setup import GaitRig
from klute_sim.types import Array, Mask
from klute_sim.units import BAR

FOOT_STRIKE_LOAD_BW, TOE_OFF_LOAD_BW = 0.10, 0.05
"""Loads [body weights] above which a foot strike and below which a toe-off is detected."""
MIN_STRIDE_FRACTION, MAX_STRIDE_FRACTION, FIRST_STRIKE_FRACTION = 0.6, 1.6, 0.1
"""Fractions of the nominal stride time: the shortest and the longest estimate of a stride time, and the
time until which a foot strike belongs to the first stride."""


class ProsthesisSensors:
    """Sensors of ``n_simulations`` simulations, with an estimate of the gait phase."""

    def __init__(self, gait_rig: GaitRig, n_simulations: int, interval: float) -> None:
        """Read the sensors of ``gait_rig`` every ``interval`` [s]; its stride time is the nominal one."""
        model, joint = gait_rig.model, gait_rig.model.joint(PROSTHESIS_PREFIX + "ankle")
        self._ankle_qpos_index, self._ankle_dof_index = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._load_cell_index = int(model.sensor(PROSTHESIS_PREFIX + "load_cell").adr[0]) + 2
        self._pressure_index, self._interval = gait_rig.actuator.act_address, interval
        self._body_weight = np.empty(n_simulations)
        self._nominal_stride_time = np.empty(n_simulations)
        self._slope = np.empty(n_simulations)
        self.assign_gait_rig(slice(None), gait_rig)
        self._in_stance: Mask = np.zeros(n_simulations, dtype=np.bool_)
        self._time_since_strike = np.zeros(n_simulations)
        self._stride_time = self._nominal_stride_time.copy()

    def assign_gait_rig(self, index: int | slice, gait_rig: GaitRig) -> None:
        """Assign ``gait_rig`` (another subject or ground) to the simulations ``index``, from their next reset on."""
        self._body_weight[index] = gait_rig.options.mass * GRAVITY
        self._nominal_stride_time[index] = gait_rig.trajectory.stride_time
        self._slope[index] = gait_rig.options.slope

    def reset(self, mask: Mask) -> None:
        """Forget the estimates of the simulations in ``mask``, which restart at heel strike."""
        self._in_stance[mask], self._time_since_strike[mask] = False, 0.0
        self._stride_time[mask] = self._nominal_stride_time[mask]

    def measure_load(self, sensordata: Array) -> Array:
        """Return the compression (n,) of the pylon [body weights]."""
        return np.asarray(-sensordata[:, self._load_cell_index] / self._body_weight)

    def estimate_phase(self) -> Array:
        """Return the estimated gait phase (n,), 0 to 1."""
        return np.asarray(np.minimum(self._time_since_strike / self._stride_time, 1.0))

    def update_phase(self, load: Array, mask: Mask) -> None:
        """Update the phase one interval later: time since the last foot strike over the time between the last two."""
        self._time_since_strike += self._interval * mask
        strikes = mask & ~self._in_stance & (load > FOOT_STRIKE_LOAD_BW)
        if strikes.any():
            # A bounce is not a new stride; the nominal stride time is accurate enough to distinguish them.
            nominal = self._nominal_stride_time
            new_strides = strikes & (self._time_since_strike > MIN_STRIDE_FRACTION * nominal)
            stride_time = np.minimum(self._time_since_strike, MAX_STRIDE_FRACTION * nominal)
            self._stride_time = np.where(new_strides, stride_time, self._stride_time)
            first_strikes = strikes & (self._time_since_strike < FIRST_STRIKE_FRACTION * nominal)
            self._time_since_strike = np.where(new_strides | first_strikes, 0.0, self._time_since_strike)
        threshold = np.where(self._in_stance, TOE_OFF_LOAD_BW, FOOT_STRIKE_LOAD_BW)
        self._in_stance = np.where(mask, load > threshold, self._in_stance)

    def read(self, qpos: Array, qvel: Array, act: Array, sensordata: Array) -> tuple[Array, ...]:
        """Return columns (n,) in the order of :class:`~klute_sim.controllers.feedback.SensorReadings`, pressure in bar.

        Inclinations are relative to gravity, as for an inertial sensor; those of the model are relative to the normal
        of the ground.
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
    """Return the readings of one simulation from the columns of :meth:`ProsthesisSensors.read`."""
    angle, rate, shank_angle, shank_rate, load, pressure_bar, phase = (float(column[0]) for column in columns)
    return SensorReadings(angle, rate, shank_angle, shank_rate, load, pressure_bar * BAR, phase)
