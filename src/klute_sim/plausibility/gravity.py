"""Gravity of a model: a magnitude that no place has, or a direction opposite to that of its file."""

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
MAX_OPPOSITE_COSINE = -0.99
"""Cosine of the angle between two directions that are opposite (assumed)."""
_WRONG_UNITS = {100.0: "cm/s2", 1000.0: "mm/s2"}


def check_gravity(gravity: Sequence[float], place: str, of_file: Sequence[float] = ()) -> list[Finding]:
    """Return a finding if the vector ``gravity`` [m/s2] of a model is neither 0 nor of a possible magnitude.

    It must not be opposite to that ``of_file``, the file of the model.
    """
    magnitude = math.hypot(*gravity)
    if magnitude == 0.0 or MIN_GRAVITY <= magnitude <= MAX_GRAVITY:
        return _check_direction(gravity, of_file, place)
    units = [
        unit for factor, unit in _WRONG_UNITS.items() if abs(magnitude / (factor * GRAVITY) - 1.0) < UNIT_TOLERANCE
    ]
    cause = f", so it looks like {units[0]}" if units else ""
    statement = (
        f"the gravity of the model is {round_digits(magnitude):g} m/s2{cause}; allowed: 0, or {MIN_GRAVITY:g} to "
        f"{MAX_GRAVITY:g} m/s2; correct `gravity` under `option` in the model, or model.option.gravity_x to _z"
    )
    return [Finding(GRAVITY_NAME, place, statement)]


def _check_direction(gravity: Sequence[float], of_file: Sequence[float], place: str) -> list[Finding]:
    size = math.hypot(*gravity) * math.hypot(*of_file)
    if size == 0.0 or sum(a * b for a, b in zip(gravity, of_file, strict=True)) > MAX_OPPOSITE_COSINE * size:
        return []
    model_vector, file_vector = (
        ", ".join(f"{round_digits(value):g}" for value in vector) for vector in (gravity, of_file)
    )
    statement = (
        f"the gravity of the model is ({model_vector}) m/s2, opposite to ({file_vector}) m/s2 in the file of the "
        "model; turn the sign of model.option.gravity_x to _z, unless the rig was mounted upside down"
    )
    return [Finding(GRAVITY_NAME, place, statement)]
