"""Reading recordings of the bench: values at an instant, crossings, work, the energy ledger."""

import numpy as np

from klute_sim.recording.recording import Recording
from klute_sim.rigs.bench.path import Array

POWERS = ("gas_power", "friction_power", "damper_power", "stop_power", "effects_power")
"""Out of the device's elements."""
STORES = ("bladder_energy", "tendon_energy")


def at(recording: Recording, channel: str, time: float) -> float:
    """``channel`` at ``time`` [s], between samples on a straight line."""
    return float(np.interp(time, recording["time"], recording[channel]))


def between(recording: Recording, begin: float, end: float) -> Recording:
    """The samples from ``begin`` to ``end`` [s], both ends with them."""
    tiny = 1e-9 + 0.5 * float(recording["time"][1])
    return recording.select((recording["time"] >= begin - tiny) & (recording["time"] < end + tiny))


def crossing(recording: Recording, channel: str, level: float, begin: float, end: float) -> float:
    """First instant [s] between ``begin`` and ``end`` at which ``channel`` passes ``level``; NaN if it does not."""
    inside = between(recording, begin, end)
    time, beyond = inside["time"], inside[channel] - level
    passed = np.flatnonzero((beyond[:-1] * beyond[1:] <= 0.0) & (beyond[:-1] != beyond[1:]))
    if not len(passed):
        return float("nan")
    k = int(passed[0])
    return float(time[k] + (time[k + 1] - time[k]) * beyond[k] / (beyond[k] - beyond[k + 1]))


def work(recording: Recording) -> float:
    """Work [J] that the device does on the crosshead: ``-int F dL`` over the length reached."""
    return float(-np.trapezoid(recording["force"], 1e-3 * recording["length"]))


def given(recording: Recording, channel: str) -> float:
    """Energy [J] that a power ``channel`` gave; each sample's power holds for the step that ends there."""
    return float((recording[channel][1:] * np.diff(recording["time"])).sum())


def stored(recording: Recording) -> float:
    """By how much the energy in bladder and tendon grew [J]."""
    return sum(float(recording[channel][-1] - recording[channel][0]) for channel in STORES)


def ledger_residual(recording: Recording) -> float:
    """Work minus what the energy ledger accounts for [J]; the time step's error, and nothing else."""
    return work(recording) - (sum(given(recording, channel) for channel in POWERS) - stored(recording))


def velocity(recording: Recording, channel: str) -> Array:
    """Shortening velocity [mm/s] of a length ``channel`` [mm]."""
    return np.asarray(-np.gradient(recording[channel], recording["time"]))
