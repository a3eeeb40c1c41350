"""Two files that saw the same movement: how far apart their clocks are."""

from typing import NamedTuple

import numpy as np

from klute_sim.mocap.import_log import ImportLog
from klute_sim.recording.recording import Array

MAX_LAG = 0.5
"""Lags [s] that are tried either way: a stride further, walking looks the same."""
LAG_STEP = 2.5e-3
"""Between lags, and between samples that are compared [s]."""
MIN_REPORTED_LAG = 0.01
"""Lag [s] from which it is doubted (assumed; at push-off the ankle turns some 2 degrees in it)."""
MIN_CORRELATION = 0.95
"""Correlation from which two curves are of the same movement (assumed)."""


class Signal(NamedTuple):
    """One channel on its own clock."""

    time: Array
    """[s]"""
    value: Array
    """NaN where there is no sample."""


def estimate_lag(signal: Signal, reference: Signal) -> tuple[float, float] | None:
    """What is to be added to the times of ``one`` [s] so that it is most like ``other``, and their correlation then.

    None where they share less than a second.
    """
    begin = max(signal.time[0] + MAX_LAG, reference.time[0])
    end = min(signal.time[-1] - MAX_LAG, reference.time[-1])
    if end - begin < 1.0:
        return None
    at = np.arange(begin, end, LAG_STEP)
    there = _interpolate(reference, at)
    shifts = np.arange(-round(MAX_LAG / LAG_STEP), round(MAX_LAG / LAG_STEP) + 1) * LAG_STEP
    alike = [float(np.corrcoef(_interpolate(signal, at - shift), there)[0, 1]) for shift in shifts]
    best = int(np.argmax(alike))
    return float(shifts[best]), alike[best]


def _interpolate(signal: Signal, time: Array) -> Array:
    known = np.isfinite(signal.value)
    return np.asarray(np.interp(time, signal.time[known], signal.value[known]))


def compare_clocks(quantity: str, first: tuple[str, Signal], second: tuple[str, Signal], log: ImportLog) -> None:
    """Note how far ``what`` in the file of ``one`` is from what the ``other`` file has."""
    found = estimate_lag(first[1], second[1])
    if found is None:
        return
    shift, alike = found
    files = f"{quantity} in {first[0]} and in {second[0]}"
    if not alike >= MIN_CORRELATION:
        log.add_warning(f"{files} are not the same movement (correlation {alike:.2f}): is one of another trial?")
    elif abs(shift) >= MIN_REPORTED_LAG:
        log.add_warning(
            f"{files} are most alike {1e3 * abs(shift):.0f} ms apart: if it is the clocks, say "
            f"'\"{first[0]}\" = {shift:.4g}' under [clock] in a file for --map"
        )
    else:
        log.add_derived(f"Check of the clocks: {files} are most alike less than {1e3 * MIN_REPORTED_LAG:.0f} ms apart")
