"""The artificial tendon in series with the muscle (dissertation chapters 5-6).

Two offset parallel linear springs (Frisen 1969): the first pulls from slack length on, the second joins
after an engagement stretch. A tendon never pushes.
"""

import math
from typing import NamedTuple


class TendonParameters(NamedTuple):
    """Two offset springs, or a rigid tie."""

    slack_length: float
    """Length at which the first spring begins to pull [m]; the length of a rigid tie."""
    stiffness_1: float
    """Ka, slope of the first spring [N/m]."""
    stiffness_2: float
    """Kb, slope that the second spring adds [N/m]."""
    engagement_stretch: float
    """x0, stretch at which the second spring joins [m]."""
    is_rigid: bool
    """Whether it is a rigid tie that neither stretches nor goes slack (a muscle clamped in a tester)."""


def force(tendon: TendonParameters, stretch: float) -> float:
    """Tension [N] at ``stretch`` [m] beyond slack length: ``Ka x + Kb max(0, x - x0)``, 0 when slack."""
    if stretch <= 0.0:
        return 0.0
    if stretch <= tendon.engagement_stretch:
        return tendon.stiffness_1 * stretch
    return tendon.stiffness_1 * stretch + tendon.stiffness_2 * (stretch - tendon.engagement_stretch)


def stored_energy(tendon: TendonParameters, stretch: float) -> float:
    """Stored energy [J] at ``stretch`` [m] beyond slack length: the integral of :func:`force`."""
    if stretch <= 0.0:
        return 0.0
    stored = 0.5 * tendon.stiffness_1 * stretch * stretch
    if stretch > tendon.engagement_stretch:
        beyond = stretch - tendon.engagement_stretch
        stored += 0.5 * tendon.stiffness_2 * beyond * beyond
    return stored


def stretch_at_tension(tendon: TendonParameters, tension: float) -> float:
    """Stretch [m] under ``tension`` [N] >= 0: the inverse of :func:`force`; NaN for a rigid tie."""
    if tendon.is_rigid:
        return math.nan
    if tension <= tendon.stiffness_1 * tendon.engagement_stretch:
        return tension / tendon.stiffness_1
    return (tension + tendon.stiffness_2 * tendon.engagement_stretch) / (tendon.stiffness_1 + tendon.stiffness_2)
