"""Friction with a bristle state, after Canudas de Wit, Olsson, Åström and Lischinsky (1995), in relative deflection."""

import math

from benchmarks.hidden_effects.adversary.compiled import compile_cached

STRIBECK_SPEED = 8e-3
"""Speed at which the excess of the friction at rest has fallen to 1/e [m/s] (assumed)."""


@compile_cached
def deflect(bristle: float, travel: float, duration: float, reach: float, excess: float) -> float:
    """Return the relative deflection of the bristles after ``travel`` [m] in ``duration`` [s].

    LuGre: du/dt = (v - |v| u / g(v)) / reach with g = 1 + excess exp(-(v/vs)²), solved exactly for a constant velocity.
    The friction is u times its level; |u| never exceeds the larger of 1 + excess and its initial value.
    """
    if travel == 0.0:
        return bristle
    velocity = travel / duration
    level = 1.0 + excess * math.exp(-((velocity / STRIBECK_SPEED) ** 2))
    end = math.copysign(level, travel)
    return end + (bristle - end) * math.exp(-abs(travel) / (reach * level))
