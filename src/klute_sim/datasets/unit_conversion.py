"""Conversion of measured columns from any unit of the right dimension to SI."""

import re
from functools import cache
from typing import Any

EXAMPLE_UNITS = {
    "s": "s, ms, min, h, day",
    "m": "mm, cm, m, in",
    "N": "N, kN, kgf, lbf",
    "Pa": "bar, kPa, MPa, psi, Pa",
    "rad": "deg, rad",
    "N*m": "N*m, kgf*m, lbf*ft",
    "rad/s": "deg/s, rad/s",
    "m/s": "mm/s, m/s",
}
"""SI unit of a channel or a velocity -> examples of allowed units for error messages."""
MASS_UNITS = {**dict.fromkeys(("lb", "lbs", "pound", "pounds"), "lbf"), "kg": "kgf"}
"""Unit of mass, in small letters -> the unit of force that some mean by it."""
RAW_UNITS = frozenset(("v", "mv", "mv/v", "ma", "count", "counts", "cts", "adc", "lsb", "digit", "digits", "raw"))
"""Units, in small letters, of readings that become a channel by a calibration only."""

_UNIT_TOKEN = re.compile(r"[^\W\d_][^\W\d_]*|[\s*·⋅/.°^\d-]")
"""Names, numbers and operators that a unit may consist of."""
_GRAD = re.compile(r"\bgrads?\b", re.IGNORECASE)
"""A degree to some and a gon to others, while pint reads ``Grad`` as 1e9 rad."""
_EXCESSIVE_POWER = re.compile(r"\d{2}|(\^|\*\*)[\s\d.-]*(\^|\*\*)")
"""Powers that occur in no unit and take too long to evaluate."""


@cache
def _get_registry() -> Any:
    import pint  # the import takes half a second and is needed for datasets only

    return pint.UnitRegistry()


@cache
def get_si_factor(unit: str, si_unit: str) -> float | None:
    """Return the factor from ``unit`` to ``si_unit``; None where ``unit`` is not a unit of the same dimension.

    Base units are compared, so a percentage is not an angle although both are dimensionless. A unit with an offset,
    such as a temperature, has no factor, nor has ``grad``.
    """
    if not _is_readable(unit) or _GRAD.search(unit):
        return None
    registry = _get_registry()
    try:
        value, base = registry.get_base_units(registry.parse_units(unit.replace("⋅", "*")))
        si_base = registry.get_base_units(registry.parse_units(si_unit))[1]
        if registry.Quantity(0.0, registry.parse_units(unit.replace("⋅", "*"))).to_base_units().magnitude != 0.0:
            return None
    except Exception:  # for an invalid unit, pint's parser raises a dozen types of exceptions
        return None
    return float(value) if base == si_base else None


def describe_wrong_unit(unit: str, si_unit: str) -> str:
    """Return what is wrong with ``unit``, which has no factor to ``si_unit``, and what is allowed, for a message."""
    allowed = f"allowed: {EXAMPLE_UNITS[si_unit]} and other units of that kind"
    if _GRAD.search(unit) and si_unit in ("rad", "rad/s"):
        return f"the ambiguous unit '{unit}'; did you mean '{_GRAD.sub('deg', unit)}'? A{allowed[1:]}"
    force_unit = MASS_UNITS.get(unit.lower()) if si_unit == "N" else None
    if force_unit:
        return f"a unit of mass, '{unit}'; did you mean '{force_unit}'? A{allowed[1:]}"
    if _is_known(unit) and get_si_factor(unit.lower(), si_unit) is None:
        return f"a unit of the wrong kind; {allowed}"
    if get_si_factor(unit.lower(), si_unit) is None:
        return f"the unknown unit '{unit}'; {allowed}"
    symbol = f"{_get_registry().parse_units(unit.lower()):~}"
    kind = f"a unit of the wrong kind, '{unit}'" if _is_known(unit) else f"the unknown unit '{unit}'"
    return f"{kind}; did you mean '{symbol}'? A{allowed[1:]}"


def _is_known(unit: str) -> bool:
    """Return whether ``unit`` is one of any kind; text that no unit consists of counts as one of no kind."""
    if not _is_readable(unit):
        return True
    try:
        _get_registry().parse_units(unit)
    except Exception:  # as in get_si_factor
        return False
    return True


def _is_readable(unit: str) -> bool:
    """Return whether ``unit`` consists of what units consist of, so that pint reads it in a short time."""
    return not (_UNIT_TOKEN.sub("", unit) or _EXCESSIVE_POWER.search(unit))


def get_conversion_factor(unit: str, target_unit: str) -> float | None:
    """Return the factor from ``unit`` to ``target_unit``; None where they are not units of the same dimension."""
    numerator, denominator = get_si_factor(unit, target_unit), get_si_factor(target_unit, target_unit)
    return None if numerator is None or denominator is None else numerator / denominator
