"""Body mass, stature, stride time and speed: the unit that a number out of range seems to have."""

from collections.abc import Mapping
from types import MappingProxyType

from klute_sim.plausibility.units import Range

_OTHER_UNITS: Mapping[str, tuple[Range, Mapping[str, float]]] = MappingProxyType(
    {
        "mass": (Range(20.0, 250.0, 75.0), {"g": 1e-3, "lb": 0.45359237, "N": 1.0 / 9.80665}),
        "stature": (Range(1.0, 2.4, 1.7), {"cm": 0.01, "mm": 1e-3, "inches": 0.0254, "feet": 0.3048}),
        "stride time": (Range(0.4, 3.0, 1.1), {"ms": 1e-3, "min": 60.0, "frames at 100 Hz": 0.01}),
        "speed": (Range(0.05, 5.0, 1.2), {"mm/s": 1e-3, "cm/s": 0.01, "km/h": 1.0 / 3.6}),
    }
)
"""Quantity -> plausible range in SI units, and other units with their factors, the likely ones first."""


def describe_other_unit(quantity: str, value: float) -> str:
    """Return a clause such as ``; it looks like cm`` for a ``value`` that is plausible in another unit; '' otherwise.

    ``quantity`` is ``mass``, ``stature``, ``stride time`` or ``speed``; ``value`` is in kg, m, s or m/s.
    """
    plausible, units = _OTHER_UNITS.get(quantity, (Range(0.0, 0.0, 0.0), {}))
    if plausible.contains(value):
        return ""
    return next((f"; it looks like {unit}" for unit, factor in units.items() if plausible.contains(value * factor)), "")
