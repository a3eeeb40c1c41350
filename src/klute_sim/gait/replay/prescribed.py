"""Prepare the measured motion and load of a trial for a replay.

The moment of the ground reaction about the ankle is ``-z F_x - (x_cop - x) F_z`` (plantarflexion positive; ``x`` and
``z`` are the position of the ankle over the ground). It is interpolated linearly between samples of the load. A
position of the ankle that was computed from the limb does not contain the displacement ``d`` of the limb in its socket.
The ankle is then ``d (sin t, cos t)`` away from it (``t``: inclination of the shank), and the moment increases by ``d
(F_z sin t - F_x cos t)``: the ground reaction across the pylon times ``d``. Where the pylon leans forward by ``e`` more
than the limb, about a point at the height ``h``, the ankle lies ``h e`` further back, and the moment changes by ``-h e
(F_z cos t + F_x sin t)``: the ground reaction along the pylon times this distance.

Accelerations are second derivatives of the motion after a zero-lag low-pass filter, as usual for markers (Winter,
Biomechanics and Motor Control of Human Movement, 4th ed. 2009, section 3.4). They only move 0.8 kg of foot.

While the foot is in the air it has no load: what the plate reads then is noise.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD, MOTION_CHANNELS
from klute_sim.datasets.foot_load import find_loaded_samples, interpolate_load_mask
from klute_sim.datasets.trial import TimeSeries
from klute_sim.errors import InputError
from klute_sim.gait.replay.rollout import ReplayInputs
from klute_sim.types import Array, Mask

MAX_LEVER_DEVIATION = 0.3
"""Largest distance of the centre of pressure from its median position under the foot [m] (assumed: a foot is about as
long)."""
PASS_CUTOFF_HZ = 20.0
"""Cutoff frequency of each pass, forward and backward, of the low-pass filter for motion before differentiation [Hz].

Both passes together halve a motion at this frequency; their cutoff (-3 dB) is 0.802 of it, 16 Hz (assumed: above the
usual 6 to 10 Hz for markers, so that less of a foot strike is lost)."""


class PrescribedMotion(NamedTuple):
    """Prescribed motion and load of a trial as functions of time."""

    shank_angle: CubicSpline
    """Inclination of the shank, forward positive [rad]."""
    ankle_x: CubicSpline
    """Forward position of the ankle [m]."""
    ankle_z: CubicSpline
    """Height of the ankle [m]."""
    ground_moment: TimeSeries
    """Moment of the ground reaction about the ankle, plantarflexion positive [N.m]."""
    axial_force: TimeSeries
    """Ground reaction along the pylon, up positive [N]."""
    shear_force: TimeSeries
    """Ground reaction across the pylon, backward positive [N]."""
    vertical_load: TimeSeries
    """Vertical ground reaction [N]; 0 where the foot is in the air."""
    pressure_command: TimeSeries
    """Commanded gauge pressure [Pa]."""
    start_time: float
    """First time at which all channels are known [s]."""
    end_time: float
    """Last time at which all channels are known [s]."""

    def interpolate(self, time: Array) -> ReplayInputs:
        """Return the inputs of a replay at ``time`` [s]."""
        return ReplayInputs(
            shank_angle=self.shank_angle(time),
            shank_angular_acceleration=self.shank_angle(time, 2),
            ankle_acceleration_x=self.ankle_x(time, 2),
            ankle_acceleration_z=self.ankle_z(time, 2),
            ground_moment=np.interp(time, self.ground_moment.time, self.ground_moment.value),
            axial_force=np.interp(time, self.axial_force.time, self.axial_force.value),
            shear_force=np.interp(time, self.shear_force.time, self.shear_force.value),
            pressure_command=np.interp(time, self.pressure_command.time, self.pressure_command.value),
        )

    def find_foot_strikes(self) -> Array:
        """Return the times [s] at which the foot becomes loaded."""
        return self._find_load_crossings(+1)

    def find_toe_offs(self) -> Array:
        """Return the times [s] at which the foot becomes unloaded."""
        return self._find_load_crossings(-1)

    def _find_load_crossings(self, direction: int) -> Array:
        change = np.diff((self.vertical_load.value > 0.0).astype(int))
        return np.asarray(self.vertical_load.time[1:][change == direction])


def prepare_prescribed_motion(
    channels: Mapping[str, TimeSeries], source: str, *, pass_cutoff: float = PASS_CUTOFF_HZ, alignment: float = 0.0
) -> PrescribedMotion:
    """Return the prescribed motion and load of a gait trial.

    ``channels`` are :data:`klute_sim.datasets.channels.PRESCRIBED_CHANNELS` of a gait trial, whose motion has at most
    :data:`klute_sim.datasets.channels.MAX_MOTION_INTERVAL` between samples. Motion is low-pass filtered forward and
    backward, with the cutoff ``pass_cutoff`` [Hz] in each pass. ``alignment`` [rad] is that of the pylon to the limb,
    dorsiflexion positive; the shank of a replay is the pylon. ``source`` names the trial in errors.

    Raises InputError when the foot is never loaded, or its centre of pressure is unknown.
    """
    motion = {}
    for name in MOTION_CHANNELS:
        motion[name] = _fit_low_pass_spline(channels[name], pass_cutoff)
    shank = motion["shank_angle"]
    motion["shank_angle"] = CubicSpline(shank.x, shank(shank.x) - alignment)
    vertical, forward, cop = (channels[name] for name in ("grf_vertical", "grf_forward", "cop_x"))
    is_loaded = find_loaded_samples(vertical.value)
    if not is_loaded.any():
        raise InputError(
            f"{source}: 'grf_vertical' is never above {CONTACT_FORCE_THRESHOLD:g} N: the foot must stand on the ground"
        )
    vertical_force = np.where(is_loaded, vertical.value, 0.0)
    forward_force = np.where(is_loaded, np.interp(vertical.time, forward.time, forward.value), 0.0)
    is_cop_loaded = interpolate_load_mask(cop.time, vertical.time, is_loaded)
    lever = _compute_lever(vertical.time, cop, motion["ankle_x"], is_cop_loaded, source)
    moment = -motion["ankle_z"](vertical.time) * forward_force - lever * vertical_force
    sine, cosine = np.sin(motion["shank_angle"](vertical.time)), np.cos(motion["shank_angle"](vertical.time))
    return PrescribedMotion(
        shank_angle=motion["shank_angle"],
        ankle_x=motion["ankle_x"],
        ankle_z=motion["ankle_z"],
        ground_moment=TimeSeries(vertical.time, np.asarray(moment)),
        axial_force=TimeSeries(vertical.time, np.asarray(cosine * vertical_force + sine * forward_force)),
        shear_force=TimeSeries(vertical.time, np.asarray(sine * vertical_force - cosine * forward_force)),
        vertical_load=TimeSeries(vertical.time, vertical_force),
        pressure_command=channels["pressure_command"],
        start_time=float(max(series.time[0] for series in channels.values())),
        end_time=float(min(series.time[-1] for series in channels.values())),
    )


def _compute_lever(time: Array, cop: TimeSeries, ankle_x: CubicSpline, is_loaded: Mask, source: str) -> Array:
    """Return the distance [m] of the centre of pressure in front of the ankle at each ``time`` [s].

    ``is_loaded`` belongs to the samples of ``cop``. Plates write 0, or a point far from the foot, while the load is
    small; such samples are interpolated. Raises InputError where the distance is unknown whenever the foot is loaded.
    """
    is_known = is_loaded & np.isfinite(cop.value) & (cop.time >= ankle_x.x[0]) & (cop.time <= ankle_x.x[-1])
    if not is_known.any():
        raise InputError(
            f"{source}: no sample of 'cop_x' lies in the time in which the foot is loaded and 'ankle_x' is known, so "
            "the moment of the load about the ankle is unknown"
        )
    if cop.value[is_known].any():
        is_known &= cop.value != 0.0
    lever = cop.value[is_known] - ankle_x(cop.time[is_known])
    is_under_foot = np.abs(lever - np.median(lever)) <= MAX_LEVER_DEVIATION
    return np.asarray(np.interp(time, cop.time[is_known][is_under_foot], lever[is_under_foot]))


def _fit_low_pass_spline(series: TimeSeries, pass_cutoff: float) -> CubicSpline:
    """Return a spline through the low-pass filtered samples at equal intervals."""
    interval = series.sampling_interval
    time = np.arange(series.time[0], series.time[-1] + 0.5 * interval, interval)
    values = np.interp(time, series.time, series.value)
    # Second-order sections: with a cutoff far below the sampling rate, a single long filter would be inexact.
    sections = butter(2, pass_cutoff * 2.0 * interval, output="sos")
    return CubicSpline(time, sosfiltfilt(sections, values, padlen=min(len(values) - 1, round(0.1 / interval))))
