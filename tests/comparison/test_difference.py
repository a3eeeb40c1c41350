"""Difference of two curves: limits, known values, and localisation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from klute_sim.comparison import curve
from klute_sim.comparison.alignment.resample import PHASE_GRID
from klute_sim.comparison.curve import MeanCurve
from klute_sim.comparison.difference import Difference, compute_correlation, compute_difference, find_half_interval

AXIS = PHASE_GRID
WAVE = np.sin(2.0 * np.pi * AXIS / 100.0)


def make_repeats(seed: int, count: int, scatter: float = 0.3) -> np.ndarray:
    """Return ``count`` waves with random offsets and noise."""
    rng = np.random.default_rng(seed)
    return np.asarray(WAVE + scatter * (rng.normal(size=(count, 1)) + rng.normal(size=(count, len(AXIS)))))


def compute(first: np.ndarray, other: np.ndarray) -> Difference:
    mean_curve = curve.average_repeats(np.atleast_2d(first))
    return compute_difference(mean_curve, curve.average_repeats(np.atleast_2d(other)), AXIS, mean_curve.sd)


SEEDS = st.integers(0, 1000)
NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)


@given(SEEDS, st.integers(1, 5), st.floats(1e-150, 1e150))
def test_equal_curves_have_zero_difference(seed: int, count: int, size: float) -> None:
    waves = size * make_repeats(seed, count)
    d = compute(waves, waves.copy())
    assert (d.bias, d.rms, d.max_difference) == (0.0, 0.0, 0.0)
    assert d.correlation == 1.0
    assert d.compared_fraction == 1.0
    assert d.regions == ()
    assert d.half_interval is None
    assert d.max_position is None
    assert d.rms_sd == (0.0 if count > 1 else None)


@given(SEEDS, st.floats(1e-3, 1e3), st.sampled_from((-1.0, 1.0)))
def test_shift_is_bias_and_rms(seed: int, shift: float, sign: float) -> None:
    waves = make_repeats(seed, 1)
    d = compute(waves, waves + sign * shift)
    assert d.bias == pytest.approx(sign * shift, rel=1e-9)
    assert d.rms == pytest.approx(shift, rel=1e-9)
    assert d.max_difference == pytest.approx(sign * shift, rel=1e-9)
    assert d.correlation == pytest.approx(1.0, abs=1e-12)


@given(st.floats(0.01, 100.0), st.sampled_from((-1.0, 1.0)), NUMBERS)
def test_scaled_wave_has_exact_rms_and_correlation(factor: float, sign: float, offset: float) -> None:
    d = compute(WAVE, sign * factor * WAVE)
    assert d.rms == pytest.approx(abs(sign * factor - 1.0) * np.sqrt(np.mean(WAVE**2)), rel=1e-9, abs=1e-12)
    assert d.correlation == pytest.approx(sign, abs=1e-12)
    assert compute_correlation(WAVE, WAVE + 1e-3 * offset) == pytest.approx(1.0, abs=1e-9)


def test_correlation_equals_numpy_and_is_none_for_constant() -> None:
    x, y = make_repeats(1, 2)
    assert compute_correlation(x, y) == pytest.approx(np.corrcoef(x, y)[0, 1], rel=1e-12)
    assert compute_correlation(x, np.full(len(x), 0.1)) is None
    assert compute_correlation(1e200 * x, 1e-200 * y) == pytest.approx(compute_correlation(x, y), rel=1e-12)


@given(SEEDS, st.integers(1, 4), st.integers(1, 4), st.floats(-3.0, 3.0))
def test_swapping_curves_changes_sign_only(seed: int, n_first: int, n_other: int, shift: float) -> None:
    first, other = make_repeats(seed, n_first), make_repeats(seed + 1, n_other) + shift * (AXIS > 40.0)
    forward, backward = compute(first, other), compute(other, first)
    assert forward.bias == -backward.bias  # type: ignore[operator]
    assert forward.max_difference == -backward.max_difference  # type: ignore[operator]
    for name in ("rms", "correlation", "max_position", "half_interval", "compared_fraction", "band"):
        assert getattr(forward, name) == getattr(backward, name), name
    assert [(r.begin, r.end, -r.max_difference, r.max_position, r.fraction) for r in forward.regions] == [
        (r.begin, r.end, r.max_difference, r.max_position, r.fraction) for r in backward.regions
    ]


@given(st.integers(10, 70), st.integers(4, 20), st.sampled_from((-5.0, 5.0)), SEEDS)
def test_bump_is_localized(begin: int, width: int, height: float, seed: int) -> None:
    inside = (begin <= AXIS) & (begin + width >= AXIS)
    # Both scatter in the same way about the same mean: but for the bump forward is no difference.
    first = make_repeats(seed, 4)
    d = compute(first, first + np.where(inside, height, 0.0))
    (region,) = d.regions
    assert (region.begin, region.end) == (begin, begin + width)
    assert region.max_difference == pytest.approx(height)
    assert region.fraction == pytest.approx(1.0)
    assert d.half_interval is not None
    assert begin <= d.half_interval[0] < d.half_interval[1] <= begin + width
    assert d.max_position is not None
    assert begin <= d.max_position <= begin + width


def test_regions_have_two_or_more_points() -> None:
    first = make_repeats(3, 4)
    spike = np.where(AXIS == 50.0, 9.0, 0.0)
    assert compute(first, first + spike).regions == ()
    bumps = 9.0 * ((AXIS >= 10.0) & (AXIS <= 20.0)) - 9.0 * ((AXIS >= 60.0) & (AXIS <= 64.0))
    result = compute(first, first + bumps).regions
    assert [(r.begin, r.end) for r in result] == [(10.0, 20.0), (60.0, 64.0)]
    assert [r.fraction for r in result] == pytest.approx([11 / 16, 5 / 16])
    assert [np.sign(r.max_difference) for r in result] == [1.0, -1.0]


@pytest.mark.parametrize("seed", range(5))
def test_band_of_two_means_is_welch_interval(seed: int) -> None:
    first, other = make_repeats(seed, 3), make_repeats(seed + 50, 7, 1.0)
    d = compute(first, other)
    assert d.band == "means"
    interval = stats.ttest_ind(other, first, equal_var=False).confidence_interval(0.95)
    assert d.half_width == pytest.approx(0.5 * (interval.high - interval.low), rel=1e-9)
    assert d.rms_sd == pytest.approx(d.rms / np.sqrt(np.mean(np.var(first, axis=0, ddof=1))), rel=1e-9)  # type: ignore[operator]


def test_false_positive_rate_is_five_per_cent() -> None:
    rng = np.random.default_rng(7)
    axis = np.linspace(0.0, 1.0, 20_000)
    for n_first, n_other in ((4, 6), (1, 5), (5, 1)):
        first, other = (curve.average_repeats(rng.normal(size=(count, len(axis)))) for count in (n_first, n_other))
        d = compute_difference(first, other, axis, None)
        assert np.mean(np.abs(d.values) > d.half_width) == pytest.approx(0.05, abs=0.01), (n_first, n_other)


def test_single_stride_has_prediction_interval() -> None:
    first, other = make_repeats(1, 5), make_repeats(2, 1)
    d = compute(first, other)
    assert d.band == "prediction"
    expected = stats.t.ppf(0.975, 4) * np.std(first, axis=0, ddof=1) * np.sqrt(1.2)
    assert d.half_width == pytest.approx(expected, rel=1e-12)
    assert d.rms_sd is not None
    assert compute(other, first).rms_sd is None


def test_two_single_strides_have_half_interval_only() -> None:
    d = compute(WAVE, WAVE + np.where((AXIS >= 30.0) & (AXIS <= 39.0), 1.0, 0.0))
    assert d.band == "none"
    assert np.isnan(d.half_width).all()
    assert d.regions == ()
    assert d.half_interval == (30.0, 34.0)


def test_reference_band_is_variation_between_people() -> None:
    sd = np.full(len(AXIS), 0.5)
    people = curve.make_reference_curve(WAVE, sd)
    walk = curve.average_repeats(np.tile(WAVE + np.where(AXIS >= 80.0, 1.2, 0.9), (3, 1)))  # repeats itself exactly
    d = compute_difference(walk, people, AXIS, people.sd)
    assert d.band == "reference"
    assert d.half_width == pytest.approx(1.959964 * 0.5, rel=1e-6)
    assert [(r.begin, r.end) for r in d.regions] == [(80.0, 100.0)]
    assert d.rms_sd == pytest.approx(d.rms / 0.5)  # type: ignore[operator]
    scattered = curve.average_repeats(make_repeats(1, 3))
    wider = compute_difference(scattered, people, AXIS, people.sd)
    assert (wider.half_width > d.half_width).all()
    assert wider.half_width == pytest.approx(compute_difference(people, scattered, AXIS, people.sd).half_width, rel=0.0)
    alone = curve.average_repeats(np.atleast_2d(WAVE))
    assert compute_difference(alone, people, AXIS, people.sd).half_width == pytest.approx(d.half_width, rel=0.0)
    assert compute_difference(walk, curve.make_reference_curve(WAVE, None), AXIS, None).band == "none"


def test_missing_points_are_excluded_from_comparison() -> None:
    first, other = make_repeats(1, 4), make_repeats(1, 4) + 1.0
    first[:, AXIS < 25.0] = np.nan
    other[:, AXIS < 25.0] = 100.0
    d = compute(first, other)
    assert d.correlation == pytest.approx(1.0, abs=1e-9)
    assert d.compared_fraction == pytest.approx(76 / 101)
    assert d.bias == pytest.approx(1.0)
    assert np.isnan(d.values[:25]).all()
    assert not any(r.begin < 25.0 for r in d.regions)
    nothing = compute(np.full(len(AXIS), np.nan), other)
    assert (nothing.compared_fraction, nothing.bias, nothing.rms, nothing.half_interval, nothing.regions) == (
        0.0,
        None,
        None,
        None,
        (),
    )


def test_rounding_errors_are_not_localized() -> None:
    waves = np.tile(WAVE, (3, 1))
    d = compute(waves, waves * (1.0 + 1e-15))
    assert d.regions == ()
    assert d.max_position is None
    assert d.half_interval is None
    assert d.rms_sd is None


def test_mean_requires_half_of_the_repeats() -> None:
    waves = np.array([[1.0, 1.0, 1.0], [3.0, 3.0, np.nan], [5.0, np.nan, np.nan], [7.0, np.inf, np.nan]])
    made = curve.average_repeats(waves)
    assert made.mean[:2].tolist() == [4.0, 2.0]
    assert np.isnan(made.mean[2])
    assert made.sd[0] == pytest.approx(np.std(waves[:, 0], ddof=1))
    assert made.n_repeats.tolist() == [4, 2, 1]
    alone = curve.average_repeats(waves[:1])
    assert alone.mean.tolist() == [1.0, 1.0, 1.0]
    assert alone.lacks_sd
    assert not made.lacks_sd


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=30))
def test_half_interval_is_shortest(values: list[float]) -> None:
    squares, axis = np.array(values) ** 2, np.arange(len(values), dtype=np.float64)
    result = find_half_interval(np.array(values), axis)
    if result is None:
        assert not any(values)
        return
    begin, end = int(result[0]), int(result[1])
    assert squares[begin : end + 1].sum() >= 0.5 * squares.sum() * (1.0 - 1e-9)
    shorter = end - begin
    for start in range(len(values)):
        assert squares[start : start + shorter].sum() <= 0.5 * squares.sum() * (1.0 + 1e-9)


def test_reference_curve_has_no_repeats() -> None:
    made: MeanCurve = curve.make_reference_curve(WAVE, None)
    assert made.is_reference
    assert made.lacks_sd
    assert not made.n_repeats.any()
