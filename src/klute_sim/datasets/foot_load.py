"""Tell the load of a foot on a force plate from the noise of an unloaded plate."""

import numpy as np

from klute_sim.datasets.channels import CONTACT_FORCE_THRESHOLD
from klute_sim.types import Array, Mask

STANCE_PERCENTILE = 95.0
"""Percentile of the forces above the threshold that stands for the load in stance: a spike of a plate is higher."""
MIN_LOAD_FRACTION = 0.1
"""Fraction of the load in stance that a foot reaches in each contact, and noise does not (assumed: the belts of a
treadmill shake a plate by 10 to 30 N)."""


def find_loaded_samples(vertical_force: Array, threshold: float = CONTACT_FORCE_THRESHOLD) -> Mask:
    """Return which samples of ``vertical_force`` [N] are the load of a foot.

    These are the runs of samples above ``threshold`` [N] that reach :data:`MIN_LOAD_FRACTION` of the load in stance.
    """
    force = np.nan_to_num(vertical_force)
    is_above = force > threshold
    if not is_above.any():
        return is_above
    is_high = force > MIN_LOAD_FRACTION * float(np.percentile(force[is_above], STANCE_PERCENTILE))
    run = np.cumsum(np.diff(is_above, prepend=False))
    is_run_high = np.bincount(run, weights=is_above & is_high) > 0.0
    return np.asarray(is_above & is_run_high[run])


def interpolate_loaded(time: Array, load_time: Array, is_loaded: Mask) -> Mask:
    """Return which of ``time`` [s] (n,) are closer to a loaded sample than to another; ``load_time`` [s] (m,)."""
    return np.asarray(np.interp(time, load_time, is_loaded) > 0.5)
