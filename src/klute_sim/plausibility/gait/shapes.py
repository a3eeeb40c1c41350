"""Curves over the gait cycle: correlation with typical ones, start, direction and foot of the stride."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.samples import compute_correlation
from klute_sim.types import Array, Mask

N_PHASES = 100
"""Number of phases of a curve, one per cent apart."""
LOADED_FRACTION = 0.08
"""Fraction of the peak vertical force above which the foot counts as loaded."""
TYPICAL_TOE_OFF = 0.62
"""Toe-off phase of the typical curves (0-1)."""
MIN_RUN_PCT = 8
"""Shortest contact and shortest swing [% of the cycle] that count."""


class ContactIntervals(NamedTuple):
    """Contact of the foot in one cycle."""

    starts: list[int]
    """Phases [%] at which the foot becomes loaded."""
    ends: list[int]
    """Phases [%] at which it becomes unloaded."""
    loaded_pct: int
    """Part of the cycle in contact [%]."""


def resample_cycle(phase_pct: Array, values: Array) -> Array:
    """Return ``values`` at ``phase_pct`` as a curve at 0 to 99 %."""
    return np.asarray(np.interp(np.arange(N_PHASES), phase_pct, values))


def find_contact(vertical: Array) -> ContactIntervals:
    """Return the contacts in a curve of the vertical force, up positive; contacts and swings of noise are ignored."""
    loaded = vertical > LOADED_FRACTION * np.max(vertical)
    for state in (False, True):
        for start, length in _find_runs(loaded, state):
            if length < MIN_RUN_PCT:
                loaded[(start + np.arange(length)) % N_PHASES] = not state
    runs = _find_runs(loaded, True)
    return ContactIntervals([s for s, _ in runs], [(s + n) % N_PHASES for s, n in runs], int(loaded.sum()))


def _find_runs(mask: Mask, state: bool) -> list[tuple[int, int]]:
    """Return start and length of the circular runs of ``state`` in ``mask``; none where all are equal."""
    is_state: Mask = mask == state
    starts = np.flatnonzero(is_state & ~np.roll(is_state, 1))
    return [(int(s), int(np.argmin(np.roll(is_state, -s)))) for s in starts]


def warp_to_typical(values: Array, toe_off_pct: int) -> Array:
    """Return the curve ``values`` with stance and swing stretched so that toe-off is at the typical phase."""
    if not 20 <= toe_off_pct <= 85:
        return values
    phase = np.arange(N_PHASES + 1.0)
    source = np.interp(phase[:-1], [0.0, 100.0 * TYPICAL_TOE_OFF, 100.0], [0.0, float(toe_off_pct), 100.0])
    return np.asarray(np.interp(source, phase, np.append(values, values[0])))


def correlate(curves: Mapping[str, Array], typical: Mapping[str, Array]) -> dict[tuple[str, str], float]:
    """Return (curve, typical curve) -> correlation."""
    return {(a, b): compute_correlation(x, y) for a, x in curves.items() for b, y in typical.items()}


def find_best_shift(
    curves: Mapping[str, Array], typical: Mapping[str, Array], *, reverse: bool = False
) -> tuple[int, float]:
    """Return the shift [%] after which ``curves`` resemble the ``typical`` ones best, and the median correlation."""
    names = [name for name in curves if name in typical]
    best, best_score = 0, -1.0
    for shift in range(N_PHASES):
        scores = []
        for name in names:
            curve = curves[name][::-1] if reverse else curves[name]
            scores.append(compute_correlation(np.roll(curve, -shift), typical[name]))
        score = float(np.mean(np.sort(scores)[len(scores) // 4 :])) if scores else -1.0
        if score > best_score:
            best, best_score = shift, score
    return best, best_score
