"""A channel over phase or time: the mean of its repeats, and how they scatter."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from klute_sim.recording.recording import Array


@dataclass(frozen=True, eq=False)
class MeanCurve:
    """One channel of one series; every array has a value per point of the axis, in the channel's unit."""

    mean: Array
    """NaN where fewer than half of the repeats have a value."""
    sd: Array
    """Standard deviation between repeats (n - 1); NaN where there are not two. Of a reference: between people."""
    n_repeats: NDArray[np.int64]
    """Repeats with a value."""
    is_reference: bool = False
    """Whether it is a published mean of people: its ``sd`` is no error of the mean, and ``count`` is unknown (0)."""

    @property
    def lacks_sd(self) -> bool:
        """Whether nothing is known of its spread."""
        return not np.isfinite(self.sd).any()


class CurveSummary(NamedTuple):
    """How far a curve reaches and how wide its band is, in the channel's unit; places on the axis. None: not known."""

    lowest: float | None
    lowest_at: float | None
    highest: float | None
    highest_at: float | None
    sd: float | None
    """Root mean square over the axis."""
    sd_largest: float | None
    sd_at: float | None


def summarize_curve(curve: MeanCurve, axis: Array) -> CurveSummary:
    """Of ``curve`` over ``axis``."""
    ends: list[float | None] = []
    for values, pick in ((curve.mean, np.nanargmin), (curve.mean, np.nanargmax), (curve.sd, np.nanargmax)):
        known = np.isfinite(values).any()
        place = int(pick(values)) if known else 0
        ends += [float(values[place]), float(axis[place])] if known else [None, None]
    spread = None if curve.lacks_sd else float(np.sqrt(np.nanmean(curve.sd**2)))
    return CurveSummary(ends[0], ends[1], ends[2], ends[3], spread, ends[4], ends[5])


def average_repeats(repeats: Array) -> MeanCurve:
    """The curve of ``repeats``, an array of a row per stride or recording; what is not finite is missing."""
    there = np.isfinite(repeats)
    count = there.sum(axis=0)
    enough = (count > 0) & (2 * count >= len(repeats))
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(enough, np.where(there, repeats, 0.0).sum(axis=0) / count, np.nan)
        squares = np.where(there, (repeats - mean) ** 2, 0.0).sum(axis=0)
        sd = np.where(enough & (count > 1), np.sqrt(squares / (count - 1)), np.nan)
    return MeanCurve(mean, sd, count)


def make_reference_curve(mean: Array, sd: Array | None) -> MeanCurve:
    """The curve of a published ``mean`` with the ``sd`` between its people, if that was published, too."""
    none = np.full(mean.shape, np.nan)
    return MeanCurve(mean, none if sd is None else sd, np.zeros(mean.shape, dtype=np.int64), is_reference=True)
