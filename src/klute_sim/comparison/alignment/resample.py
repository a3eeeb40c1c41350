"""Recordings on one axis: every stride on 0 to 100 % of the gait cycle, or whole recordings on their common time.

Values between samples are on a straight line between them. A sample that is missing (NaN) takes the points on both
sides of it with it, and a hole in the clock is no line: nothing is made up.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.errors import InputError
from klute_sim.recording.recording import Array, Recording

PHASE_CHANNEL, STRIDE_CHANNEL, TIME_CHANNEL = "gait_phase", "stride", "time"

PHASE_GRID: Array = np.linspace(0.0, 100.0, 101)
"""Phases [%] that strides are compared at, as is usual in gait analysis."""
MAX_MISSING_PHASE = 2.0
"""Phase [%] that the samples of a whole stride may lack at either end."""
MAX_EXTRAPOLATION = 1.5
"""Usual intervals that the line goes on beyond the outermost sample of a stride: heel strike is between samples."""
MAX_GAP = 10.0
"""Usual intervals without a sample that no line is drawn across."""
MAX_TIME_POINTS = 20_000
"""Of a common time axis."""


@dataclass(frozen=True, eq=False)
class StrideSamples:
    """Samples of one stride."""

    number: int
    """Counted from 1 in its recording."""
    begin: int
    """Index of its first sample."""
    end: int
    """Index behind its last sample."""
    first_phase: float
    """Phase of the first sample [%]."""
    last_phase: float
    """Phase of the last sample [%]."""

    @property
    def is_complete(self) -> bool:
        """Whether its samples reach from heel strike to heel strike, but for :data:`EDGE`."""
        return self.first_phase <= MAX_MISSING_PHASE and self.last_phase >= 100.0 - MAX_MISSING_PHASE


def find_strides(recording: Recording, recording_name: str) -> list[StrideSamples]:
    """The strides of ``recording``, whole or not: by ``stride`` if it has that, else wherever the phase falls.

    Raises InputError, which names the recording as ``where``, without a phase [%] that rises in every stride.
    """
    if PHASE_CHANNEL not in recording:
        raise InputError(
            f"{recording_name} has no column 'gait_phase [%]', and no 'grf_vertical' that shows a stride; over phase, one of "
            "these is needed"
        )
    if recording.units[PHASE_CHANNEL] != "%":
        raise InputError(f"{recording_name}: gait_phase is in '{recording.units[PHASE_CHANNEL]}'; allowed: %")
    phase = recording[PHASE_CHANNEL]
    if not (np.isfinite(phase).all() and phase.min() >= 0.0 and phase.max() <= 100.0):
        raise InputError(
            f"{recording_name}: gait_phase has a missing sample or one beyond 0 to 100 %; every sample needs one"
        )
    new = np.diff(recording[STRIDE_CHANNEL]) != 0.0 if STRIDE_CHANNEL in recording else np.diff(phase) < 0.0
    edges = [0, *(np.flatnonzero(new) + 1).tolist(), len(phase)]
    found = []
    for number, (begin, end) in enumerate(itertools.pairwise(edges), start=1):
        falls = np.flatnonzero(np.diff(phase[begin:end]) <= 0.0)
        if len(falls):
            row = begin + int(falls[0]) + 1
            raise InputError(
                f"{recording_name}: gait_phase does not rise at {recording[TIME_CHANNEL][row]:.6g} s, in stride {number}; it must rise "
                "from sample to sample of a stride"
            )
        found.append(StrideSamples(number, begin, end, float(phase[begin]), float(phase[end - 1])))
    return found


def resample_phase(recording: Recording, stride: StrideSamples, channel: str) -> Array:
    """``channel`` of one ``stride`` at :data:`PHASE_GRID`; NaN where there is nothing to tell it from.

    Heel strikes mostly fall between two samples: the neighbouring strides' nearest samples are taken in, where they
    follow without a pause; otherwise the outermost line goes on, for less than :data:`OUTSIDE` intervals.
    """
    phase, time = recording[PHASE_CHANNEL], recording[TIME_CHANNEL]
    usual = float(np.median(np.diff(time)))
    begin, end = stride.begin, stride.end
    x, y = [phase[begin:end]], [recording[channel][begin:end]]
    # A stride may end with a sample at 100 % that the next begins with at 0 %: that one is the same instant.
    if (
        begin > 0
        and time[begin] - time[begin - 1] < MAX_EXTRAPOLATION * usual
        and phase[begin - 1] - 100.0 < stride.first_phase
    ):
        x, y = [phase[begin - 1 : begin] - 100.0, *x], [recording[channel][begin - 1 : begin], *y]
    if (
        end < len(phase)
        and time[end] - time[end - 1] < MAX_EXTRAPOLATION * usual
        and phase[end] + 100.0 > stride.last_phase
    ):
        x, y = [*x, phase[end : end + 1] + 100.0], [*y, recording[channel][end : end + 1]]
    return _interpolate(PHASE_GRID, np.concatenate(x), np.concatenate(y), max_extrapolation=MAX_EXTRAPOLATION)


def make_common_time(recordings: Sequence[tuple[str, Recording]]) -> Array:
    """Evenly spaced times [s] that all ``recordings`` (name, recording) span, at the usual interval of the coarsest.

    Coarser still where that would be more than :data:`MOST_POINTS`. Raises InputError if they have no time in common.
    """
    first, last = (
        max(recordings, key=lambda r: r[1][TIME_CHANNEL][0]),
        min(recordings, key=lambda r: r[1][TIME_CHANNEL][-1]),
    )
    begin, end = float(first[1][TIME_CHANNEL][0]), float(last[1][TIME_CHANNEL][-1])
    if not end > begin:
        raise InputError(
            f"{last[0]} ends at {end:.6g} s and {first[0]} begins at {begin:.6g} s; allowed are recordings that "
            "overlap in time"
        )
    step = max(float(np.median(np.diff(recording[TIME_CHANNEL]))) for _, recording in recordings)
    step = max(step, (end - begin) / (MAX_TIME_POINTS - 1))
    count = int((end - begin) / step * (1.0 + 1e-12)) + 1
    if count < 2:
        raise InputError(
            f"{first[0]} and {last[0]} overlap from {begin:.6g} to {end:.6g} s, less than one sampling interval of "
            f"{step:.6g} s; allowed are recordings that overlap for longer"
        )
    return np.asarray(np.minimum(begin + step * np.arange(count), end))


def resample_time(recording: Recording, channel: str, time: Array) -> Array:
    """``channel`` at the times ``axis`` [s]; NaN outside of the recording."""
    return _interpolate(time, recording[TIME_CHANNEL], recording[channel], max_extrapolation=0.0)


def _interpolate(grid: Array, x: Array, y: Array, *, max_extrapolation: float) -> Array:
    """Straight lines between samples ``y`` at rising ``x``; the outermost go on for less than ``outside`` intervals."""
    if len(x) < 2:
        return np.full(grid.shape, np.nan)
    found = np.interp(grid, x, y, left=np.nan, right=np.nan)
    usual = float(np.median(np.diff(x)))
    after = np.clip(np.searchsorted(x, grid, side="left"), 1, len(x) - 1)
    hole = (x[after] - x[after - 1] > MAX_GAP * usual) & (grid != x[after]) & (grid != x[after - 1])
    found[hole] = np.nan
    for beyond, near, far in ((grid < x[0], 0, 1), (grid > x[-1], -1, -2)):
        reached = beyond & (np.abs(grid - x[near]) < max_extrapolation * usual)
        found[reached] = y[near] + (y[near] - y[far]) * ((grid[reached] - x[near]) / (x[near] - x[far]))
    return found
