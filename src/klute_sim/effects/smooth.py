"""Shapes that several effects share."""

import math

SLIDING = 1e-3
"""Speed [m/s] over which dry friction turns round (assumed; small beside any test's speed)."""
LONG = 1e9
"""A step [s] after which everything has settled: followers have arrived, and sliders have let go (assumed)."""


def sign(rate: float) -> float:
    """``rate / sqrt(rate^2 + SLIDING^2)``: the sign of ``rate`` [m/s], smooth and increasing."""
    return rate / math.sqrt(rate * rate + SLIDING * SLIDING)


def dragged(slider: float, position: float, reach: float, step: float) -> float:
    """Where a slider is that lets ``position`` go no further than ``reach`` >= 0 from it, a ``step`` [s] later.

    It moves only when pulled; after a :data:`LONG` time it has let go.
    """
    return position if step >= LONG else min(max(slider, position - reach), position + reach)


def followed(follower: float, position: float, time_constant: float, step: float) -> float:
    """First-order follower of ``position`` a ``step`` [s] later (backward Euler); ``time_constant`` > 0 [s]."""
    share = step / (time_constant + step)
    return follower + share * (position - follower)
