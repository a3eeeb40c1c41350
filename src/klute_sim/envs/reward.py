"""What a walk is worth: an ankle that moves and pushes like the human one, on little air and without jerks."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from klute_sim.errors import InputError

Array = NDArray[np.float64]

WEIGHTS: Mapping[str, float] = {
    "moment": 0.4,
    "angle": 0.3,
    "power": 0.3,
    "work": 0.1,
    "air": -0.1,
    "smoothness": -0.05,
}
"""Closeness to the human ankle in net moment, angle and power, each 0-1; positive power as far as the human ankle has
it, in its mean; air drawn [g per 0.1 s]; squared change of the action [1]."""
TERMS = tuple(f"reward_{name}" for name in WEIGHTS)

SCALES = np.array([0.2, np.radians(5.0), 0.5])
"""Distances from the reference in moment [N*m/kg], angle [rad] and power [W/kg] that count as one."""


def weights(asked: Mapping[str, float] | None) -> Array:
    """:data:`WEIGHTS` with those that are ``asked`` for in their places; raises InputError for another term."""
    for name, value in (asked or {}).items():
        if name not in WEIGHTS:
            raise InputError(f"reward has no term '{name}'; allowed: {', '.join(WEIGHTS)}")
        if not math.isfinite(value):
            raise InputError(f"the reward's weight of {name} is {value:g}; allowed: a finite number")
    return np.array([float(value) for value in {**WEIGHTS, **(asked or {})}.values()])


def terms(ankle: Array, human: Array, usual_push: Array, air: Array, change: Array) -> Array:
    """(n, 6) what :data:`WEIGHTS` are of.

    ``ankle`` and ``human`` (n, 3) are net moment [N*m/kg], angle [rad] and power [W/kg]; ``usual_push`` (n,) the mean
    positive power of the human ankle [W/kg], ``air`` (n,) [g per 0.1 s] and ``change`` (n,) of the action.
    """
    apart = (ankle - human) / SCALES
    close = np.exp(-0.5 * apart * apart)
    push = np.maximum(np.minimum(ankle[:, 2], human[:, 2]), 0.0) / usual_push
    return np.column_stack([close, push, air, change * change])
