"""Sign and unit of measured forces and moments, by the static loads of the declared devices.

The tension of a device at rest, at the lengths and pressures of each moment, explains the level of a measured force in
slow motion to 30 %, whatever the device lacks. Therefore only a factor of three or more is judged.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.samples import Samples, compute_correlation
from klute_sim.plausibility.units import UNITS, format_range
from klute_sim.types import Array

MIN_LOAD_FRACTION = 0.05
"""Smallest expected load, over the largest of the devices, that shows a scale (assumed)."""
MIN_NET_FRACTION = 0.5
"""Smallest expected moment, over the sum of those of the single devices, that shows a scale (assumed: the difference of
two antagonists that are 30 % off each may have any)."""
MIN_VARIATION = 0.15
"""Smallest standard deviation of an expected load, over its level, that shows a waveform (assumed)."""
MIN_CORRELATION = 0.7
"""Smallest correlation with the expected time series (assumed; delays reduce it)."""
MAX_SCALE = 3.0
"""Largest ratio of a right load to the expected one, and of the expected one to it (assumed: a muscle of twice or half
the strength, or a moment arm twice as long, is possible; newton and pound-force differ by 4.4)."""
MAX_GAIN = 1.5
"""Largest ratio of a load to the expected one that a misfit leaves out, and of this to the load (assumed: laws and
sensors are off)."""
UNIT_TOLERANCE = 1.4
"""Largest ratio of a scale to that of a wrong unit (assumed: laws are up to 30 % off)."""


class LoadSeries(NamedTuple):
    """Measured and expected load at some moments of a trial, averaged over slow motion; NaN where they are unknown."""

    samples: Samples
    """Measured samples."""
    measured: Array
    """Measured load [N or N m]."""
    expected: Array
    """Static load of the devices [N or N m]."""
    gross: Array
    """Sum of the magnitudes of the loads of the single devices [N or N m]."""
    max_load: float
    """Largest load of the devices [N or N m]."""
    place: str
    """Name of the trial in messages."""

    @property
    def is_informative(self) -> bool:
        """Whether the expected load is large enough to show the scale of the measured one."""
        size = compute_size(self.expected)
        is_large = size > MIN_LOAD_FRACTION * self.max_load and size > 0.0
        return is_large and size >= MIN_NET_FRACTION * compute_size(self.gross)

    @property
    def scale(self) -> float:
        """Ratio of the measured to the expected load, by least squares."""
        return _compute_ratio(self.measured, self.expected)

    @property
    def varies(self) -> bool:
        """Whether the expected load varies."""
        return compute_variation(self.expected) > MIN_VARIATION

    @property
    def correlation(self) -> float:
        """Correlation of measured and expected load."""
        return compute_correlation(self.measured, self.expected)


def compute_size(values: Array) -> float:
    """Return the root mean square of the ``values`` that are not NaN; 0 without any."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else 0.0


def compute_variation(values: Array) -> float:
    """Return the standard deviation of the ``values`` that are not NaN over their size; 0 without any."""
    size = compute_size(values)
    return float(np.nanstd(values)) / size if size > 0.0 else 0.0


def _compute_ratio(measured: Array, expected: Array) -> float:
    """Return the factor of ``expected`` that gives ``measured``, by least squares; 1 where all are 0."""
    power = float(np.nansum(expected**2))
    return float(np.nansum(measured * expected)) / power if power > 0.0 else 1.0


def compute_misfit(measured: Array, expected: Array) -> float:
    """Return the size of the difference of ``measured`` from ``expected`` times a gain near 1."""
    gain = float(np.clip(_compute_ratio(measured, expected), 1.0 / MAX_GAIN, MAX_GAIN))
    return compute_size(measured - gain * expected)


def check_load_scale(series: Sequence[LoadSeries]) -> list[Finding]:
    """Return findings for all ``series`` of a channel if these have the opposite sign or another unit."""
    judged = [load for load in series if load.is_informative]
    if not judged:
        return []
    scales = np.array([load.scale for load in judged])
    sign = float(np.sign(np.median(scales)))
    if any(sign * load.correlation < MIN_CORRELATION for load in judged if load.varies):
        return []
    if sign < 0.0:
        is_near = np.all((scales > -MAX_SCALE) & (scales < -1.0 / MAX_SCALE))
        return [_describe_sign(load) for load in judged] if is_near else []
    unit = _guess_unit(judged[0].samples, scales)
    return [_describe_unit(load, unit) for load in judged] if unit else []


def _guess_unit(samples: Samples, scales: Array) -> str:
    """Return the unit that explains all ``scales``; '' if there is none, or the unit in the heading may be right."""
    for unit, factor in UNITS["N*m" if samples.channel.startswith("moment_") else "N"].items():
        ratio = samples.factor / factor
        is_far = max(ratio, 1.0 / ratio) > MAX_SCALE
        if is_far and np.all(np.abs(np.log(np.maximum(scales, 1e-12) / ratio)) < math.log(UNIT_TOLERANCE)):
            return unit
    return ""


def _state(load: LoadSeries) -> str:
    """Return measured and expected load in words."""
    samples = load.samples
    measured = format_range(load.measured, samples.unit, samples.factor)
    expected = format_range(load.expected, samples.unit, samples.factor)
    return (
        f"`{samples.channel}` is {measured} in slow motion, but the declared devices give {expected} at these "
        "positions and pressures"
    )


def _describe_sign(load: LoadSeries) -> Finding:
    is_moment = load.samples.channel.startswith("moment_")
    rule = "a moment is positive where it turns the joint to larger angles" if is_moment else "tension is positive"
    statement = f"{_state(load)}: its sign seems reversed; {rule}"
    return Finding(f"{load.samples.channel}-sign", load.place, statement)


def _describe_unit(load: LoadSeries, unit: str) -> Finding:
    statement = f"{_state(load)}: is its unit {unit}? Correct the heading, or the numbers of the device"
    return Finding(f"{load.samples.channel}-unit", load.place, statement)
