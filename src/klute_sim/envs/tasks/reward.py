"""What a walk is worth: an ankle that moves and pushes like the human one, on little air and without jerks."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from klute_sim.errors import InputError

Array = NDArray[np.float64]

DEFAULT_WEIGHTS: Mapping[str, float] = {
    "moment": 0.4,
    "angle": 0.3,
    "power": 0.3,
    "work": 0.1,
    "air": -0.1,
    "smoothness": -0.05,
}
"""Closeness to the human ankle in net moment, angle and power, each 0-1; positive power as far as the human ankle has
it, in its mean; air drawn [g per 0.1 s]; squared change of the action [1]."""
REWARD_TERMS = tuple(f"reward_{name}" for name in DEFAULT_WEIGHTS)

ERROR_SCALES = np.array([0.2, np.radians(5.0), 0.5])
"""Distances from the reference in moment [N*m/kg], angle [rad] and power [W/kg] that count as one."""


def resolve_weights(overrides: Mapping[str, float] | None) -> Array:
    """:data:`WEIGHTS` with those that are ``asked`` for in their places; raises InputError for another term."""
    for name, value in (overrides or {}).items():
        if name not in DEFAULT_WEIGHTS:
            raise InputError(f"reward has no term '{name}'; allowed: {', '.join(DEFAULT_WEIGHTS)}")
        if not math.isfinite(value):
            raise InputError(f"the reward's weight of {name} is {value:g}; allowed: a finite number")
    return np.array([float(value) for value in {**DEFAULT_WEIGHTS, **(overrides or {})}.values()])


def compute_terms(
    ankle: Array, reference: Array, mean_push_power: Array, air_rate: Array, action_change: Array
) -> Array:
    """(n, 6) what :data:`WEIGHTS` are of.

    ``ankle`` and ``human`` (n, 3) are net moment [N*m/kg], angle [rad] and power [W/kg]; ``usual_push`` (n,) the mean
    positive power of the human ankle [W/kg], ``air`` (n,) [g per 0.1 s] and ``change`` (n,) of the action.
    """
    apart = (ankle - reference) / ERROR_SCALES
    close = np.exp(-0.5 * apart * apart)
    push = np.maximum(np.minimum(ankle[:, 2], reference[:, 2]), 0.0) / mean_push_power
    return np.column_stack([close, push, air_rate, action_change * action_change])
