"""Runs of successive true values in a mask."""

import numpy as np

from klute_sim.types import Mask


def find_runs(mask: Mask) -> list[tuple[int, int]]:
    """Return the first index and the index after the last of each run of true values in ``mask`` (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
