"""A channel over phase or time: the mean of its repeats, and how they scatter."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from klute_sim.recording.recording import Samples


@dataclass(frozen=True, eq=False)
class Curve:
    """One channel of one series; every array has a value per point of the axis, in the channel's unit."""

    mean: Samples
    """NaN where fewer than half of the repeats have a value."""
    sd: Samples
    """Standard deviation between repeats (n - 1); NaN where there are not two. Of a reference: between people."""
    count: NDArray[np.int64]
    """Repeats with a value."""
    reference: bool = False
    """Whether it is a published mean of people: its ``sd`` is no error of the mean, and ``count`` is unknown (0)."""

    @property
    def unspread(self) -> bool:
        """Whether nothing is known of its spread."""
        return not np.isfinite(self.sd).any()


def of(repeats: Samples) -> Curve:
    """The curve of ``repeats``, an array of a row per stride or recording; what is not finite is missing."""
    there = np.isfinite(repeats)
    count = there.sum(axis=0)
    enough = (count > 0) & (2 * count >= len(repeats))
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(enough, np.where(there, repeats, 0.0).sum(axis=0) / count, np.nan)
        squares = np.where(there, (repeats - mean) ** 2, 0.0).sum(axis=0)
        sd = np.where(enough & (count > 1), np.sqrt(squares / (count - 1)), np.nan)
    return Curve(mean, sd, count)


def of_reference(mean: Samples, sd: Samples | None) -> Curve:
    """The curve of a published ``mean`` with the ``sd`` between its people, if that was published, too."""
    none = np.full(mean.shape, np.nan)
    return Curve(mean, none if sd is None else sd, np.zeros(mean.shape, dtype=np.int64), reference=True)
