"""Direction of a driven joint whose loads were measured: a reversed sign of its position.

A reversed position stretches the devices where they were shortened. It is reported if the loads change against the
expected ones, and agree with the position mirrored about zero. The loads of a free joint are those that it carries,
whatever its position.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.load_scale import (
    MAX_SCALE,
    MIN_CORRELATION,
    LoadSeries,
    compute_misfit,
    compute_size,
    compute_variation,
)
from klute_sim.plausibility.samples import Samples
from klute_sim.plausibility.units import format_range

MIN_MISFIT = 0.1
"""Smallest difference of the loads from the expected ones, over the loads (assumed)."""
MISFIT_RATIO = 3.0
"""Smallest ratio of that difference to the one with the mirrored position (assumed)."""
MAX_REVERSED_CORRELATION = -0.7
"""Largest correlation with the expected time series in a trial that shows the reversal (assumed)."""
MIN_VARIATION = 0.05
"""Smallest standard deviation of an expected load, over its level, that shows a reversal (assumed)."""


class MirroredLoad(NamedTuple):
    """A measured load, with the expected one at the position of the joint as it stands and at the mirrored one."""

    declared: LoadSeries
    mirrored: LoadSeries

    @property
    def shows_reversal(self) -> bool:
        """Whether the load changes against the position as it stands, and with the mirrored one."""
        varies = all(compute_variation(series.expected) > MIN_VARIATION for series in self)
        is_reversed = self.declared.correlation < MAX_REVERSED_CORRELATION
        return varies and is_reversed and self.mirrored.correlation > MIN_CORRELATION

    @property
    def agrees(self) -> bool:
        """Whether the load is that of the mirrored position."""
        has_waveform = not self.mirrored.varies or self.mirrored.correlation > MIN_CORRELATION
        return has_waveform and 1.0 / MAX_SCALE < self.mirrored.scale < MAX_SCALE


def check_joint_direction(positions: Sequence[tuple[str, Samples]], loads: Sequence[MirroredLoad]) -> list[Finding]:
    """Return a finding for each of the ``positions`` of a joint (name of the trial, samples) if its sign is reversed.

    ``loads`` are all that depend on the joint.
    """
    judged = [load for load in loads if load.mirrored.is_informative and compute_size(load.mirrored.measured) > 0.0]
    if not any(load.shows_reversal for load in judged) or not all(load.agrees for load in judged):
        return []
    sizes = np.array([compute_size(load.mirrored.measured) for load in judged])
    before = np.array([compute_size(load.declared.measured - load.declared.expected) for load in judged]) / sizes
    after = np.array([compute_misfit(load.mirrored.measured, load.mirrored.expected) for load in judged]) / sizes
    misfit = compute_size(before)
    if misfit < MIN_MISFIT or misfit < MISFIT_RATIO * compute_size(after):
        return []
    return [_describe(place, samples, judged[0].mirrored.samples.channel) for place, samples in positions]


def _describe(place: str, samples: Samples, load: str) -> Finding:
    statement = (
        f"`{samples.channel}` is {format_range(samples.value, samples.unit, samples.factor)}, but `{load}` is that of "
        "the declared devices only at the opposite position: its sign is reversed; turn it in [columns]"
    )
    return Finding(f"{samples.channel}-sign", place, statement)
