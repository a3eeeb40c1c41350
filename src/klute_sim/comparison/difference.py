"""Difference of two mean curves: its size, the similarity of shapes, and where on the axis it is significant or large.

The difference is the mean of the other curve minus that of the first. Two measures localise it:

- *Regions beyond the band*: where the difference leaves its pointwise 95 % interval. The half width of the interval is
  t·√(v₁ + v₂), where v = sd²/n is the squared standard error of a mean over n repeats, and t is the quantile of
  Student's distribution with Welch's degrees of freedom. A single stride is assumed to vary like the strides of the
  other curve (v = sd²: a prediction interval). A reference of people has the variation between people (v = sd²), so the
  region shows where the difference exceeds that between people. Two single strides, or a reference without a standard
  deviation, have no band.
- *Half interval*: the shortest interval with half of the squared difference. It needs no band.

The interval is pointwise: by chance about 5 % of the points lie outside, without correction for their number. Repeats
are assumed to be independent, which strides of one recording need not be.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import stdtrit

from klute_sim.comparison.curve import MeanCurve
from klute_sim.mask_runs import find_runs
from klute_sim.types import Array

BandKind = Literal["means", "prediction", "reference", "none"]
"""Kind of the 95 % interval: of the difference of two means, of a single repeat, between people, or none."""

T_QUANTILE = 0.975
"""Quantile of Student's t for a two-sided 95 % interval."""
MIN_REGION_POINTS = 2
"""Smallest number of consecutive points of a region beyond the band."""
ROUNDING_TOLERANCE = 1e-9
"""Size of rounding errors, relative to the range of both curves."""
CONSTANT_TOLERANCE = 1e-12
"""Largest range of a constant curve, relative to its largest magnitude."""
MIN_SD_FRACTION = 1e-3
"""Smallest standard deviation that normalises an rms difference, relative to the range of the first curve (assumed)."""
HALF_FRACTION = 0.5
"""Fraction of the squared difference in the half interval."""


@dataclass(frozen=True)
class Region:
    """Interval of the axis in which the difference is beyond the band."""

    begin: float
    """First point."""
    end: float
    """Last point."""
    max_difference: float
    """Difference of the largest magnitude, with its sign."""
    max_position: float
    """Position of that difference."""
    fraction: float
    """Fraction of the squared difference over the whole axis [1]."""


@dataclass(frozen=True, eq=False)
class Difference:
    """Other curve minus first curve, in the channel's unit; None where it is undefined."""

    values: Array
    """Difference (n,); NaN where one of the curves is missing."""
    half_width: Array
    """Half width (n,) of the 95 % interval around zero; NaN without a band."""
    band: BandKind
    """Kind of the interval."""
    compared_fraction: float
    """Fraction of the axis with both curves [1]; all other numbers refer to this part."""
    bias: float | None
    """Mean difference."""
    rms: float | None
    """Root mean square difference."""
    rms_sd: float | None
    """``rms`` over the root mean square of a standard deviation [1]; None if that is unknown, or below
    :data:`MIN_SD_FRACTION` of the range of the first curve."""
    correlation: float | None
    """Pearson's correlation [1]; None if one of the curves is constant."""
    max_difference: float | None
    """Difference of the largest magnitude, with its sign."""
    max_position: float | None
    """Position of that difference; None if the curves are equal except for rounding."""
    half_interval: tuple[float, float] | None
    """Shortest interval with half of the squared difference; None if the curves are equal except for rounding."""
    regions: tuple[Region, ...]
    """Regions beyond the band."""


def compute_difference(first: MeanCurve, other: MeanCurve, axis: Array, sd: Array | None) -> Difference:
    """Return the difference ``other`` minus ``first`` along the increasing, uniform ``axis`` (n,).

    ``sd`` (n,) is the standard deviation that normalises :attr:`Difference.rms_sd`; None if unknown.
    """
    values = other.mean - first.mean
    known = np.isfinite(values)
    width, band = _compute_half_width(first, other)
    half_width = np.where(known, width, np.nan)
    compared_fraction = float(np.mean(known))
    if not known.any():
        return Difference(
            values=values, half_width=half_width, band=band, compared_fraction=compared_fraction, bias=None, rms=None,
            rms_sd=None, correlation=None, max_difference=None, max_position=None, half_interval=None, regions=(),
        )  # fmt: skip
    known_values, peak = values[known], int(np.nanargmax(np.abs(values)))
    rms, tolerance = _compute_rms(known_values), ROUNDING_TOLERANCE * _compute_range(first, other)
    return Difference(
        values=values,
        half_width=half_width,
        band=band,
        compared_fraction=compared_fraction,
        bias=float(np.mean(known_values)) + 0.0,  # adding zero removes the sign of a negative zero
        rms=rms,
        rms_sd=None if sd is None else _normalize_rms(rms, sd[known], _compute_min_sd(first, tolerance)),
        correlation=compute_correlation(first.mean[known], other.mean[known]),
        max_difference=float(values[peak]) + 0.0,
        max_position=float(axis[peak]) if rms > tolerance else None,
        half_interval=find_half_interval(values, axis) if rms > tolerance else None,
        regions=_find_regions(values, np.maximum(half_width, tolerance), axis),
    )


def compute_correlation(x: Array, y: Array) -> float | None:
    """Return Pearson's correlation of ``x`` and ``y`` [1], exactly 1 for equal arrays; None if one is constant."""
    if any(np.ptp(z) <= CONSTANT_TOLERANCE * np.max(np.abs(z)) for z in (x, y)):
        return None
    x, y = x - np.mean(x), y - np.mean(y)
    x, y = x / np.max(np.abs(x)), y / np.max(np.abs(y))  # squares must neither overflow nor underflow
    return float(np.clip(np.sum(x * y) / np.sqrt(np.sum(x * x) * np.sum(y * y)), -1.0, 1.0))


def find_half_interval(values: Array, axis: Array) -> tuple[float, float] | None:
    """Return the first shortest interval of ``axis`` with half of the squared ``values``; None if all are zero.

    NaN counts as zero.
    """
    squares = np.nan_to_num(_scale_squares(values))
    cumulative = np.concatenate([[0.0], np.cumsum(squares)])
    if cumulative[-1] == 0.0:
        return None
    ends = np.searchsorted(cumulative, cumulative[:-1] + HALF_FRACTION * cumulative[-1], side="left")
    lengths = np.where(ends < len(cumulative), ends - np.arange(len(ends)), len(ends) + 1)
    begin = int(np.argmin(lengths))
    return float(axis[begin]), float(axis[ends[begin] - 1])


def _compute_half_width(first: MeanCurve, other: MeanCurve) -> tuple[Array, BandKind]:
    """Return the half width of the 95 % interval of the difference at every point, and its kind."""
    if first.is_reference or other.is_reference:
        reference, series = (first, other) if first.is_reference else (other, first)
        if series.is_reference:
            squared_error = np.zeros_like(reference.sd)
        else:
            squared_error = np.where(series.n_repeats > 1, series.sd**2 / series.n_repeats, 0.0)
        dof = np.where(squared_error > 0.0, np.maximum(series.n_repeats - 1.0, 1.0), np.inf)
        reference_dof = np.full(reference.sd.shape, np.inf)
        width = _compute_welch_half_width(reference.sd**2, reference_dof, squared_error, dof)
        return width, _select_band(width, "reference")
    is_repeated1, is_repeated2 = first.n_repeats > 1, other.n_repeats > 1
    dof1, dof2 = (np.asarray(curve.n_repeats - 1.0, dtype=np.float64) for curve in (first, other))
    with np.errstate(invalid="ignore", divide="ignore"):
        half_width_of_means = _compute_welch_half_width(
            first.sd**2 / first.n_repeats, dof1, other.sd**2 / other.n_repeats, dof2
        )
        sd = np.where(is_repeated1, first.sd, other.sd)
        count = np.where(is_repeated1, first.n_repeats, other.n_repeats)
        half_width_of_single_repeat = stdtrit(count - 1.0, T_QUANTILE) * sd * np.sqrt(1.0 + 1.0 / count)
    width = np.where(
        is_repeated1 & is_repeated2,
        half_width_of_means,
        np.where(is_repeated1 | is_repeated2, half_width_of_single_repeat, np.nan),
    )
    return width, _select_band(width, "means" if (is_repeated1 & is_repeated2).any() else "prediction")


def _compute_welch_half_width(v1: Array, dof1: Array, v2: Array, dof2: Array) -> Array:
    """Return the half width t·√(v1 + v2) with the degrees of freedom of Welch and Satterthwaite; 0 if v1 = v2 = 0."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        total = v1 + v2
        # Fractions of the total, because squares of small variances underflow.
        dof = 1.0 / ((v1 / total) ** 2 / dof1 + (v2 / total) ** 2 / dof2)
        return np.asarray(np.where(total == 0.0, 0.0, stdtrit(dof, T_QUANTILE) * np.sqrt(total)))


def _select_band(half_width: Array, band: BandKind) -> BandKind:
    return band if np.isfinite(half_width).any() else "none"


def _find_regions(values: Array, half_width: Array, axis: Array) -> tuple[Region, ...]:
    is_beyond = np.abs(values) > half_width  # comparisons with NaN are false
    squares = np.nan_to_num(_scale_squares(values))
    regions = []
    for begin, end in find_runs(is_beyond):
        if end - begin < MIN_REGION_POINTS:
            continue
        peak = begin + int(np.argmax(np.abs(values[begin:end])))
        fraction = float(squares[begin:end].sum() / squares.sum())
        ends = float(axis[begin]), float(axis[end - 1])
        regions.append(Region(*ends, float(values[peak]), float(axis[peak]), fraction))
    return tuple(regions)


def _scale_squares(values: Array) -> Array:
    """Return the squares of ``values`` over the largest square, without overflow and underflow; NaN remains."""
    peak = float(np.max(np.nan_to_num(np.abs(values))))
    return np.asarray((values / peak) ** 2) if peak > 0.0 else np.abs(values)


def _compute_rms(values: Array) -> float:
    peak = float(np.max(np.abs(values)))
    return peak * float(np.sqrt(np.mean((values / peak) ** 2))) if peak > 0.0 else 0.0


def _normalize_rms(rms: float, sd: Array, min_sd: float) -> float | None:
    known = sd[np.isfinite(sd)]
    rms_sd = _compute_rms(known) if len(known) else 0.0
    return rms / rms_sd if rms_sd > min_sd else None


def _compute_min_sd(first: MeanCurve, tolerance: float) -> float:
    known = first.mean[np.isfinite(first.mean)]
    return max(tolerance, MIN_SD_FRACTION * float(np.ptp(known)))


def _compute_range(first: MeanCurve, other: MeanCurve) -> float:
    means = np.concatenate([first.mean, other.mean])
    return float(np.nanmax(means) - np.nanmin(means))
