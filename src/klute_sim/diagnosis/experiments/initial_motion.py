"""Motion and pressures with which a trial of a mechanism begins, from its first samples."""

from collections.abc import Mapping

import numpy as np

from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.mechanism.assembly import Binding
from klute_sim.types import Array

MOTION_QUANTITIES = ("angle", "position")
"""Quantities of the channels that measure or prescribe a motion."""
MAX_LATE_START = 0.03
"""Latest beginning [s] of a measured position after that of the trial from which its motion there follows (assumed)."""
START_TIME_SPAN = 0.1
"""Time [s] at the start of a trial over which its velocity is measured (assumed)."""
MIN_INITIAL_SPEED = {"angle": np.radians(5.0), "position": 0.01}
"""Speed [rad/s or m/s] up to which a joint begins at rest (assumed)."""
NOISE_FACTOR = 5.0
"""Change of a position over its noise, above which it moves (assumed)."""
MOTION_SIGMAS = 3.0
"""Change of a position within :data:`START_TIME_SPAN`, over its standard error, above which its start is not the mean
(assumed)."""


def estimate_initial_velocities(trial: Trial, outputs: Mapping[str, Binding], start_time: float) -> dict[str, float]:
    """Return joint -> velocity of each joint with a measured position, if any of them begins in motion; else nothing.

    Joints whose velocity the dataset states are left out.
    A parabola through :data:`START_TIME_SPAN` from ``start_time`` on gives the velocity. A joint moves if this velocity
    exceeds :data:`MIN_INITIAL_SPEED` and the position changes by more than its noise from the first to the second
    third: a joint that rests at first and is accelerated later does not.
    """
    velocities, is_moving = {}, False
    for name, binding in outputs.items():
        if name not in trial.measured or binding.channel.quantity not in MOTION_QUANTITIES:
            continue
        if binding.name in trial.initial_state.velocities:
            continue
        series = trial.measured[name]
        if begins_late(series, start_time):
            continue
        is_early = np.isfinite(series.value) & (series.time >= start_time)
        is_early &= series.time <= max(series.time[0], start_time) + START_TIME_SPAN
        third = int(is_early.sum()) // 3
        if third < 2:
            continue
        time, value = series.time[is_early] - start_time, series.value[is_early]
        parabola = np.polyfit(time, value, 2)
        noise = float(np.std(value - np.polyval(parabola, time)))
        velocities[binding.name] = float(parabola[1])
        change = abs(float(np.median(value[third : 2 * third]) - np.median(value[:third])))
        is_fast = abs(velocities[binding.name]) > MIN_INITIAL_SPEED[binding.channel.quantity]
        is_moving |= is_fast and change > NOISE_FACTOR * noise
    return velocities if is_moving else {}


def begins_late(series: TimeSeries, start_time: float) -> bool:
    """Return whether ``series`` begins too late to tell the motion at ``start_time``."""
    known = series.time[np.isfinite(series.value) & (series.time >= start_time)]
    return not len(known) or float(known[0]) > start_time + MAX_LATE_START


def estimate_initial_position(series: TimeSeries, start_time: float) -> float:
    """Return the position [m or rad] of ``series`` at ``start_time``, from its first :data:`START_TIME_SPAN`.

    That is the mean of a joint at rest, and the start of a parabola through the samples of one that moves.
    """
    is_early = np.isfinite(series.value) & (series.time >= start_time)
    is_early &= series.time <= start_time + START_TIME_SPAN
    time, value = series.time[is_early] - start_time, series.value[is_early]
    third = len(value) // 3
    if third < 2:
        return float(interpolate_finite(series, np.array([start_time]))[0])
    parabola = np.polyfit(time, value, 2)
    noise = float(np.std(value - np.polyval(parabola, time)))
    change = abs(float(np.mean(value[-third:]) - np.mean(value[:third])))
    is_moving = change > MOTION_SIGMAS * noise * np.sqrt(2.0 / third)
    return float(parabola[2]) if is_moving else float(np.mean(value))


def read_initial_pressures(trial: Trial, outputs: Mapping[str, Binding], start_time: float) -> dict[str, float]:
    """Return device -> median of its first measured pressures [Pa] from ``start_time`` on."""
    pressures = {}
    for name, binding in outputs.items():
        if name in trial.measured and binding.channel.quantity == "pressure":
            series = trial.measured[name]
            values = series.value[np.isfinite(series.value) & (series.time >= start_time)]
            if len(values):
                pressures[binding.name] = float(np.median(values[:3]))
    return pressures


def interpolate_finite(samples: TimeSeries, time: Array) -> Array:
    """Return the known values of ``samples`` at ``time`` [s], linear between them."""
    is_finite = np.isfinite(samples.value)
    return np.interp(time, samples.time[is_finite], samples.value[is_finite])
