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

from klute_sim.dataset.channels import LOADED
from klute_sim.dataset.trial import Series
from klute_sim.errors import InputError
from klute_sim.rigs.replay.rollout import Array, Inputs

CUTOFF = 20.0
"""Of the low-pass that motion is smoothed with before it is differentiated [Hz] (assumed: above the 6 to 10 Hz that
are used for markers, so that less of a foot strike is lost)."""
SLOWEST = 0.02
"""Longest time between samples of the motion [s], for that low-pass."""


class Prescribed(NamedTuple):
    """What a trial prescribes, at any time."""

    angle: CubicSpline
    x: CubicSpline
    z: CubicSpline
    ground: Series
    """Moment of the ground reaction about the ankle [N.m], plantarflexing positive."""
    along: Series
    across: Series
    """See :class:`~klute_sim.rigs.replay.rollout.Inputs` [N]."""
    vertical: Series
    """Load [N]."""
    command: Series
    """Pressure [Pa]."""
    begin: float
    end: float
    """Where all of it is known [s]."""

    def inputs(self, time: Array) -> Inputs:
        """At ``time`` [s]."""
        return Inputs(
            angle=self.angle(time),
            turning=self.angle(time, 2),
            forward=self.x(time, 2),
            upward=self.z(time, 2),
            ground=np.interp(time, self.ground.time, self.ground.value),
            along=np.interp(time, self.along.time, self.along.value),
            across=np.interp(time, self.across.time, self.across.value),
            command=np.interp(time, self.command.time, self.command.value),
        )

    def strikes(self) -> Array:
        """Times [s] at which the foot comes to carry load."""
        return self._crossings(+1)

    def lifts(self) -> Array:
        """Times [s] at which it no longer does."""
        return self._crossings(-1)

    def _crossings(self, sign: int) -> Array:
        change = np.diff((self.vertical.value > LOADED).astype(int))
        return np.asarray(self.vertical.time[1:][change == sign])


def prescribed(channels: Mapping[str, Series], where: str, *, cutoff: float = CUTOFF) -> Prescribed:
    """What ``channels`` (:data:`klute_sim.dataset.channels.PRESCRIBED` of a gait trial) prescribe.

    Motion is low-passed at ``cutoff`` [Hz].

    Raises InputError for motion that is sampled too slowly, or a foot that never carries load; ``where`` names the
    trial.
    """
    motion = {}
    for name in ("shank_angle", "ankle_x", "ankle_z"):
        series = channels[name]
        if series.interval > SLOWEST:
            raise InputError(
                f"{where}: '{name}' has {1.0 / series.interval:.0f} samples a second; a replay needs "
                f"{1.0 / SLOWEST:.0f} or more, because the foot is moved by the ankle's acceleration"
            )
        motion[name] = _smooth(series, cutoff)
    vertical, forward, cop = (channels[name] for name in ("grf_vertical", "grf_forward", "cop_x"))
    if not (vertical.value > LOADED).any():
        raise InputError(f"{where}: 'grf_vertical' is never above {LOADED:g} N: the foot has to stand on the ground")
    known = np.isfinite(cop.value)
    place = np.interp(vertical.time, cop.time[known], cop.value[known])
    lever = np.where(vertical.value > LOADED, place - motion["ankle_x"](vertical.time), 0.0)
    ahead = np.interp(vertical.time, forward.time, forward.value)
    moment = -motion["ankle_z"](vertical.time) * ahead - lever * vertical.value
    sine, cosine = np.sin(motion["shank_angle"](vertical.time)), np.cos(motion["shank_angle"](vertical.time))
    return Prescribed(
        angle=motion["shank_angle"],
        x=motion["ankle_x"],
        z=motion["ankle_z"],
        ground=Series(vertical.time, np.asarray(moment)),
        along=Series(vertical.time, np.asarray(cosine * vertical.value + sine * ahead)),
        across=Series(vertical.time, np.asarray(sine * vertical.value - cosine * ahead)),
        vertical=vertical,
        command=channels["pressure_command"],
        begin=float(max(series.time[0] for series in channels.values())),
        end=float(min(series.time[-1] for series in channels.values())),
    )


def _smooth(series: Series, cutoff: float) -> CubicSpline:
    """Through the low-passed samples, on a clock of equal steps."""
    interval = series.interval
    clock = np.arange(series.time[0], series.time[-1] + 0.5 * interval, interval)
    even = np.interp(clock, series.time, series.value)
    # Rows of sections: a cutoff that is low against the sampling would make one long filter inexact.
    filter_ = butter(2, cutoff * 2.0 * interval, output="sos")
    return CubicSpline(clock, sosfiltfilt(filter_, even, padlen=min(len(even) - 1, round(0.1 / interval))))
