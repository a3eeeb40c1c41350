"""Recordings on one axis: every stride on 0 to 100 % of the gait cycle, or whole recordings on their common time.

Values between samples are on a straight line between them. A sample that is missing (NaN) takes the points on both
sides of it with it, and a hole in the clock is no line: nothing is made up.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from klute_sim.errors import InputError
from klute_sim.recording.recording import Recording, Samples

PHASE, STRIDE, TIME = "gait_phase", "stride", "time"

PHASE_GRID: Samples = np.linspace(0.0, 100.0, 101)
"""Phases [%] that strides are compared at, as is usual in gait analysis."""
EDGE = 2.0
"""Phase [%] that the samples of a whole stride may lack at either end."""
OUTSIDE = 1.5
"""Usual intervals that the line goes on beyond the outermost sample of a stride: heel strike is between samples."""
HOLE = 10.0
"""Usual intervals without a sample that no line is drawn across."""
MOST_POINTS = 20_000
"""Of a common time axis."""


@dataclass(frozen=True, eq=False)
class Stride:
    """Samples of one stride."""

    number: int
    """Counted from 1 in its recording."""
    begin: int
    """Index of its first sample."""
    end: int
    """Index behind its last sample."""
    low: float
    """Phase of the first sample [%]."""
    high: float
    """Phase of the last sample [%]."""

    @property
    def whole(self) -> bool:
        """Whether its samples reach from heel strike to heel strike, but for :data:`EDGE`."""
        return self.low <= EDGE and self.high >= 100.0 - EDGE


def strides(recording: Recording, where: str) -> list[Stride]:
    """The strides of ``recording``, whole or not: by ``stride`` if it has that, else wherever the phase falls.

    Raises InputError, which names the recording as ``where``, without a phase [%] that rises in every stride.
    """
    if PHASE not in recording:
        raise InputError(
            f"{where} has no column 'gait_phase [%]', and no 'grf_vertical' that shows a stride; over phase, one of "
            "these is needed"
        )
    if recording.units[PHASE] != "%":
        raise InputError(f"{where}: gait_phase is in '{recording.units[PHASE]}'; allowed: %")
    phase = recording[PHASE]
    if not (np.isfinite(phase).all() and phase.min() >= 0.0 and phase.max() <= 100.0):
        raise InputError(f"{where}: gait_phase has a missing sample or one beyond 0 to 100 %; every sample needs one")
    new = np.diff(recording[STRIDE]) != 0.0 if STRIDE in recording else np.diff(phase) < 0.0
    edges = [0, *(np.flatnonzero(new) + 1).tolist(), len(phase)]
    found = []
    for number, (begin, end) in enumerate(itertools.pairwise(edges), start=1):
        falls = np.flatnonzero(np.diff(phase[begin:end]) <= 0.0)
        if len(falls):
            row = begin + int(falls[0]) + 1
            raise InputError(
                f"{where}: gait_phase does not rise at {recording[TIME][row]:.6g} s, in stride {number}; it must rise "
                "from sample to sample of a stride"
            )
        found.append(Stride(number, begin, end, float(phase[begin]), float(phase[end - 1])))
    return found


def over_phase(recording: Recording, stride: Stride, channel: str) -> Samples:
    """``channel`` of one ``stride`` at :data:`PHASE_GRID`; NaN where there is nothing to tell it from.

    Heel strikes mostly fall between two samples: the neighbouring strides' nearest samples are taken in, where they
    follow without a pause; otherwise the outermost line goes on, for less than :data:`OUTSIDE` intervals.
    """
    phase, time = recording[PHASE], recording[TIME]
    usual = float(np.median(np.diff(time)))
    begin, end = stride.begin, stride.end
    x, y = [phase[begin:end]], [recording[channel][begin:end]]
    # A stride may end with a sample at 100 % that the next begins with at 0 %: that one is the same instant.
    if begin > 0 and time[begin] - time[begin - 1] < OUTSIDE * usual and phase[begin - 1] - 100.0 < stride.low:
        x, y = [phase[begin - 1 : begin] - 100.0, *x], [recording[channel][begin - 1 : begin], *y]
    if end < len(phase) and time[end] - time[end - 1] < OUTSIDE * usual and phase[end] + 100.0 > stride.high:
        x, y = [*x, phase[end : end + 1] + 100.0], [*y, recording[channel][end : end + 1]]
    return _line(PHASE_GRID, np.concatenate(x), np.concatenate(y), outside=OUTSIDE)


def common_time(recordings: Sequence[tuple[str, Recording]]) -> Samples:
    """Evenly spaced times [s] that all ``recordings`` (name, recording) span, at the usual interval of the coarsest.

    Coarser still where that would be more than :data:`MOST_POINTS`. Raises InputError if they have no time in common.
    """
    first, last = (max(recordings, key=lambda r: r[1][TIME][0]), min(recordings, key=lambda r: r[1][TIME][-1]))
    begin, end = float(first[1][TIME][0]), float(last[1][TIME][-1])
    if not end > begin:
        raise InputError(
            f"{last[0]} ends at {end:.6g} s and {first[0]} begins at {begin:.6g} s; allowed are recordings that "
            "overlap in time"
        )
    step = max(float(np.median(np.diff(recording[TIME]))) for _, recording in recordings)
    step = max(step, (end - begin) / (MOST_POINTS - 1))
    count = int((end - begin) / step * (1.0 + 1e-12)) + 1
    if count < 2:
        raise InputError(
            f"{first[0]} and {last[0]} overlap from {begin:.6g} to {end:.6g} s, less than one sampling interval of "
            f"{step:.6g} s; allowed are recordings that overlap for longer"
        )
    return np.asarray(np.minimum(begin + step * np.arange(count), end))


def over_time(recording: Recording, channel: str, axis: Samples) -> Samples:
    """``channel`` at the times ``axis`` [s]; NaN outside of the recording."""
    return _line(axis, recording[TIME], recording[channel], outside=0.0)


def _line(at: Samples, x: Samples, y: Samples, *, outside: float) -> Samples:
    """Straight lines between samples ``y`` at rising ``x``; the outermost go on for less than ``outside`` intervals."""
    if len(x) < 2:
        return np.full(at.shape, np.nan)
    found = np.interp(at, x, y, left=np.nan, right=np.nan)
    usual = float(np.median(np.diff(x)))
    after = np.clip(np.searchsorted(x, at, side="left"), 1, len(x) - 1)
    hole = (x[after] - x[after - 1] > HOLE * usual) & (at != x[after]) & (at != x[after - 1])
    found[hole] = np.nan
    for beyond, near, far in ((at < x[0], 0, 1), (at > x[-1], -1, -2)):
        reached = beyond & (np.abs(at - x[near]) < outside * usual)
        found[reached] = y[near] + (y[near] - y[far]) * ((at[reached] - x[near]) / (x[near] - x[far]))
    return found
