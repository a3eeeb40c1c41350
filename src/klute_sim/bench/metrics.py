"""Metrics of bench recordings: values at an instant, crossings, work and the energy balance."""

import numpy as np

from klute_sim.device.energy.ledger import POWER_TERMS
from klute_sim.recording.recording import Recording
from klute_sim.types import Array

TIME_TOLERANCE = 1e-9
"""Rounding tolerance of sample times [s], as in :func:`klute_sim.bench.trajectory.sample_staircase`."""


def interpolate_channel(recording: Recording, channel: str, time: float) -> float:
    """Return ``channel`` at ``time`` [s], linearly interpolated."""
    return float(np.interp(time, recording["time"], recording[channel]))


def select_half_open_interval(recording: Recording, begin: float, end: float) -> Recording:
    """Return the samples in ``[begin, end)`` [s], without the response to a command given at ``end``."""
    time = recording["time"]
    return recording.select((time >= begin - TIME_TOLERANCE) & (time < end - TIME_TOLERANCE))


def select_closed_interval(recording: Recording, begin: float, end: float) -> Recording:
    """Return the samples from the one nearest to ``begin`` to the one nearest to ``end`` [s], for integrals."""
    time, half = recording["time"], 0.5 * get_sampling_interval(recording) + TIME_TOLERANCE
    return recording.select((time >= begin - half) & (time < end + half))


def get_sampling_interval(recording: Recording) -> float:
    """Return the time [s] between samples."""
    return float(recording["time"][1] - recording["time"][0])


def find_crossing(recording: Recording, channel: str, level: float, begin: float, end: float) -> float:
    """Return the first time [s] in ``[begin, end]`` at which ``channel`` crosses ``level``; NaN without a crossing."""
    interval = select_closed_interval(recording, begin, end)
    time, excess = interval["time"], interval[channel] - level
    crossings = np.flatnonzero((excess[:-1] * excess[1:] <= 0.0) & (excess[:-1] != excess[1:]))
    if not len(crossings):
        return float("nan")
    k = int(crossings[0])
    return float(time[k] + (time[k + 1] - time[k]) * excess[k] / (excess[k] - excess[k + 1]))


def compute_work(recording: Recording) -> float:
    """Return the work [J] of the device on the crosshead: ``-int F dL`` over the length reached."""
    return float(-np.trapezoid(recording["force"], 1e-3 * recording["length"]))


def integrate_power(recording: Recording, channel: str) -> float:
    """Return the energy [J] of a power ``channel``; a sample holds for the time step that ends there."""
    return float((recording[channel][1:] * np.diff(recording["time"])).sum())


def compute_ledger_residual(recording: Recording) -> float:
    """Return the work [J] that the elements of the device do not account for; proportional to the time step."""
    return compute_work(recording) - sum(integrate_power(recording, term) for term in POWER_TERMS)


def compute_shortening_velocity(recording: Recording, channel: str) -> Array:
    """Return the shortening velocity [mm/s] of a length ``channel`` [mm]."""
    return np.asarray(-np.gradient(recording[channel], recording["time"]))
