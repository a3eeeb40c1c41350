"""Measured motion and load made ready to be replayed.

The ground's moment about the ankle is ``-z F_x - (x_cop - x) F_z`` (plantarflexing positive, ``x`` and ``z`` the
ankle's place over the ground) and is interpolated linearly between samples of the load. Where that place was reckoned
from the limb, and the limb sinks into its socket by ``d``, the ankle is ``d (sin t, cos t)`` from there (``t`` the
shank's lean), and the moment is ``d (F_z sin t - F_x cos t)`` more: the reaction across the pylon times ``d``.

Accelerations are second derivatives of the motion after a zero-lag low-pass, as is usual for markers (Winter,
Biomechanics and Motor Control of Human Movement, 4th ed. 2009, section 3.4); they only move 0.8 kg of foot.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD
from klute_sim.datasets.trial import Series
from klute_sim.errors import InputError
from klute_sim.gait.replay.rollout import Array, ReplayInputs

CUTOFF_FREQUENCY_HZ = 20.0
"""Of the low-pass that motion is smoothed with before it is differentiated [Hz] (assumed: above the 6 to 10 Hz that
are used for markers, so that less of a foot strike is lost)."""
MAX_SAMPLING_INTERVAL = 0.02
"""Longest time between samples of the motion [s], for that low-pass."""


class PrescribedMotion(NamedTuple):
    """What a trial prescribes, at any time."""

    shank_angle: CubicSpline
    ankle_x: CubicSpline
    ankle_z: CubicSpline
    ground_moment: Series
    """Moment of the ground reaction about the ankle [N.m], plantarflexing positive."""
    axial_force: Series
    shear_force: Series
    """See :class:`~klute_sim.gait.replay.rollout.Inputs` [N]."""
    vertical_load: Series
    """Load [N]."""
    pressure_command: Series
    """Pressure [Pa]."""
    start_time: float
    end_time: float
    """Where all of it is known [s]."""

    def interpolate(self, time: Array) -> ReplayInputs:
        """At ``time`` [s]."""
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
        """Times [s] at which the foot comes to carry load."""
        return self._find_load_crossings(+1)

    def find_toe_offs(self) -> Array:
        """Times [s] at which it no longer does."""
        return self._find_load_crossings(-1)

    def _find_load_crossings(self, direction: int) -> Array:
        change = np.diff((self.vertical_load.value > CONTACT_FORCE_THRESHOLD).astype(int))
        return np.asarray(self.vertical_load.time[1:][change == direction])


def prepare_prescribed_motion(
    channels: Mapping[str, Series], source: str, *, cutoff: float = CUTOFF_FREQUENCY_HZ
) -> PrescribedMotion:
    """What ``channels`` (:data:`klute_sim.datasets.channels.PRESCRIBED` of a gait trial) prescribe.

    Motion is low-passed at ``cutoff`` [Hz].

    Raises InputError for motion that is sampled too slowly, or a foot that never carries load; ``where`` names the
    trial.
    """
    motion = {}
    for name in ("shank_angle", "ankle_x", "ankle_z"):
        series = channels[name]
        if series.sampling_interval > MAX_SAMPLING_INTERVAL:
            raise InputError(
                f"{source}: '{name}' has {1.0 / series.sampling_interval:.0f} samples a second; a replay needs "
                f"{1.0 / MAX_SAMPLING_INTERVAL:.0f} or more, because the foot is moved by the ankle's acceleration"
            )
        motion[name] = _fit_low_pass_spline(series, cutoff)
    vertical, forward, cop = (channels[name] for name in ("grf_vertical", "grf_forward", "cop_x"))
    if not (vertical.value > CONTACT_FORCE_THRESHOLD).any():
        raise InputError(
            f"{source}: 'grf_vertical' is never above {CONTACT_FORCE_THRESHOLD:g} N: the foot has to stand on the ground"
        )
    known = np.isfinite(cop.value)
    place = np.interp(vertical.time, cop.time[known], cop.value[known])
    lever = np.where(vertical.value > CONTACT_FORCE_THRESHOLD, place - motion["ankle_x"](vertical.time), 0.0)
    ahead = np.interp(vertical.time, forward.time, forward.value)
    moment = -motion["ankle_z"](vertical.time) * ahead - lever * vertical.value
    sine, cosine = np.sin(motion["shank_angle"](vertical.time)), np.cos(motion["shank_angle"](vertical.time))
    return PrescribedMotion(
        shank_angle=motion["shank_angle"],
        ankle_x=motion["ankle_x"],
        ankle_z=motion["ankle_z"],
        ground_moment=Series(vertical.time, np.asarray(moment)),
        axial_force=Series(vertical.time, np.asarray(cosine * vertical.value + sine * ahead)),
        shear_force=Series(vertical.time, np.asarray(sine * vertical.value - cosine * ahead)),
        vertical_load=vertical,
        pressure_command=channels["pressure_command"],
        start_time=float(max(series.time[0] for series in channels.values())),
        end_time=float(min(series.time[-1] for series in channels.values())),
    )


def _fit_low_pass_spline(series: Series, cutoff: float) -> CubicSpline:
    """Through the low-passed samples, on a clock of equal steps."""
    interval = series.sampling_interval
    clock = np.arange(series.time[0], series.time[-1] + 0.5 * interval, interval)
    even = np.interp(clock, series.time, series.value)
    # Rows of sections: a cutoff that is low against the sampling would make one long filter inexact.
    filter_ = butter(2, cutoff * 2.0 * interval, output="sos")
    return CubicSpline(clock, sosfiltfilt(filter_, even, padlen=min(len(even) - 1, round(0.1 / interval))))
