"""Units of measured columns: any unit of the right dimension becomes SI."""

import re
from functools import cache
from typing import Any

EXAMPLE_UNITS = {
    "s": "s, ms, min",
    "m": "mm, cm, m, in",
    "N": "N, kN, kgf, lbf",
    "Pa": "bar, kPa, MPa, psi, Pa",
    "rad": "deg, rad",
    "N*m": "N*m, kgf*m, lbf*ft",
}
"""SI unit of a channel -> units to name when another one is refused."""

_UNIT_TOKEN = re.compile(r"[^\W\d_][^\W\d_]*|[\s*·⋅/.°^\d-]")
_EXCESSIVE_POWER = re.compile(r"\d{2}|(\^|\*\*)[\s\d.-]*(\^|\*\*)")
"""Powers that no unit has and whose value takes for ever."""


@cache
def _get_registry() -> Any:
    import pint  # here, because it takes half a second that only datasets need

    return pint.UnitRegistry()


@cache
def get_si_factor(unit: str, si_unit: str) -> float | None:
    """What a value in ``unit`` is multiplied by to be in ``si``; None where ``unit`` is no unit of that kind.

    Compared are base units, so that a percentage is no angle although both are pure numbers; a unit whose zero is
    elsewhere, such as a temperature's, has no factor.
    """
    if _UNIT_TOKEN.sub("", unit) or _EXCESSIVE_POWER.search(unit):
        return None
    registry = _get_registry()
    try:
        value, base = registry.get_base_units(registry.parse_units(unit.replace("⋅", "*")))
        wanted = registry.get_base_units(registry.parse_units(si_unit))[1]
        if registry.Quantity(0.0, registry.parse_units(unit.replace("⋅", "*"))).to_base_units().magnitude != 0.0:
            return None
    except Exception:  # pint's parser raises a dozen kinds for what is no unit
        return None
    return float(value) if base == wanted else None


def get_conversion_factor(unit: str, target_unit: str) -> float | None:
    """What a value in ``unit`` is multiplied by to be in ``other``; None where that is no unit of the same kind."""
    one, whole = get_si_factor(unit, target_unit), get_si_factor(target_unit, target_unit)
    return None if one is None or whole is None else one / whole
