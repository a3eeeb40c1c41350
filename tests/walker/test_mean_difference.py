"""Tests of differences of means, paired and between groups: known intervals, signs, and coverage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from klute_sim.errors import InputError
from klute_sim.walker.mean_difference import compute_group_difference, compute_paired_difference

VALUES = st.lists(st.floats(-10, 10), min_size=2, max_size=12)


def test_textbook_interval() -> None:
    """Differences 1, 2, 3: mean 2, t(0.975, 2) = 4.303, standard error 1/sqrt(3)."""
    result = compute_paired_difference([0.0, 1.0, 5.0], [1.0, 3.0, 8.0])
    assert result.difference == pytest.approx(2.0)
    assert result.low == pytest.approx(2.0 - 4.3027 / 3**0.5, abs=1e-3)
    assert result.high == pytest.approx(2.0 + 4.3027 / 3**0.5, abs=1e-3)
    assert result.sign == 0


@given(VALUES, st.floats(0.1, 5.0))
def test_a_common_shift_has_a_sign_and_scatter_takes_it(values: list[float], shift: float) -> None:
    moved = [value + shift for value in values]
    assert compute_paired_difference(values, moved).sign == 1
    assert compute_paired_difference(moved, values).sign == -1
    assert compute_paired_difference(values, values).sign == 0


def test_one_walker_has_no_interval_and_no_sign() -> None:
    result = compute_paired_difference([1.0], [5.0])
    assert (result.low, result.high, result.sign, result.n_a) == (None, None, 0, 1)
    with pytest.raises(InputError, match="2 and 1 outcomes"):
        compute_paired_difference([1.0, 2.0], [1.0])


def test_interval_covers_the_true_difference_at_its_rate() -> None:
    rng = np.random.default_rng(0)
    hits = 0
    for _ in range(400):
        a = rng.normal(0.0, 1.0, 6)
        result = compute_paired_difference(a.tolist(), (a + rng.normal(0.3, 0.5, 6)).tolist())
        assert result.low is not None
        assert result.high is not None
        hits += result.low <= 0.3 <= result.high
    assert hits / 400 == pytest.approx(0.95, abs=0.03)


def test_groups_have_the_interval_of_welch() -> None:
    """The interval is that of SciPy's test with unequal variances."""
    rng = np.random.default_rng(3)
    a, b = rng.normal(1.0, 0.2, 7), rng.normal(1.5, 0.8, 10)
    result = compute_group_difference(a.tolist(), b.tolist())
    interval = stats.ttest_ind(b, a, equal_var=False).confidence_interval(0.95)
    assert (result.low, result.high) == pytest.approx((interval.low, interval.high), rel=1e-9)
    assert result.difference == pytest.approx(b.mean() - a.mean())
    assert (result.n_a, result.n_b) == (7, 10)


def test_groups_without_scatter_or_with_one_walker() -> None:
    assert compute_group_difference([1.0, 1.0], [1.0, 1.0]).sign == 0
    assert compute_group_difference([1.0, 1.0], [2.0, 2.0]).sign == 1
    assert compute_group_difference([1.0], [2.0, 3.0]).low is None
    with pytest.raises(InputError, match="0 and 1 outcomes"):
        compute_group_difference([], [1.0])
