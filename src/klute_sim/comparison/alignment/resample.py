"""Resampling of strides to 0 to 100 % of the gait cycle, and of whole recordings to common times.

Interpolation between samples is linear. A missing sample (NaN) makes the interpolated points on both sides missing, and
long gaps in the sample times are not interpolated.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording
from klute_sim.types import Array

PHASE_CHANNEL, STRIDE_CHANNEL, TIME_CHANNEL = "gait_phase", "stride", "time"
"""Names of the axis channels."""
PHASE_GRID: Array = np.linspace(0.0, 100.0, 101)
"""Gait phases [%] of resampled strides, as usual in gait analysis."""
MAX_MISSING_PHASE = 2.0
"""Largest gait phase [%] that a complete stride may lack at either end."""
MAX_EXTRAPOLATION = 1.5
"""Longest extrapolation beyond the outermost sample of a stride, in median sampling intervals; heel strikes fall
between samples."""
MAX_GAP_INTERVALS = 10.0
"""Longest gap that is interpolated, in median sampling intervals."""
MAX_TIME_POINTS = 20_000
"""Largest number of points on a common time axis."""


@dataclass(frozen=True, eq=False)
class StrideSamples:
    """Samples of one stride in a recording."""

    number: int
    """Number of the stride in its recording, starting at 1."""
    begin: int
    """Index of the first sample."""
    end: int
    """Index after the last sample."""
    first_phase: float
    """Gait phase of the first sample [%]."""
    last_phase: float
    """Gait phase of the last sample [%]."""

    @property
    def is_complete(self) -> bool:
        """Whether the samples reach from heel strike to heel strike, except for :data:`MAX_MISSING_PHASE`."""
        return self.first_phase <= MAX_MISSING_PHASE and self.last_phase >= 100.0 - MAX_MISSING_PHASE


def find_strides(recording: Recording, recording_name: str) -> list[StrideSamples]:
    """Return all strides of ``recording``, separated by the channel ``stride``, or where the gait phase decreases.

    Raises InputError without a gait phase [%] that increases in every stride.
    """
    if PHASE_CHANNEL not in recording:
        raise InputError(
            f"{recording_name} has neither a column 'gait_phase [%]' nor a 'grf_vertical' that shows a stride; a "
            "comparison over phase needs one of them"
        )
    if recording.units[PHASE_CHANNEL] != "%":
        raise InputError(f"{recording_name}: gait_phase is in '{recording.units[PHASE_CHANNEL]}'; allowed: %")
    phase = recording[PHASE_CHANNEL]
    if not (np.isfinite(phase).all() and phase.min() >= 0.0 and phase.max() <= 100.0):
        raise InputError(f"{recording_name}: gait_phase has a missing sample or one outside 0 to 100 %")
    starts = np.diff(recording[STRIDE_CHANNEL]) != 0.0 if STRIDE_CHANNEL in recording else np.diff(phase) < 0.0
    edges = [0, *(np.flatnonzero(starts) + 1).tolist(), len(phase)]
    strides = []
    for number, (begin, end) in enumerate(itertools.pairwise(edges), start=1):
        decreases = np.flatnonzero(np.diff(phase[begin:end]) <= 0.0)
        if len(decreases):
            row = begin + int(decreases[0]) + 1
            raise InputError(
                f"{recording_name}: gait_phase does not increase at {recording[TIME_CHANNEL][row]:.6g} s, in stride "
                f"{number}; it must increase from sample to sample of a stride"
            )
        strides.append(StrideSamples(number, begin, end, float(phase[begin]), float(phase[end - 1])))
    return strides


def resample_phase(recording: Recording, stride: StrideSamples, channel: str) -> Array:
    """Return ``channel`` of one ``stride`` at :data:`PHASE_GRID`; NaN where it cannot be interpolated.

    Heel strikes mostly fall between two samples. Therefore the nearest samples of adjacent strides are included if they
    follow without a gap; otherwise the outermost line is extrapolated by less than :data:`MAX_EXTRAPOLATION` intervals.
    """
    phase, time = recording[PHASE_CHANNEL], recording[TIME_CHANNEL]
    max_interval = MAX_EXTRAPOLATION * float(np.median(np.diff(time)))
    begin, end = stride.begin, stride.end
    x, y = [phase[begin:end]], [recording[channel][begin:end]]
    # A stride may end with a sample at 100 % at the same instant at which the next stride begins with 0 %.
    if begin > 0 and time[begin] - time[begin - 1] < max_interval and phase[begin - 1] - 100.0 < stride.first_phase:
        x, y = [phase[begin - 1 : begin] - 100.0, *x], [recording[channel][begin - 1 : begin], *y]
    if end < len(phase) and time[end] - time[end - 1] < max_interval and phase[end] + 100.0 > stride.last_phase:
        x, y = [*x, phase[end : end + 1] + 100.0], [*y, recording[channel][end : end + 1]]
    return _interpolate(PHASE_GRID, np.concatenate(x), np.concatenate(y), max_extrapolation=MAX_EXTRAPOLATION)


def make_common_time(recordings: Sequence[tuple[str, Recording]]) -> Array:
    """Return uniform times [s] in the overlap of all ``recordings`` (name, recording), at the coarsest median interval.

    The interval is larger if there would be more than :data:`MAX_TIME_POINTS` points. Raises InputError without an
    overlap.
    """
    last_start = max(recordings, key=lambda r: r[1][TIME_CHANNEL][0])
    first_end = min(recordings, key=lambda r: r[1][TIME_CHANNEL][-1])
    begin, end = float(last_start[1][TIME_CHANNEL][0]), float(first_end[1][TIME_CHANNEL][-1])
    if not end > begin:
        raise InputError(
            f"{first_end[0]} ends at {end:.6g} s and {last_start[0]} begins at {begin:.6g} s; allowed are recordings "
            "that overlap in time"
        )
    time_step = max(float(np.median(np.diff(recording[TIME_CHANNEL]))) for _, recording in recordings)
    time_step = max(time_step, (end - begin) / (MAX_TIME_POINTS - 1))
    n_points = int((end - begin) / time_step * (1.0 + 1e-12)) + 1
    if n_points < 2:
        raise InputError(
            f"{last_start[0]} and {first_end[0]} overlap from {begin:.6g} to {end:.6g} s, less than one sampling "
            f"interval of {time_step:.6g} s; allowed are recordings with a longer overlap"
        )
    return np.asarray(np.minimum(begin + time_step * np.arange(n_points), end))


def resample_time(recording: Recording, channel: str, time: Array) -> Array:
    """Return ``channel`` at ``time`` [s]; NaN outside the recording."""
    return _interpolate(time, recording[TIME_CHANNEL], recording[channel], max_extrapolation=0.0)


def _interpolate(grid: Array, x: Array, y: Array, *, max_extrapolation: float) -> Array:
    """Interpolate ``y`` at increasing ``x`` linearly at ``grid``.

    The outermost lines are extrapolated by less than ``max_extrapolation`` median intervals of ``x``.
    """
    if len(x) < 2:
        return np.full(grid.shape, np.nan)
    result = np.interp(grid, x, y, left=np.nan, right=np.nan)
    interval = float(np.median(np.diff(x)))
    after = np.clip(np.searchsorted(x, grid, side="left"), 1, len(x) - 1)
    in_gap = (x[after] - x[after - 1] > MAX_GAP_INTERVALS * interval) & (grid != x[after]) & (grid != x[after - 1])
    result[in_gap] = np.nan
    for outside, near, far in ((grid < x[0], 0, 1), (grid > x[-1], -1, -2)):
        extrapolated = outside & (np.abs(grid - x[near]) < max_extrapolation * interval)
        slope_fraction = (grid[extrapolated] - x[near]) / (x[near] - x[far])
        result[extrapolated] = y[near] + (y[near] - y[far]) * slope_fraction
    return result
