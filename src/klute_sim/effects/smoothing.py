"""Numerical elements that several effects share: smooth sign, slider and first-order follower."""

import math

SIGN_TRANSITION_SPEED = 1e-3
"""Speed over which dry friction changes its sign [m/s] (assumed; small against the speeds of all tests)."""
EQUILIBRIUM_TIME_STEP = 1e9
"""Time step after which every follower has reached its target and every slider has relaxed [s] (assumed)."""


def smooth_sign(velocity: float) -> float:
    """Return ``v / sqrt(v^2 + SIGN_TRANSITION_SPEED^2)``: a smooth, increasing sign of ``velocity`` [m/s]."""
    return velocity / math.sqrt(velocity * velocity + SIGN_TRANSITION_SPEED * SIGN_TRANSITION_SPEED)


def step_slider(slider_position: float, position: float, max_distance: float, dt: float) -> float:
    """Return the position of a slider after a time step ``dt`` [s].

    The slider stays within ``max_distance`` >= 0 of ``position`` and moves only when pulled. After
    :data:`EQUILIBRIUM_TIME_STEP` it has relaxed to ``position``.
    """
    return (
        position
        if dt >= EQUILIBRIUM_TIME_STEP
        else min(max(slider_position, position - max_distance), position + max_distance)
    )


def step_follower(value: float, target: float, time_constant: float, dt: float) -> float:
    """Return a first-order follower of ``target`` after a time step ``dt`` [s] (backward Euler).

    ``time_constant`` is positive [s].
    """
    fraction = dt / (time_constant + dt)
    return value + fraction * (target - value)
