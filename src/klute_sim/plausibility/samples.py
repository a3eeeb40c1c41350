"""Faults of samples that do not depend on the quantity: missing-value codes, signs, exchanged columns, time axes."""

from typing import NamedTuple

import numpy as np

from klute_sim.mask_runs import find_runs
from klute_sim.plausibility.units import Range
from klute_sim.types import Array, Mask

MISSING_VALUE_CODES = (
    -9999.0,
    -999.0,
    -99999.0,
    -9998.0,
    -99.99,
    -99.9,
    -888.0,
    -8888.0,
    9999.0,
    99999.0,
    999.0,
    999.9,
    9999.9,
    99999.9,
    -32768.0,
    -32767.0,
    32767.0,
    65535.0,
)
"""Numbers that programs write where a sample is missing."""
HUGE_VALUE = 1e15
"""Magnitude, in any unit, that only a code has (such as 1e30 or the largest number of a data type)."""
MIN_CODE_DISTANCE = 0.5
"""Smallest distance of a code from all other samples, relative to their span (assumed; a clipped signal has none)."""


class Samples(NamedTuple):
    """Samples of one channel with the unit in its heading."""

    channel: str
    """Name of the channel."""
    value: Array
    """Samples in SI units as read; may hold NaN."""
    unit: str
    """Unit in the heading."""
    factor: float
    """Factor of that unit to SI."""

    @property
    def finite(self) -> Array:
        """Samples that are not NaN."""
        return self.value[np.isfinite(self.value)]


class MissingValueCode(NamedTuple):
    """A number that stands for missing samples."""

    code: float
    """The number, in the unit of the heading."""
    n_samples: int
    """Number of samples with it."""


def find_missing_value_code(samples: Samples) -> MissingValueCode | None:
    """Return the code for missing samples that ``samples`` holds, or None.

    A known code counts where it is far from all other samples, and any huge number counts.
    """
    written = samples.finite / samples.factor
    if written.size == 0:
        return None
    is_huge = np.abs(written) > HUGE_VALUE
    if is_huge.any() and not is_huge.all():
        return MissingValueCode(float(written[is_huge][0]), int(is_huge.sum()))
    for code in MISSING_VALUE_CODES:
        is_code = np.isclose(written, code, rtol=1e-9, atol=0.0)
        others = written[~is_code]
        if not is_code.any() or others.size == 0:
            continue
        low, high = float(others.min()), float(others.max())
        if max(code - high, low - code) > MIN_CODE_DISTANCE * max(high - low, 0.1 * abs(code)):
            return MissingValueCode(code, int(is_code.sum()))
    return None


def find_zero_blocks(values: Array, min_length: int) -> Mask:
    """Return which of ``values`` lie in runs of at least ``min_length`` exact zeros."""
    is_zero = values == 0.0
    mask = np.zeros(len(values), dtype=np.bool_)
    for start, stop in find_runs(is_zero):
        mask[start:stop] = stop - start >= min_length
    return mask


def compute_negative_share(values: Array) -> float:
    """Return the share of negative samples in the sum of magnitudes of the finite ``values`` (0 to 1)."""
    finite = values[np.isfinite(values)]
    total = float(np.abs(finite).sum())
    return float(-finite[finite < 0.0].sum()) / total if total > 0.0 else 0.0


def are_exchanged(first: Samples, second: Samples, first_range: Range, second_range: Range) -> bool:
    """Return whether each of two channels is implausible as it stands and plausible under the other's heading.

    The ranges hold for the median magnitudes of the samples.
    """
    if first.finite.size == 0 or second.finite.size == 0:
        return False
    medians = [float(np.median(np.abs(samples.finite))) for samples in (first, second)]
    if first_range.contains(medians[0]) or second_range.contains(medians[1]):
        return False
    as_first = medians[1] / second.factor * first.factor
    as_second = medians[0] / first.factor * second.factor
    return first_range.contains(as_first) and second_range.contains(as_second)


def compute_correlation(first: Array, second: Array) -> float:
    """Return the correlation of the samples that are finite in both arrays; 0 where one is constant."""
    is_finite = np.isfinite(first) & np.isfinite(second)
    if is_finite.sum() < 3:
        return 0.0
    a, b = first[is_finite] - first[is_finite].mean(), second[is_finite] - second[is_finite].mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0.0 else 0.0
