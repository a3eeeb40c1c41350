"""A device for muscles that are made like those of its file, but have another nominal diameter.

Makers state the inner diameter of the tube. The wall has the same thickness at all diameters, and the braid lies on it
with the same angle (both assumed). So the radius of the braid changes like the outer diameter, the nominal one plus two
walls. Published muscles of 10 and 20 mm agree: docs/diagnose.md, "Other data".
"""

import math

from klute_sim.datasets.declarations import parse_quantity
from klute_sim.datasets.format import DiameterEntry
from klute_sim.device.device import Device
from klute_sim.effects import catalogue
from klute_sim.errors import InputError

MIN_DIAMETER, MAX_DIAMETER = 1e-3, 0.3
"""Smallest and largest nominal diameter [m] (assumed: no muscle is thinner or thicker)."""
MUSCLE_EXPONENTS = {
    "muscle.bladder_radius_mm": 1.0,
    "muscle.turns_per_m": -1.0,
    "muscle.friction_slope_n_per_bar": 2.0,
    "muscle.friction_offset_n": 1.0,
}
"""Number of a device -> power of the outer diameter with which it changes; the other numbers stay as they are.

The friction offset changes as in :mod:`klute_sim.effects.families.muscle.dissertation_terms`.
"""


def scale_muscle(device: Device, diameter: DiameterEntry | None, source: str) -> tuple[Device, list[str]]:
    """Return ``device`` for the diameter of the trials, and a remark on what was changed.

    Without ``diameter`` the device is returned as it is. ``source`` is the path of ``dataset.toml``.

    Raises InputError when a diameter is no length within limits, or the device has no muscle.
    """
    if diameter is None:
        return device, []
    place = f"{source}: [diameter]"
    if device.spec.muscle is None:
        raise InputError(f"{place} is for devices with a muscle, but '{device.name}' has none; remove it")
    device_diameter = _parse_diameter(diameter.device, f"{place} device")
    trial_diameter = _parse_diameter(diameter.trials, f"{place} trials")
    wall = 1e-3 * device.spec.muscle.bladder_thickness_mm
    ratio = (trial_diameter + 2.0 * wall) / (device_diameter + 2.0 * wall)
    known = device.spec.collect_values()
    exponents = MUSCLE_EXPONENTS | _list_effect_exponents(device)
    changes = {key: known[key] * ratio**exponent for key, exponent in exponents.items() if known[key] != 0.0}
    if ratio == 1.0:
        return device, []
    listed = ", ".join(f"{key} {known[key]:.4g} -> {value:.4g}" for key, value in changes.items())
    remark = (
        f"the trials are of muscles of {1e3 * trial_diameter:g} mm, the device '{device.name}' is one of "
        f"{1e3 * device_diameter:g} mm: with a wall of {1e3 * wall:g} mm at both (assumed) the braid is "
        f"{ratio:.3f} times as wide: {listed}; all other numbers are unchanged"
    )
    note = f"assumed: scaled from the muscle of {1e3 * device_diameter:g} mm to one of {1e3 * trial_diameter:g} mm"
    return device.with_changes(changes, note), [remark]


def _parse_diameter(text: str, place: str) -> float:
    value = parse_quantity(text, "m", place)
    if not (math.isfinite(value) and MIN_DIAMETER <= value <= MAX_DIAMETER):
        raise InputError(
            f"{place} = '{text}' is refused; allowed: a nominal diameter of {1e3 * MIN_DIAMETER:g} to "
            f"{1e3 * MAX_DIAMETER:g} mm"
        )
    return value


def _list_effect_exponents(device: Device) -> dict[str, float]:
    """Return ``effects.<name>.<key>`` -> power of the diameter, where the law of an effect does not contain it."""
    exponents = {}
    for name, content in device.spec.effects.items():
        form = catalogue.find_form(name, str(content["form"]) if "form" in content else None)[1]
        for parameter in form.parameters:
            if parameter.key in content and parameter.diameter_exponent:
                exponents[f"effects.{name}.{parameter.key}"] = parameter.diameter_exponent
    return exponents
