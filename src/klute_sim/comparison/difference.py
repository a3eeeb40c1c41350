"""Two curves against each other: how much they differ, how alike their shapes are, and where the difference is.

The difference is that of the means, the other curve's minus the first's. Where it is has two answers:

- *Beyond the band*: stretches in which the difference leaves its own 95 % interval, point by point. The interval's half
  width is t·√(v₁ + v₂), where v is the square of the standard error of a curve's mean, sd²/n over its n repeats, and t
  is Student's with Welch's degrees of freedom. If one of the curves is a single stride, it is taken to scatter as the
  other's do (v = sd²: a prediction interval). A reference of people is held against its own spread (v = sd²): whether
  the difference is beyond what people differ by. Two single strides, or a reference without a spread, have no band.
- *Half of it*: the shortest stretch that holds half of the squared difference. It needs no band and is always told.

The interval is pointwise: with nothing but chance about 5 % of the points lie beyond it, and nothing is corrected for
their number. Repeats are taken as independent of each other, which strides of one walk need not be.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import stdtrit

from klute_sim.comparison.curve import MeanCurve
from klute_sim.recording.recording import Array

BandKind = Literal["means", "prediction", "reference", "none"]
"""What the interval is made of: both curves' repeats; one curve's, the other being single; people's spread; nothing."""

T_QUANTILE = 0.975
"""Of Student's t: two-sided 95 %."""
MIN_REGION_POINTS = 2
"""Points in a row that make a stretch beyond the band."""
ROUNDING_TOLERANCE = 1e-9
"""Of the range of both curves: differences and deviations below it are rounding, whatever the band."""
CONSTANT_TOLERANCE = 1e-12
"""Of its largest value: a curve that varies by less is constant."""
HALF_FRACTION = 0.5
"""Share of the squared difference that the shortest stretch is looked for."""


@dataclass(frozen=True)
class Region:
    """A stretch of the axis in which the difference is beyond the band, to the axis' own resolution."""

    begin: float
    end: float
    max_difference: float
    """Difference of largest size in it, with its sign."""
    max_position: float
    fraction: float
    """Of the squared difference over the whole axis [1]."""


@dataclass(frozen=True, eq=False)
class Difference:
    """The other curve minus the first, in the channel's unit; None where there is nothing to tell it from."""

    values: Array
    """One per point; NaN where one of the curves has none."""
    half_width: Array
    """Half width of the 95 % interval around no difference; NaN where there is no band."""
    band: BandKind
    compared_fraction: float
    """Share of the axis where both curves have a value [1]: everything else is of that share alone."""
    bias: float | None
    """Mean difference."""
    rms: float | None
    """Root mean square difference."""
    rms_sd: float | None
    """``rms`` over the root mean square of a standard deviation [1]; None where that is unknown or zero."""
    correlation: float | None
    """Pearson's [1]; None if one of the curves is constant."""
    max_difference: float | None
    """Difference of largest size, with its sign."""
    max_position: float | None
    """Where that is; None where there is no difference, but for rounding."""
    half_interval: tuple[float, float] | None
    """The shortest stretch with half of the squared difference; None likewise."""
    regions: tuple[Region, ...]
    """Stretches beyond the band."""


def compute_difference(first: MeanCurve, other: MeanCurve, axis: Array, sd: Array | None) -> Difference:
    """The difference ``other`` minus ``first`` along ``axis`` (rising, evenly spaced).

    ``sd`` is the standard deviation that :attr:`Difference.rms_sd` is measured in; None: not known.
    """
    values = other.mean - first.mean
    there = np.isfinite(values)
    width, band = _compute_half_width(first, other)
    found = Difference(
        values=values, half_width=np.where(there, width, np.nan), band=band, compared_fraction=float(np.mean(there)),
        bias=None, rms=None, rms_sd=None, correlation=None, max_difference=None, max_position=None, half_interval=None, regions=(),
    )  # fmt: skip
    if not there.any():
        return found
    d, worst = values[there], int(np.nanargmax(np.abs(values)))
    rms, least = _compute_rms(d), ROUNDING_TOLERANCE * _compute_range(first, other)
    return Difference(
        values=values,
        half_width=found.half_width,
        band=band,
        compared_fraction=found.compared_fraction,
        bias=float(np.mean(d)) + 0.0,  # no negative zero
        rms=rms,
        rms_sd=None if sd is None else _normalize_rms(rms, sd[there], least),
        correlation=compute_correlation(first.mean[there], other.mean[there]),
        max_difference=float(values[worst]) + 0.0,
        max_position=float(axis[worst]) if rms > least else None,
        half_interval=find_half_interval(values, axis) if rms > least else None,
        regions=_find_regions(values, np.maximum(found.half_width, least), axis),
    )


def compute_correlation(x: Array, y: Array) -> float | None:
    """Pearson's correlation of ``x`` and ``y`` [1]; None if one of them is constant. Equal ones give exactly 1."""
    if any(np.ptp(z) <= CONSTANT_TOLERANCE * np.max(np.abs(z)) for z in (x, y)):
        return None
    x, y = x - np.mean(x), y - np.mean(y)
    x, y = x / np.max(np.abs(x)), y / np.max(np.abs(y))  # so that squares neither overflow nor vanish
    return float(np.clip(np.sum(x * y) / np.sqrt(np.sum(x * x) * np.sum(y * y)), -1.0, 1.0))


def find_half_interval(values: Array, axis: Array) -> tuple[float, float] | None:
    """Ends of the shortest stretch of ``axis`` with half of the squared ``values``; None if these are all zero.

    NaN counts as zero. If several are the shortest, it is the first.
    """
    squares = np.nan_to_num(_scale_squares(values))
    running = np.concatenate([[0.0], np.cumsum(squares)])
    if running[-1] == 0.0:
        return None
    ends = np.searchsorted(running, running[:-1] + HALF_FRACTION * running[-1], side="left")
    lengths = np.where(ends < len(running), ends - np.arange(len(ends)), len(ends) + 1)
    begin = int(np.argmin(lengths))
    return float(axis[begin]), float(axis[ends[begin] - 1])


def _compute_half_width(first: MeanCurve, other: MeanCurve) -> tuple[Array, BandKind]:
    """Half width of the 95 % interval of the difference at every point, and what it is made of."""
    if first.is_reference or other.is_reference:
        people, own = (first, other) if first.is_reference else (other, first)
        error = (
            np.zeros_like(people.sd)
            if own.is_reference
            else np.where(own.n_repeats > 1, own.sd**2 / own.n_repeats, 0.0)
        )
        freedom = np.where(error > 0.0, np.maximum(own.n_repeats - 1.0, 1.0), np.inf)
        width = _compute_welch_half_width(people.sd**2, np.full(people.sd.shape, np.inf), error, freedom)
        return width, _select_band(width, "reference")
    one, two = first.n_repeats > 1, other.n_repeats > 1
    freedom1, freedom2 = (np.asarray(curve.n_repeats - 1.0, dtype=np.float64) for curve in (first, other))
    with np.errstate(invalid="ignore", divide="ignore"):
        both = _compute_welch_half_width(
            first.sd**2 / first.n_repeats, freedom1, other.sd**2 / other.n_repeats, freedom2
        )
        sd, count = np.where(one, first.sd, other.sd), np.where(one, first.n_repeats, other.n_repeats)
        alone = stdtrit(count - 1.0, T_QUANTILE) * sd * np.sqrt(1.0 + 1.0 / count)
    width = np.where(one & two, both, np.where(one | two, alone, np.nan))
    return width, _select_band(width, "means" if (one & two).any() else "prediction")


def _compute_welch_half_width(v1: Array, dof1: Array, v2: Array, dof2: Array) -> Array:
    """Half width t·√(v1 + v2) with the degrees of freedom of Welch and Satterthwaite; zero where nothing scatters."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        total = v1 + v2
        # As shares of the total, because squares of tiny variances are zero.
        freedom = 1.0 / ((v1 / total) ** 2 / dof1 + (v2 / total) ** 2 / dof2)
        return np.asarray(np.where(total == 0.0, 0.0, stdtrit(freedom, T_QUANTILE) * np.sqrt(total)))


def _select_band(half_width: Array, band: BandKind) -> BandKind:
    return band if np.isfinite(half_width).any() else "none"


def _find_regions(values: Array, half_width: Array, axis: Array) -> tuple[Region, ...]:
    beyond = np.abs(values) > half_width  # never where one of them is NaN
    edges = np.flatnonzero(np.diff(np.concatenate([[False], beyond, [False]]).astype(np.int8)))
    squares = np.nan_to_num(_scale_squares(values))
    found = []
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if end - begin < MIN_REGION_POINTS:
            continue
        worst = begin + int(np.argmax(np.abs(values[begin:end])))
        share = float(squares[begin:end].sum() / squares.sum())
        found.append(Region(float(axis[begin]), float(axis[end - 1]), float(values[worst]), float(axis[worst]), share))
    return tuple(found)


def _scale_squares(values: Array) -> Array:
    """Squares of ``values`` over that of the largest, which neither overflow nor vanish; NaN stays."""
    high = float(np.max(np.nan_to_num(np.abs(values))))
    return np.asarray((values / high) ** 2) if high > 0.0 else np.abs(values)


def _compute_rms(values: Array) -> float:
    high = float(np.max(np.abs(values)))
    return high * float(np.sqrt(np.mean((values / high) ** 2))) if high > 0.0 else 0.0


def _normalize_rms(rms: float, sd: Array, tolerance: float) -> float | None:
    known = sd[np.isfinite(sd)]
    deviation = _compute_rms(known) if len(known) else 0.0
    return rms / deviation if deviation > tolerance else None


def _compute_range(first: MeanCurve, other: MeanCurve) -> float:
    both = np.concatenate([first.mean, other.mean])
    return float(np.nanmax(both) - np.nanmin(both))
