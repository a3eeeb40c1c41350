"""Reward of a predicted walk: a person who keeps walking, at the target speed, evenly and with little effort.

Every weight is assumed: a speed 0.1 m/s beside the target costs as much as 0.3 J/kg/m, and a step asymmetry of 0.1 too.
Errors are limited, so that to keep walking is nearly always worth more than to fall.
"""

from collections.abc import Mapping

import numpy as np

from klute_sim.types import Array

DEFAULT_WEIGHTS: Mapping[str, float] = {
    "survival": 1.0,
    "effort": -0.1,
    "speed": -3.0,
    "symmetry": -3.0,
    "smoothness": -0.05,
    "fall": -10.0,
}
"""Weights of the reward terms, all assumed: 1 for every interval walked; metabolic power over body mass and target
speed [J/kg/m], the mean of both laws; squared error of the speed [m2/s2]; squared asymmetry of the last two steps [1];
squared change of the action [1]; and 1 for a fall.
"""
REWARD_TERMS = tuple(f"reward_{name}" for name in DEFAULT_WEIGHTS)
"""Names of the terms in ``info``."""
MAX_SPEED_ERROR, MAX_ASYMMETRY = 0.4, 0.3
"""Error of the speed [m/s] and asymmetry [1] beyond which their cost grows no more (assumed)."""


def compute_terms(
    has_fallen: Array, metabolic_cost: Array, speed_error: Array, step_asymmetry: Array, action_change: Array
) -> Array:
    """Return the reward terms (n, 6) before they are weighted.

    ``has_fallen`` (n,) is 0 or 1, ``metabolic_cost`` (n,) is in J/kg/m, ``speed_error`` (n,) in m/s, and
    ``step_asymmetry`` and ``action_change`` (n,) are dimensionless. A fall has no other term.
    """
    error = np.minimum(np.abs(speed_error), MAX_SPEED_ERROR)
    asymmetry = np.minimum(np.abs(step_asymmetry), MAX_ASYMMETRY)
    is_walking = 1.0 - has_fallen
    terms = np.array([is_walking, metabolic_cost, error**2, asymmetry**2, action_change**2, has_fallen]).T
    if has_fallen.any():
        terms[has_fallen > 0.0, :-1] = 0.0
    return terms
