"""Mean curve of a channel over gait phase or time, with the standard deviation between repeats."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.types import Array


@dataclass(frozen=True, eq=False)
class MeanCurve:
    """Mean of one channel of one series; arrays (n,) have a value per point of the axis, in the channel's unit."""

    mean: Array
    """Mean over repeats; NaN where fewer than half of the repeats have a value."""
    sd: Array
    """Standard deviation between repeats (n - 1), or between people for a reference; NaN with fewer than two."""
    n_repeats: NDArray[np.int64]
    """Number of repeats with a value."""
    is_reference: bool = False
    """Whether this is a published mean of people: ``sd`` is not its error, and ``n_repeats`` is unknown (0)."""

    @property
    def lacks_sd(self) -> bool:
        """Whether the standard deviation is unknown everywhere."""
        return not np.isfinite(self.sd).any()


class CurveSummary(NamedTuple):
    """Extremes of a curve and of its standard deviation, in the channel's unit; None where unknown."""

    minimum: float | None
    """Smallest mean."""
    minimum_at: float | None
    """Position of the smallest mean on the axis."""
    maximum: float | None
    """Largest mean."""
    maximum_at: float | None
    """Position of the largest mean on the axis."""
    sd: float | None
    """Root mean square of the standard deviation over the axis."""
    max_sd: float | None
    """Largest standard deviation."""
    max_sd_at: float | None
    """Position of the largest standard deviation on the axis."""


def summarize_curve(curve: MeanCurve, axis: Array) -> CurveSummary:
    """Return the extremes of ``curve`` over ``axis`` (n,)."""
    extremes: list[float | None] = []
    for values, find_index in ((curve.mean, np.nanargmin), (curve.mean, np.nanargmax), (curve.sd, np.nanargmax)):
        is_known = np.isfinite(values).any()
        index = int(find_index(values)) if is_known else 0
        extremes += [float(values[index]), float(axis[index])] if is_known else [None, None]
    rms_sd = None if curve.lacks_sd else float(np.sqrt(np.nanmean(curve.sd**2)))
    return CurveSummary(extremes[0], extremes[1], extremes[2], extremes[3], rms_sd, extremes[4], extremes[5])


def average_repeats(repeats: Array) -> MeanCurve:
    """Return the mean curve of ``repeats`` (n_repeats, n); values that are not finite are missing."""
    known = np.isfinite(repeats)
    count = known.sum(axis=0)
    sufficient = (count > 0) & (2 * count >= len(repeats))
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(sufficient, np.where(known, repeats, 0.0).sum(axis=0) / count, np.nan)
        squares = np.where(known, (repeats - mean) ** 2, 0.0).sum(axis=0)
        sd = np.where(sufficient & (count > 1), np.sqrt(squares / (count - 1)), np.nan)
    return MeanCurve(mean, sd, count)


def make_reference_curve(mean: Array, sd: Array | None) -> MeanCurve:
    """Return the curve of a published ``mean`` with the standard deviation ``sd`` between people, if published."""
    unknown = np.full(mean.shape, np.nan)
    return MeanCurve(mean, unknown if sd is None else sd, np.zeros(mean.shape, dtype=np.int64), is_reference=True)
