"""Tell the load of a foot on a force plate from noise and offset of an unloaded plate."""

from typing import NamedTuple

import numpy as np

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD
from klute_sim.types import Array, Mask

STANCE_PERCENTILE = 95.0
"""Percentile of the forces above the threshold that stands for the load in stance (assumed; spikes are higher)."""
MIN_LOAD_FRACTION = 0.1
"""Fraction of the load in stance that a foot reaches in each contact, and noise does not (assumed: the belts of a
treadmill shake a plate by 10 to 30 N)."""
LOW_PERCENTILE, HIGH_PERCENTILE = 1.0, 99.5
"""Percentiles of the vertical force that stand for an unloaded plate and for its largest load, without spikes
(assumed)."""
UNLOADED_RANGE_FRACTION = 0.1
"""Fraction of the range between these percentiles, from its lower end, in which the plate is unloaded (assumed)."""
MIN_UNLOADED_FRACTION = 0.1
"""Smallest fraction of the samples without load that shows the offset of a plate (assumed)."""
MAX_OFFSET_FRACTION = 0.2
"""Largest offset of a plate over its largest load (assumed); a larger one is the load of a person who stands."""
MAX_FORWARD_OFFSET_FRACTION = 0.05
"""Largest fore-aft offset of a plate over its largest vertical load (assumed); a larger one is another column."""
MAX_UNREPORTED_OFFSET = 3.0
"""Largest offset of a plate [N] that is subtracted without a remark (assumed)."""


class PlateOffset(NamedTuple):
    """Readings of a plate without load."""

    vertical: float
    """Vertical force [N]."""
    forward: float
    """Fore-aft force [N]."""


def estimate_force_offset(vertical_force: Array) -> float:
    """Return the vertical force [N] of an unloaded plate; 0 where it is never unloaded for long enough to tell."""
    known = vertical_force[np.isfinite(vertical_force)]
    if len(known) == 0:
        return 0.0
    low, high = np.percentile(known, [LOW_PERCENTILE, HIGH_PERCENTILE])
    unloaded = known[known < low + UNLOADED_RANGE_FRACTION * (high - low)]
    if len(unloaded) <= MIN_UNLOADED_FRACTION * len(known):
        return 0.0
    offset = float(np.median(unloaded))
    return offset if abs(offset) <= MAX_OFFSET_FRACTION * high else 0.0


def estimate_plate_offset(vertical_force: Array, forward_force: Array) -> PlateOffset:
    """Return the offset of a plate from ``vertical_force`` and ``forward_force`` [N] at the same times, (n,) each."""
    is_known = np.isfinite(vertical_force) & np.isfinite(forward_force)
    vertical_force, forward_force = vertical_force[is_known], forward_force[is_known]
    is_unloaded = find_unloaded_samples(vertical_force)
    vertical, forward = estimate_force_offset(vertical_force), 0.0
    if is_unloaded.any():
        forward = float(np.median(forward_force[is_unloaded]))
        max_forward = MAX_FORWARD_OFFSET_FRACTION * float(np.percentile(vertical_force, HIGH_PERCENTILE))
        forward = forward if abs(forward) <= max_forward else 0.0
    return PlateOffset(vertical, forward)


def find_unloaded_samples(vertical_force: Array) -> Mask:
    """Return which samples of ``vertical_force`` [N] are readings of an unloaded plate; none if they are too few."""
    is_unloaded = ~find_loaded_samples(vertical_force) & np.isfinite(vertical_force)
    is_sufficient = is_unloaded.sum() > MIN_UNLOADED_FRACTION * len(is_unloaded)
    return is_unloaded if is_sufficient else np.zeros_like(is_unloaded)


def find_loaded_samples(vertical_force: Array, threshold: float = CONTACT_FORCE_THRESHOLD) -> Mask:
    """Return which samples of ``vertical_force`` [N] are the load of a foot.

    These are the runs of samples above ``threshold`` [N], without the offset of the plate, that reach
    :data:`MIN_LOAD_FRACTION` of the load in stance.
    """
    force = np.nan_to_num(vertical_force - estimate_force_offset(vertical_force))
    is_above = force > threshold
    if not is_above.any():
        return is_above
    is_high = force > MIN_LOAD_FRACTION * float(np.percentile(force[is_above], STANCE_PERCENTILE))
    run = np.cumsum(np.diff(is_above, prepend=False))
    is_run_high = np.bincount(run, weights=is_above & is_high) > 0.0
    return np.asarray(is_above & is_run_high[run])


def interpolate_load_mask(time: Array, load_time: Array, is_loaded: Mask) -> Mask:
    """Return which of ``time`` [s] (n,) are loaded: those whose nearest neighbour in ``load_time`` [s] (m,) is.

    ``is_loaded`` (m,) belongs to ``load_time``.
    """
    return np.asarray(np.interp(time, load_time, is_loaded) > 0.5)
