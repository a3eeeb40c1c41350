"""Exchanged columns of the forces of two devices, by the static tension of each and the load of the joint they move.

Laws that are 30 % off in opposite directions make two like forces look exchanged. At a free joint, the exchanged forces
therefore have to balance the load of the model, rather than the forces as they stand, whatever the laws.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.load_scale import LoadSeries, compute_misfit, compute_size
from klute_sim.types import Array

MIN_MISFIT = 0.35
"""Smallest difference of each force from its own expected tension, over the force (assumed: laws are up to 30 % off).
"""
MISFIT_RATIO = 3.0
"""Smallest ratio of that difference to the one from the tension of the other device (assumed)."""
MIN_DIFFERENCE = 0.15
"""Smallest expected difference of two forces, over their level, that shows which is which (assumed)."""
MAX_COSINE = -0.8
"""Largest cosine between the measured and the expected difference of two forces that are exchanged (assumed)."""
BALANCE_RATIO = 2.0
"""Smallest ratio of the unbalanced load of a free joint to the one with exchanged forces (assumed)."""


class Balance(NamedTuple):
    """Free joint between two devices, at the moments of a trial."""

    first_arm: Array
    """Moment or force on the joint per tension of the first device [m or 1]."""
    second_arm: Array
    """The same of the second device."""
    load: Array
    """Moment or force of gravity and springs [N m or N]."""

    def compute_residual(self, first: Array, second: Array) -> Array:
        """Return the unbalanced load [N m or N] under the tensions ``first`` and ``second`` [N]."""
        return first * self.first_arm + second * self.second_arm + self.load


class ForcePair(NamedTuple):
    """Forces of two devices in one trial, at the same moments."""

    first: LoadSeries
    second: LoadSeries
    balance: Balance | None
    """Free joint between them; None where all joints are driven."""


def check_exchanged_forces(pairs: Sequence[ForcePair]) -> list[Finding]:
    """Return a finding if each force of two devices, in the trials with ``pairs``, is the tension of the other device.

    In every trial in which the forces differ, the difference must be reversed.
    """
    cosines = [cosine for cosine in map(_compute_cosine, pairs) if cosine is not None]
    if not cosines or max(cosines) > MAX_COSINE or not _contradict_laws(pairs) or not _contradict_balance(pairs):
        return []
    first, second = (load.samples.channel for load in pairs[0][:2])
    statement = (
        f"`{first}` is the force that the device of `{second}` gives at these positions and pressures, and `{second}` "
        f"that of the device of `{first}`: their columns are exchanged; correct the headings"
    )
    return [Finding(f"{'-'.join(sorted((first, second)))}-exchanged", pairs[0].first.place, statement)]


def _compute_cosine(pair: ForcePair) -> float | None:
    """Return the cosine between measured and expected differences of two forces; None where these are small."""
    measured, expected = (getattr(pair.first, name) - getattr(pair.second, name) for name in ("measured", "expected"))
    level = max(compute_size(pair.first.expected), compute_size(pair.second.expected))
    if compute_size(expected) <= MIN_DIFFERENCE * level or compute_size(measured) == 0.0:
        return None
    return float(np.nanmean(measured * expected)) / (compute_size(measured) * compute_size(expected))


def _contradict_laws(pairs: Sequence[ForcePair]) -> bool:
    """Return whether both forces differ from their own tension, and agree with that of the other device."""
    measured, expected = (
        [np.concatenate([getattr(pair[index], name) for pair in pairs]) for index in (0, 1)]
        for name in ("measured", "expected")
    )
    misfits = [compute_size(measured[index] - expected[index]) for index in (0, 1)]
    others = [compute_misfit(measured[index], expected[1 - index]) for index in (0, 1)]
    are_far = all(misfit > MIN_MISFIT * compute_size(force) for misfit, force in zip(misfits, measured, strict=True))
    return are_far and all(misfit > MISFIT_RATIO * other for misfit, other in zip(misfits, others, strict=True))


def _contradict_balance(pairs: Sequence[ForcePair]) -> bool:
    """Return whether the exchanged forces balance the load of the free joint, or no joint is free."""
    residuals, exchanged_residuals = [], []
    for first, second, balance in pairs:
        if balance is not None:
            residuals.append(balance.compute_residual(first.measured, second.measured))
            exchanged_residuals.append(balance.compute_residual(second.measured, first.measured))
    return not residuals or compute_size(np.concatenate(residuals)) > BALANCE_RATIO * compute_size(
        np.concatenate(exchanged_residuals)
    )
