"""Reading recordings of the bench: values at an instant, crossings, work, the energy ledger."""

import numpy as np

from klute_sim.bench.trajectory import Array
from klute_sim.device.energy.ledger import POWER_TERMS, SOLVER_TERM
from klute_sim.recording.recording import Recording

TIME_TOLERANCE = 1e-9
"""By which an instant may miss its sample [s]: rounding, as in :func:`klute_sim.bench.trajectory.stairs`."""


def interpolate_channel(recording: Recording, channel: str, time: float) -> float:
    """``channel`` at ``time`` [s], between samples on a straight line."""
    return float(np.interp(time, recording["time"], recording[channel]))


def select_half_open_interval(recording: Recording, begin: float, end: float) -> Recording:
    """The samples from ``begin`` [s] on, without those from ``end`` [s] on: a command given then is not in them."""
    time = recording["time"]
    return recording.select((time >= begin - TIME_TOLERANCE) & (time < end - TIME_TOLERANCE))


def select_closed_interval(recording: Recording, begin: float, end: float) -> Recording:
    """From the sample next to ``begin`` to that next to ``end`` [s], both with it: what is added up in between."""
    time, half = recording["time"], 0.5 * get_sampling_interval(recording) + TIME_TOLERANCE
    return recording.select((time >= begin - half) & (time < end + half))


def get_sampling_interval(recording: Recording) -> float:
    """Time [s] from one sample to the next."""
    return float(recording["time"][1] - recording["time"][0])


def find_crossing(recording: Recording, channel: str, level: float, begin: float, end: float) -> float:
    """First instant [s] between ``begin`` and ``end`` at which ``channel`` passes ``level``; NaN if it does not."""
    inside = select_closed_interval(recording, begin, end)
    time, beyond = inside["time"], inside[channel] - level
    passed = np.flatnonzero((beyond[:-1] * beyond[1:] <= 0.0) & (beyond[:-1] != beyond[1:]))
    if not len(passed):
        return float("nan")
    k = int(passed[0])
    return float(time[k] + (time[k + 1] - time[k]) * beyond[k] / (beyond[k] - beyond[k + 1]))


def compute_work(recording: Recording) -> float:
    """Work [J] that the device does on the crosshead: ``-int F dL`` over the length reached."""
    return float(-np.trapezoid(recording["force"], 1e-3 * recording["length"]))


def integrate_power(recording: Recording, channel: str) -> float:
    """Energy [J] that a power ``channel`` gave; each sample's power holds for the step that ends there."""
    return float((recording[channel][1:] * np.diff(recording["time"])).sum())


def compute_ledger_residual(recording: Recording) -> float:
    """Work that the elements of the device do not account for [J]: the time step's error, and nothing else."""
    return compute_work(recording) - sum(
        integrate_power(recording, line) for line in POWER_TERMS if line != SOLVER_TERM
    )


def compute_shortening_velocity(recording: Recording, channel: str) -> Array:
    """Shortening velocity [mm/s] of a length ``channel`` [mm]."""
    return np.asarray(-np.gradient(recording[channel], recording["time"]))
