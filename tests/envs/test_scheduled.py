"""Segments of constant controls, in which an environment takes its steps."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.envs.base.scheduled import iter_segments


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 1)), min_size=1, max_size=30), st.integers(1, 30))
def test_segments_cover_all_steps_once_with_their_controls(rows: list[tuple[int, int]], max_count: int) -> None:
    controls, repeated = np.array(rows, dtype=float), []
    segments = list(iter_segments(controls, max_count))
    for start, count in segments:
        assert 1 <= count <= max_count
        assert start == len(repeated)
        repeated += [controls[start]] * count
    assert np.array_equal(repeated, controls)


def test_equal_controls_are_one_segment() -> None:
    assert list(iter_segments(np.ones((20, 2)), 20)) == [(0, 20)]
    assert list(iter_segments(np.array([[0.0], [0.0], [1.0]]), 3)) == [(0, 2), (2, 1)]
