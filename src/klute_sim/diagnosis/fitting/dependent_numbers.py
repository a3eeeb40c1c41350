"""Numbers of a device that depend on fitted ones, so that every fitted device is a valid device file.

The braid lies on the bladder, so the bladder radius follows an uncertain braid length and uncertain turns unless it is
fitted itself. If braid length or turns are wrong in the file, the radius stays: it was measured by itself. The wall
leaves room for air; no number leaves the range of the device file. A device that is built into an ankle stays where it
is mounted.
"""

import math
from collections.abc import Collection, Mapping
from typing import Any

from klute_sim.datasets.mechanism import DEVICE_SEPARATOR, SIGNED_PREFIXES
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.schema.document import DeviceSpec
from klute_sim.device.schema.limits import find_limits
from klute_sim.device.schema.muscle import MAX_RADIUS_MISMATCH, MIN_GAS_FRACTION
from klute_sim.laws import mckibben
from klute_sim.plausibility.device_numbers import limit_to_plausible

MIN_NUMBER_FRACTION = 1e-3
"""Lower limit of a positive number, as a fraction of its nominal value."""
RELATION_MARGIN = 0.02
"""Fraction by which dependent numbers stay inside their limits, so that rounding does not cross them."""
RADIUS, THICKNESS = "muscle.bladder_radius_mm", "muscle.bladder_thickness_mm"
C10, C01 = "muscle.c10_kpa", "muscle.c01_kpa"
BRAID_RATIO, TURNS = "muscle.braid_length_ratio", "muscle.turns_per_m"
RESTING_LENGTH, SLACK_LENGTH = "muscle.resting_length_mm", "tendon.slack_length_mm"
NEUTRAL_RATIO = "mounting.neutral_muscle_ratio"
VALUE, SAME_ANGLE, SAME_RADIUS, SAME_RATIO = "value", "same_angle", "same_radius", "same_ratio"
"""Forms of a wrong number: alone; a bladder radius with turns that keep the angle of the braid; turns with a length of
the braid that keeps its radius; and a c10 with a c01 that keeps their ratio."""


def derive_numbers(
    values: Mapping[str, float], fitted: Mapping[str, float], forms: Collection[str]
) -> dict[str, float]:
    """Return the numbers that follow from ``fitted`` ones because they were computed from them, or are in proportion.

    ``values`` are all numbers of the device before the fit, ``section.key`` -> value in the unit of the key. ``forms``
    say what stays: :data:`SAME_ANGLE` a of the braid, by ``tan a = 2 pi R N / L0`` with radius R and turns N;
    :data:`SAME_RADIUS`, by this and ``cos a = L0 / B`` with the length B of the braid; or :data:`SAME_RATIO` of the
    moduli of the rubber. Without a change, each is exactly that of the file.
    """
    present, derived = {**values, **fitted}, {}
    if SAME_RADIUS in forms and TURNS in fitted:  # not turns that follow a radius: they say nothing about the angle
        ratio, scale = present[BRAID_RATIO], fitted[TURNS] / values[TURNS]  # of the tangent
        derived[BRAID_RATIO] = ratio * math.sqrt(1.0 + (1.0 - ratio**-2) * (scale * scale - 1.0))
    if SAME_ANGLE in forms and RADIUS in fitted:
        derived[TURNS] = present[TURNS] * (values[RADIUS] / fitted[RADIUS])
    if SAME_RATIO in forms and C10 in fitted:
        derived[C01] = present[C01] * (fitted[C10] / values[C10])
    return derived


def complete_numbers(
    values: Mapping[str, float], fitted: Mapping[str, float], wrong: Collection[str] = ()
) -> dict[str, float]:
    """Return ``fitted`` within the limits of a device file, and the numbers that follow from them.

    ``values`` are all numbers of the device before the fit, ``section.key`` -> value in the unit of the key. ``wrong``
    are the keys of ``fitted`` whose number in the file is wrong; other numbers do not follow them further than a valid
    file requires.
    """
    changed = {key: min(max(value, find_limits(key)[0]), find_limits(key)[1]) for key, value in fitted.items()}
    if not changed.keys() & {RADIUS, THICKNESS, BRAID_RATIO, TURNS}:
        return changed
    new = {**values, **changed}
    braid_radius = _compute_radius_at_rest(new)
    radius = new[RADIUS]
    if RADIUS not in changed:
        uncertain = {key: value for key, value in changed.items() if key not in wrong}
        radius *= _compute_radius_at_rest({**values, **uncertain}) / _compute_radius_at_rest(values)
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


def hold_mounting(values: Mapping[str, float], corrected: Mapping[str, float]) -> dict[str, float]:
    """Return ``corrected`` with the neutral ratio at which the device is mounted where the fit has it.

    Both are ``section.key`` -> value in the unit of the key. A muscle or tendon whose length was wrong is mounted where
    it was. A ratio that is corrected itself moves the mounting by the correction (:func:`move_mounting`). The ratio
    stays within its limits (:func:`compute_mounting_error`), and as it is where no length is corrected.
    """
    ratio = _compute_neutral_ratio(values, corrected)
    if ratio is None:
        return dict(corrected)
    lower, upper = find_limits(NEUTRAL_RATIO)
    return {**corrected, NEUTRAL_RATIO: min(max(ratio, lower), upper)}


def compute_mounting_error(values: Mapping[str, float], corrected: Mapping[str, float]) -> float:
    """Return by how much longer [mm] the device is in a file than in the fit, because its neutral ratio is limited."""
    ratio = _compute_neutral_ratio(values, corrected)
    if ratio is None:
        return 0.0
    return (hold_mounting(values, corrected)[NEUTRAL_RATIO] - ratio) * {**values, **corrected}[RESTING_LENGTH]


def _compute_neutral_ratio(values: Mapping[str, float], corrected: Mapping[str, float]) -> float | None:
    """Return the neutral ratio of the fit, without limits; None where it is that of ``corrected`` or ``values``."""
    is_mounted = {NEUTRAL_RATIO, SLACK_LENGTH} <= values.keys()
    if not is_mounted or not corrected.keys() & {RESTING_LENGTH, SLACK_LENGTH}:
        return None
    mounting_length = values[NEUTRAL_RATIO] * values[RESTING_LENGTH] + values[SLACK_LENGTH]
    new = {**values, **corrected}
    return (mounting_length - new[SLACK_LENGTH]) / new[RESTING_LENGTH] + new[NEUTRAL_RATIO] - values[NEUTRAL_RATIO]


def move_mounting(parameters: DeviceParameters, declared: DeviceSpec, corrected: DeviceSpec) -> DeviceParameters:
    """Return ``parameters`` of the ``corrected`` device where it is mounted further from or closer to the heel.

    A walk has the distance that the ``declared`` mounting gives; a longer one is the same as a shorter tendon.
    """
    if declared.mounting is None or corrected.mounting is None:
        return parameters
    change = corrected.mounting.neutral_muscle_ratio - declared.mounting.neutral_muscle_ratio
    tendon, shift = parameters.tendon, change * parameters.muscle.resting_length
    return parameters._replace(tendon=tendon._replace(slack_length=tendon.slack_length - shift))


def shift_length(parameters: DeviceParameters, length_zero: float) -> DeviceParameters:
    """Return ``parameters`` of a device whose prescribed length reads ``length_zero`` [m] too much."""
    tendon = parameters.tendon
    return parameters._replace(tendon=tendon._replace(slack_length=tendon.slack_length + length_zero))


def limit_number(
    key: str, nominal_values: Mapping[str, float], half_range: float, form: str = VALUE
) -> tuple[float, float]:
    """Return the bounds of a fitted number: within ``half_range`` of the nominal one, and such that a file accepts it.

    ``nominal_values`` are all numbers, ``section.key`` -> value. Positive numbers stay so without a sign of their own.
    What follows in ``form`` changes with it (:func:`derive_numbers`).
    """
    nominal, lower = nominal_values[key], nominal_values[key] - half_range
    if nominal > 0.0 and not key.rpartition(".")[2].startswith(SIGNED_PREFIXES):
        lower = max(lower, MIN_NUMBER_FRACTION * nominal)
    device_key = key.rpartition(DEVICE_SEPARATOR)[2]
    lower, upper = limit_to_plausible(device_key, nominal, lower, nominal + half_range)
    prefix = key.removesuffix(device_key)
    tendon_values = {name.removeprefix(prefix): v for name, v in nominal_values.items() if name.startswith(prefix)}
    return limit_to_valid({**nominal_values, **tendon_values}, device_key, lower, upper, form)


def limit_to_valid(
    values: Mapping[str, float], key: str, lower: float, upper: float, form: str = VALUE
) -> tuple[float, float]:
    """Return the part of the range from ``lower`` to ``upper`` in which number ``key`` has an influence of its own.

    Beyond it, :func:`complete_numbers` holds radius or wall at the limit that the other numbers in ``values`` set.
    """
    if key not in (RADIUS, THICKNESS):
        return lower, upper
    ends = ({key: end, **derive_numbers(values, {key: end}, {form})} for end in (lower, upper))
    possible = [complete_numbers(values, end, end).get(key, values[key]) for end in ends]
    return min(possible[0], values[key]), max(possible[1], values[key])


def _compute_radius_at_rest(values: Mapping[str, float]) -> float:
    """Return the radius [mm] of the braid at rest; a muscle of 1 m has the same."""
    return 1e3 * mckibben.compute_braid_radius(values[BRAID_RATIO], 1.0, values[TURNS])


def replace_values(spec: DeviceSpec, new_values: Mapping[str, float]) -> DeviceSpec:
    """Return ``spec`` with ``new_values`` (``section.key`` -> value), without validation."""
    sections: dict[str, dict[str, Any]] = {}
    for key, value in new_values.items():
        section, _, name = key.partition(".")
        sections.setdefault(section, {})[name] = value
    effects = sections.pop("effects", {})
    update: dict[str, Any] = {s: getattr(spec, s).model_copy(update=values) for s, values in sections.items()}
    if effects:
        content = {name: dict(values) for name, values in spec.effects.items()}
        for path, value in effects.items():
            name, _, key = path.partition(".")
            content[name][key] = value
        update["effects"] = content
    return spec.model_copy(update=update)
