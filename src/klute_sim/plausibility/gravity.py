"""Unit of the gravity of a model: a magnitude that no place has."""

import math
from collections.abc import Sequence

from klute_sim.constants import GRAVITY
from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.units import round_digits

GRAVITY_NAME = "gravity"
"""Name of the finding."""
MIN_GRAVITY, MAX_GRAVITY = 0.5, 30.0
"""Limits of gravity [m/s2] (assumed: from a small moon to the largest planet); 0 is a model without gravity."""
UNIT_TOLERANCE = 0.05
"""Largest relative deviation from a multiple of standard gravity that is taken for a wrong unit (assumed)."""
_WRONG_UNITS = {100.0: "cm/s2", 1000.0: "mm/s2"}


def check_gravity(gravity: Sequence[float], place: str) -> list[Finding]:
    """Return a finding if the vector ``gravity`` [m/s2] of a model is neither 0 nor of a possible magnitude."""
    magnitude = math.hypot(*gravity)
    if magnitude == 0.0 or MIN_GRAVITY <= magnitude <= MAX_GRAVITY:
        return []
    units = [
        unit for factor, unit in _WRONG_UNITS.items() if abs(magnitude / (factor * GRAVITY) - 1.0) < UNIT_TOLERANCE
    ]
    cause = f", so it looks like {units[0]}" if units else ""
    statement = (
        f"the gravity of the model is {round_digits(magnitude):g} m/s2{cause}; allowed: 0, or {MIN_GRAVITY:g} to "
        f"{MAX_GRAVITY:g} m/s2; correct `gravity` under `option` in the model, or model.option.gravity_x to _z"
    )
    return [Finding(GRAVITY_NAME, place, statement)]
