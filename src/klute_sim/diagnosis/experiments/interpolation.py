"""Interpolation of prescribed channels between their samples.

Prescribed channels are denoised only where that is safe (:mod:`klute_sim.diagnosis.experiments.denoise`): a smooth
curve through the noise of a quick release would have a larger error than its samples, and the steps of a digital
command look like noise (:func:`holds_samples`). A command whose log shows the
updates of a digital controller (:func:`shows_updates`) is held until its next sample (zero-order hold). Any other is
interpolated linearly or with a zero-order hold, as the data decide: a controller that sets it at each sample holds it,
and linear interpolation begins up to a sampling interval early. The length follows a curve, because a machine has mass:
a straight line would be short by up to ``a h^2 / 8`` for an acceleration of a and a sampling interval of h, which is
0.04 mm at 12 m/s^2 and 200 Hz, in all repeats alike. The curve does not overshoot where a motion ends in a hold
(modified Akima interpolation).
"""

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.experiments.denoise import denoise
from klute_sim.types import Array

MAX_DENSE_INTERVAL = 0.0075
"""Largest sampling interval of the inputs [s] between whose samples they are known well enough (assumed). At
100 Hz, a curve and straight lines between samples of a 4 Hz motion differ by 0.3 times the noise of a load cell."""
MIN_UPDATES = 20
"""Smallest number of changes of a command that show the updates of a controller (assumed)."""
MIN_REGULAR_FRACTION = 0.5
"""Smallest fraction of intervals between changes that equal their median (assumed: a command may also stay equal)."""
MIN_CHANGE_SIZES = 4
"""Smallest number of different changes of a command that show updates (assumed). A slow ramp in the resolution of the
log changes by the resolution alone, and a switched command by one step."""
MIN_REPEATED_FRACTION, MIN_CONTINUED_FRACTION = 0.3, 0.8
"""Smallest fraction of samples that equal the one before, and smallest fraction of changes in the direction of the
change before, in a smooth command that a digital controller holds (assumed: in the last digits of measured pressures,
up to 0.4 of the samples are equal, and 0.5 to 0.8 of the changes go on)."""
MIN_STEP_FRACTION, MAX_REST_FRACTION = 0.02, 0.05
"""Smallest step of a command, and largest change beside its steps, over its range (assumed: a measured command has
noise)."""


def list_other_lengths(time: Array, length: TimeSeries) -> tuple[Array, ...]:
    """Return other interpolations of the length [m] at ``time`` [s]: straight lines, and lines that meet in corners.

    None where samples are dense.
    """
    if length.sampling_interval <= MAX_DENSE_INTERVAL:
        return ()
    values = denoise(length.time, length.value)
    return np.interp(time, length.time, values), np.interp(time, *insert_corners(length.time, values))


def insert_corners(sample_time: Array, samples: Array) -> tuple[Array, Array]:
    """Return ``sample_time`` [s] (n,) and ``samples`` (n,) with the corners between them: (m,) each, m >= n.

    A corner is where the lines through the two samples before and the two after meet, if they do so between them: a
    machine that reverses there goes beyond both samples.
    """
    slope = np.diff(samples) / np.diff(sample_time)
    before, between, after = slope[:-2], slope[1:-1], slope[2:]
    interval = np.diff(sample_time)[1:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        delay = interval * (between - after) / (before - after)
    is_corner = np.isfinite(delay) & (delay > 0.0) & (delay < interval)
    index = np.flatnonzero(is_corner) + 1
    delay, before = delay[is_corner], before[is_corner]
    return (
        np.insert(sample_time, index + 1, sample_time[index] + delay),
        np.insert(samples, index + 1, samples[index] + before * delay),
    )


def interpolate_smoothly(time: Array, sample_time: Array, samples: Array) -> Array:
    """Return ``samples`` (n,) at ``sample_time`` [s] (n,) at each ``time`` [s] (m,), with a continuous rate: (m,).

    Modified Akima interpolation (H. Akima, J. ACM 17:589, 1970, with the weights of C. Moler, 2019): the curve is
    constant between equal samples, and before the first and after the last one.
    """
    curve = Akima1DInterpolator(sample_time, samples, method="makima")
    return np.asarray(curve(np.clip(time, sample_time[0], sample_time[-1])), np.float64)


def apply_zero_order_hold(time: Array, dt: float, command: TimeSeries) -> Array | None:
    """Return ``command`` [Pa] in the time steps that end at ``time`` [s], with a zero-order hold: (steps,).

    ``dt`` is the time step [s]. Returns None for a constant command.
    """
    values = denoise_command(command)
    if not np.ptp(values):
        return None
    last = np.searchsorted(command.time, time - 0.5 * dt, side="right") - 1
    return values[np.clip(last, 0, len(values) - 1)]


def denoise_command(command: TimeSeries) -> Array:
    """Return the samples of ``command`` [Pa] without noise; those that a digital controller holds have none."""
    return command.value if holds_samples(command) else denoise(command.time, command.value)


def holds_samples(command: TimeSeries) -> bool:
    """Return whether ``command`` has the steps of a digital controller: values held for one or a few samples."""
    if shows_updates(command):
        return True
    difference = np.diff(command.value)
    changes = difference[difference != 0.0]
    if len(changes) < MIN_UPDATES or np.mean(difference == 0.0) < MIN_REPEATED_FRACTION:
        return False
    return bool(np.mean(changes[1:] * changes[:-1] > 0.0) >= MIN_CONTINUED_FRACTION)


def shows_updates(command: TimeSeries) -> bool:
    """Return whether the log of ``command`` shows a controller that updates it every few samples and holds it.

    Then no two samples in a row bring a change, and the changes follow each other at regular intervals.
    """
    difference = np.diff(command.value)
    changes = np.flatnonzero(difference)
    if len(changes) < MIN_UPDATES:
        return False
    intervals, sizes = np.diff(changes), np.abs(difference[changes])
    if intervals.min() < 2 or len(np.unique(np.round(sizes / sizes.min(), 3))) < MIN_CHANGE_SIZES:
        return False
    return bool(np.mean(intervals == np.median(intervals)) >= MIN_REGULAR_FRACTION)


def changes_in_steps(command: TimeSeries) -> bool:
    """Return whether ``command`` is constant but for steps, no two of them in a row."""
    difference = np.diff(command.value)
    span = float(np.ptp(command.value))
    is_step = np.abs(difference) > MIN_STEP_FRACTION * span
    steps = np.flatnonzero(is_step)
    if not len(steps) or (len(steps) > 1 and np.diff(steps).min() < 2):
        return False
    rest = np.cumsum(np.where(is_step, 0.0, difference))
    return bool(np.ptp(rest) <= MAX_REST_FRACTION * span)


def list_other_commands(time: Array, command: TimeSeries) -> tuple[Array, ...]:
    """Return other interpolations of the command [Pa] at ``time`` [s]: it may have stepped at once or at the end."""
    if command.sampling_interval <= MAX_DENSE_INTERVAL:
        return ()
    values = denoise_command(command)
    last = np.clip(np.searchsorted(command.time, time, side="right") - 1, 0, len(command.time) - 1)
    following = np.minimum(last + (command.time[last] < time), len(command.time) - 1)
    return values[last], values[following]
