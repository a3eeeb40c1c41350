"""A measured trial beside its replays, with corrections of its inputs that a mistake in the recording would need."""

from collections.abc import Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np

from klute_sim.datasets.channels import MOTION_CHANNELS
from klute_sim.datasets.trial import COMMAND_CHANNEL, TimeSeries, Trial
from klute_sim.errors import KluteSimError
from klute_sim.gait.replay.foot import build_replayed_foot
from klute_sim.gait.replay.prescribed import prepare_prescribed_motion
from klute_sim.gait.replay.rollout import simulate_replay
from klute_sim.gait.rig.build import get_alignment
from klute_sim.laws.foot import Foot
from klute_sim.types import Array

PLATE_CHANNELS = ("grf_vertical", "grf_forward", "cop_x")
"""Channels of the force plate."""
LABORATORY_MOMENT = "ankle_moment"
"""Measured channel that a laboratory computes from markers and plate."""
TIME_STEP = 1e-3
"""Time step of the replays [s]: waveforms, not noise, are compared."""
WARM_UP_TIME, END_TIME = 0.5, 0.06
"""Times at the start and at the end of a replay [s] that are not compared: its start at rest, and the edge of the
filter of the motion."""
MIN_COMPARED_SAMPLES = 10
"""Fewest samples of a channel that are compared."""


class Residual(NamedTuple):
    """Measured minus simulated samples of one channel, over the range of the measured ones."""

    rms: float
    """RMS with the difference of the levels."""
    rms_without_offset: float
    """RMS without this difference, for sensors whose zero is unknown."""
    unexplained: float
    """Share of the variance that no linear relation to the simulation explains; 1 and more for a negative one."""


class MeasuredTrial:
    """A trial whose replays are compared with its force, and with its ankle angle or muscle length."""

    def __init__(self, trial: Trial) -> None:
        """Prepare the replays of ``trial``."""
        self.trial = trial
        self.log_channels = _list_log_channels(trial)
        self._results: dict[tuple[float, float, float], dict[str, Residual]] = {}

    @cached_property
    def _foot(self) -> Foot:
        return build_replayed_foot(self.trial.device)

    def compare(
        self, *, plate_delay: float = 0.0, log_delay: float = 0.0, excess_pressure: float = 0.0
    ) -> Mapping[str, Residual]:
        """Return channel -> residual of a replay after corrections; empty where it cannot be simulated.

        ``plate_delay`` [s] is subtracted from the times of the plate, ``log_delay`` [s] from those of the log of the
        device, and ``excess_pressure`` [Pa] from the command.
        """
        key = plate_delay, log_delay, excess_pressure
        if key not in self._results:
            try:
                self._results[key] = self._replay(*key)
            except KluteSimError:  # the preparation of the trial for a diagnosis reports it
                self._results[key] = {}
        return self._results[key]

    def _replay(self, plate_delay: float, log_delay: float, excess_pressure: float) -> dict[str, Residual]:
        trial = self.trial
        delays = dict.fromkeys(PLATE_CHANNELS, plate_delay) | dict.fromkeys(self.log_channels, log_delay)
        channels, measured = (
            {name: TimeSeries(series.time - delays.get(name, 0.0), series.value) for name, series in group.items()}
            for group in (trial.prescribed, trial.measured)
        )
        command = channels[COMMAND_CHANNEL]
        channels[COMMAND_CHANNEL] = TimeSeries(command.time, command.value - excess_pressure)
        alignment = get_alignment(trial.device) or 0.0
        motion = prepare_prescribed_motion(channels, f"trial '{trial.name}'", alignment=alignment)
        time = np.arange(motion.start_time, motion.end_time, TIME_STEP)
        if len(time) == 0:
            return {}
        replay = simulate_replay(trial.device.parameters, self._foot, motion.interpolate(time), TIME_STEP)
        simulated = {"force": replay.tension, "ankle_angle": replay.ankle_angle, "muscle_length": replay.length}
        residuals = {}
        for name, values in simulated.items():
            if name in measured:
                series = measured[name]
                is_compared = (series.time > time[0] + WARM_UP_TIME) & (series.time < time[-1] - END_TIME)
                is_compared &= np.isfinite(series.value)
                if is_compared.sum() >= MIN_COMPARED_SAMPLES:
                    expected = np.interp(series.time[is_compared], time, values)
                    residuals[name] = _measure_residual(series.value[is_compared], expected)
        return residuals


def _list_log_channels(trial: Trial) -> tuple[str, ...]:
    """Return the channels of ``trial`` with the clock of the device: not those in the file of the motion."""
    motion, command = trial.prescribed[MOTION_CHANNELS[0]], trial.prescribed[COMMAND_CHANNEL]
    names = [name for name in trial.measured if name != LABORATORY_MOMENT]
    if not np.array_equal(command.time, motion.time):
        names = [name for name in names if not np.array_equal(trial.measured[name].time, motion.time)]
    return COMMAND_CHANNEL, *names


def _measure_residual(measured: Array, expected: Array) -> Residual:
    """Return the residual of ``measured`` samples; that of a constant one, which tells nothing, is 1."""
    low, high = np.percentile(measured, [2.0, 98.0])
    if high <= low or np.ptp(expected) == 0.0:
        return Residual(1.0, 1.0, 1.0)
    difference = (measured - expected) / (high - low)
    correlation = float(np.corrcoef(measured, expected)[0, 1])
    rms = float(np.sqrt(np.mean(difference**2)))
    return Residual(rms, float(np.std(difference)), 1.0 - correlation * abs(correlation))
