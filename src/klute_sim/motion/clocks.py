"""Two files that saw the same movement: how far apart their clocks are."""

from typing import NamedTuple

import numpy as np

from klute_sim.motion.findings import Findings
from klute_sim.recording.recording import Samples

FARTHEST = 0.5
"""Lags [s] that are tried either way: a stride further, walking looks the same."""
STEP = 2.5e-3
"""Between lags, and between samples that are compared [s]."""
NOTED = 0.01
"""Lag [s] from which it is doubted (assumed; at push-off the ankle turns some 2 degrees in it)."""
ALIKE = 0.95
"""Correlation from which two curves are of the same movement (assumed)."""


class Series(NamedTuple):
    """One channel on its own clock."""

    time: Samples
    """[s]"""
    value: Samples
    """NaN where there is no sample."""


def lag(one: Series, other: Series) -> tuple[float, float] | None:
    """What is to be added to the times of ``one`` [s] so that it is most like ``other``, and their correlation then.

    None where they share less than a second.
    """
    begin = max(one.time[0] + FARTHEST, other.time[0])
    end = min(one.time[-1] - FARTHEST, other.time[-1])
    if end - begin < 1.0:
        return None
    at = np.arange(begin, end, STEP)
    there = _at(other, at)
    shifts = np.arange(-round(FARTHEST / STEP), round(FARTHEST / STEP) + 1) * STEP
    alike = [float(np.corrcoef(_at(one, at - shift), there)[0, 1]) for shift in shifts]
    best = int(np.argmax(alike))
    return float(shifts[best]), alike[best]


def _at(series: Series, time: Samples) -> Samples:
    known = np.isfinite(series.value)
    return np.asarray(np.interp(time, series.time[known], series.value[known]))


def compare(what: str, one: tuple[str, Series], other: tuple[str, Series], findings: Findings) -> None:
    """Note how far ``what`` in the file of ``one`` is from what the ``other`` file has."""
    found = lag(one[1], other[1])
    if found is None:
        return
    shift, alike = found
    files = f"{what} in {one[0]} and in {other[0]}"
    if not alike >= ALIKE:
        findings.suspect(f"{files} are not the same movement (correlation {alike:.2f}): is one of another trial?")
    elif abs(shift) >= NOTED:
        findings.suspect(
            f"{files} are most alike {1e3 * abs(shift):.0f} ms apart: if it is the clocks, say "
            f"'\"{one[0]}\" = {shift:.4g}' under [clock] in a file for --map"
        )
    else:
        findings.derive(f"Check of the clocks: {files} are most alike less than {1e3 * NOTED:.0f} ms apart")
