"""Reward of a gait run: an ankle that moves and pushes like the human one under the human load.

Little air and smooth actions are rewarded, too. The rig holds the hip on its path, so a foot that pushes against it
would otherwise be rewarded for a load that nobody carries.
"""

import math
from collections.abc import Mapping
from numbers import Real

import numpy as np

from klute_sim.errors import InputError
from klute_sim.types import Array

DEFAULT_WEIGHTS: Mapping[str, float] = {
    "moment": 0.4,
    "angle": 0.3,
    "power": 0.3,
    "work": 0.1,
    "air": -0.1,
    "smoothness": -0.05,
    "load": -2.0,
    "braking": -20.0,
}
"""Weights of the reward terms: closeness to the human ankle in net moment, angle and power, each 0 to 1; mean
positive power up to that of the human ankle; air drawn [g per 0.1 s]; squared change of the action [1]; squared error
of the vertical ground reaction [body weights squared]; squared braking beyond :data:`MAX_BRAKING_BW` [body weights
squared]. The last two weights are assumed: a slam of 1.5 body weights costs as much as a moment far from the human one.
"""
REWARD_TERMS = tuple(f"reward_{name}" for name in DEFAULT_WEIGHTS)
"""Names of the terms in ``info``."""

ERROR_SCALES = np.array([0.2, np.radians(5.0), 0.5])
"""Errors of moment [N*m/kg], angle [rad] and power [W/kg] at which closeness falls to exp(-1/2)."""
MAX_BRAKING_BW = 0.2
"""Braking [body weights] without cost; the default reference brakes with 0.16."""
MAX_LOAD_ERROR_BW, MAX_EXCESS_BRAKING_BW = 1.0, 0.2
"""Errors of load and braking [body weights] beyond which their cost grows no more (assumed)."""


def resolve_weights(overrides: Mapping[str, float] | None, defaults: Mapping[str, float] = DEFAULT_WEIGHTS) -> Array:
    """Return ``defaults`` with ``overrides``; raises InputError when a term is unknown or not finite."""
    for name, value in (overrides or {}).items():
        if name not in defaults:
            raise InputError(f"reward has no term '{name}'; allowed: {', '.join(defaults)}")
        if not (isinstance(value, Real) and math.isfinite(value)):
            raise InputError(f"the reward weight of {name} is {value}; allowed: a finite number")
    return np.array([float(value) for value in {**defaults, **(overrides or {})}.values()])


def compute_terms(
    ankle: Array,
    reference: Array,
    mean_push_power: Array,
    air_rate: Array,
    action_change: Array,
    ground_reaction: Array,
    reference_load: Array,
) -> Array:
    """Return the reward terms (n, 8) before they are weighted.

    ``ankle`` and ``reference`` (n, 3) are net moment [N*m/kg], angle [rad] and power [W/kg]; ``mean_push_power`` (n,)
    is the mean positive power of the human ankle [W/kg], ``air_rate`` (n,) is in g per 0.1 s, and ``action_change``
    (n,) is dimensionless. ``ground_reaction`` (n, 2), fore-aft and vertical, and the vertical ``reference_load`` (n,)
    are in body weights.
    """
    error = (ankle - reference) / ERROR_SCALES
    closeness = np.exp(-0.5 * error * error)
    push = np.maximum(np.minimum(ankle[:, 2], reference[:, 2]), 0.0) / mean_push_power
    load_error = np.clip(ground_reaction[:, 1] - reference_load, -MAX_LOAD_ERROR_BW, MAX_LOAD_ERROR_BW)
    braking = np.clip(-ground_reaction[:, 0] - MAX_BRAKING_BW, 0.0, MAX_EXCESS_BRAKING_BW)
    return np.column_stack([closeness, push, air_rate, action_change * action_change, load_error**2, braking**2])
