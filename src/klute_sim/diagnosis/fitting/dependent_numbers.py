"""Numbers of a device that depend on fitted ones, so that every fitted device is a valid device file.

The braid lies on the bladder, so the bladder radius follows braid length and turns unless it is fitted itself; the wall
leaves room for air; no number leaves the range of the device file.
"""

import math
from collections.abc import Mapping

from klute_sim.device.schema.limits import find_limits
from klute_sim.device.schema.muscle import MAX_RADIUS_MISMATCH, MIN_GAS_FRACTION
from klute_sim.laws import mckibben

RELATION_MARGIN = 0.02
"""Fraction by which dependent numbers stay inside their limits, so that rounding does not cross them."""
RADIUS, THICKNESS = "muscle.bladder_radius_mm", "muscle.bladder_thickness_mm"
BRAID_RATIO, TURNS = "muscle.braid_length_ratio", "muscle.turns_per_m"


def complete_numbers(values: Mapping[str, float], fitted: Mapping[str, float]) -> dict[str, float]:
    """Return ``fitted`` within the limits of a device file, and the numbers that follow from them.

    ``values`` are all numbers of the device before the fit, ``section.key`` -> value in the unit of the key.
    """
    changed = {key: min(max(value, find_limits(key)[0]), find_limits(key)[1]) for key, value in fitted.items()}
    if not changed.keys() & {RADIUS, THICKNESS, BRAID_RATIO, TURNS}:
        return changed
    new = {**values, **changed}
    braid_radius = _compute_radius_at_rest(new)
    radius = new[RADIUS]
    if RADIUS not in changed:
        radius *= braid_radius / _compute_radius_at_rest(values)
    mismatch = MAX_RADIUS_MISMATCH * (1.0 - RELATION_MARGIN)
    radius = min(max(radius, braid_radius / (1.0 + mismatch)), braid_radius / (1.0 - mismatch))
    # The air has at least a part of the braid's cross section.
    wall_area = radius * radius - (1.0 - (1.0 + RELATION_MARGIN) * MIN_GAS_FRACTION) * braid_radius * braid_radius
    max_thickness = radius - math.sqrt(max(wall_area, (RELATION_MARGIN * radius) ** 2))
    thickness = min(new[THICKNESS], max_thickness)
    if radius != values[RADIUS]:
        changed[RADIUS] = radius
    if thickness != values[THICKNESS]:
        changed[THICKNESS] = thickness
    return changed


def _compute_radius_at_rest(values: Mapping[str, float]) -> float:
    """Return the radius [mm] of the braid at rest; a muscle of 1 m has the same."""
    return 1e3 * mckibben.compute_braid_radius(values[BRAID_RATIO], 1.0, values[TURNS])
