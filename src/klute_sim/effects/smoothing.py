"""Shapes that several effects share."""

import math

SIGN_TRANSITION_SPEED = 1e-3
"""Speed [m/s] over which dry friction turns round (assumed; small beside any test's speed)."""
EQUILIBRIUM_TIME_STEP = 1e9
"""A step [s] after which everything has settled: followers have arrived, and sliders have let go (assumed)."""


def smooth_sign(rate: float) -> float:
    """``rate / sqrt(rate^2 + SLIDING^2)``: the sign of ``rate`` [m/s], smooth and increasing."""
    return rate / math.sqrt(rate * rate + SIGN_TRANSITION_SPEED * SIGN_TRANSITION_SPEED)


def step_slider(slider_position: float, position: float, max_distance: float, dt: float) -> float:
    """Where a slider is that lets ``position`` go no further than ``reach`` >= 0 from it, a ``step`` [s] later.

    It moves only when pulled; after a :data:`LONG` time it has let go.
    """
    return (
        position
        if dt >= EQUILIBRIUM_TIME_STEP
        else min(max(slider_position, position - max_distance), position + max_distance)
    )


def step_follower(value: float, target: float, time_constant: float, dt: float) -> float:
    """First-order follower of ``position`` a ``step`` [s] later (backward Euler); ``time_constant`` > 0 [s]."""
    share = dt / (time_constant + dt)
    return value + share * (target - value)
