"""Runs of true values in a mask."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.mask_runs import find_runs


@given(st.lists(st.booleans()))
def test_runs_are_separate_and_hold_all_true_values(values: list[bool]) -> None:
    mask = np.array(values, dtype=np.bool_)
    runs, rebuilt = find_runs(mask), np.zeros_like(mask)
    for start, stop in runs:
        assert start < stop
        rebuilt[start:stop] = True
    assert (rebuilt == mask).all()
    assert all(stop < start for (_, stop), (start, _) in pairwise(runs))
