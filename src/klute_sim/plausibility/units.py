"""The unit that numbers seem to have, where the unit in the heading makes them implausible."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from klute_sim.types import Array

_POUND_FORCE = 4.4482216152605
_PSI = 6894.757293168
_MMHG = 133.322387415

UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "s": {"s": 1.0, "ms": 1e-3, "min": 60.0, "us": 1e-6, "h": 3600.0, "day": 86400.0, "ns": 1e-9},
        "m": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "um": 1e-6, "ft": 0.3048},
        "N": {"N": 1.0, "kN": 1e3, "lbf": _POUND_FORCE, "kgf": 9.80665, "mN": 1e-3, "gf": 9.80665e-3, "daN": 10.0},
        "Pa": {
            "bar": 1e5,
            "kPa": 1e3,
            "MPa": 1e6,
            "psi": _PSI,
            "Pa": 1.0,
            "mbar": 100.0,
            "atm": 101325.0,
            "mmHg": _MMHG,
        },
        "rad": {"deg": math.pi / 180.0, "rad": 1.0, "mrad": 1e-3},
        "N*m": {"N*m": 1.0, "mN*m": 1e-3, "N*cm": 0.01, "kN*m": 1e3, "lbf*in": 0.1129848290276, "lbf*ft": 1.3558179483},
    }
)
"""SI unit of a dimension -> units that people write or export, the common ones first -> factor to SI."""


CLOSENESS_TOLERANCE = 1.0 / 3.0
"""Largest difference between the distances of two units from the typical value that does not tell which one it is, in
orders of magnitude (assumed; kgf and lbf differ by 0.34, and typical values are known to a factor of about two)."""
MIN_DIFFERENCE = 0.02
"""Smallest difference of two units that are both named, in orders of magnitude (daN and kgf differ by 0.008)."""


class Range(NamedTuple):
    """Plausible range of a quantity, and a typical value within it, in SI units."""

    low: float
    """Smallest plausible value."""
    high: float
    """Largest plausible value."""
    typical: float
    """Typical value."""

    def contains(self, value: float) -> bool:
        """Return whether ``value`` is plausible."""
        return self.low <= value <= self.high


UNIT_ADVICE = "Correct it in the heading or under [columns]"
"""What to do about a wrong unit of a column."""


def guess_units(value: float, factor: float, si_unit: str, plausible: Range) -> tuple[str, ...]:
    """Return the units that make a positive ``value`` plausible, the closest first; none if the unit as written does.

    ``value`` is in SI units as read with ``factor``, that of the unit in the heading. A unit is close if it brings the
    value close to the typical one (in ratio). Units that are less close than the closest by more than
    :data:`CLOSENESS_TOLERANCE` are left out, and so are those that a more common one hardly differs from.
    """
    if not value > 0.0 or plausible.contains(value):
        return ()
    distances: dict[str, float] = {}
    for unit, candidate in UNITS[si_unit].items():
        converted = value / factor * candidate
        is_new = all(abs(math.log10(candidate / UNITS[si_unit][other])) > MIN_DIFFERENCE for other in distances)
        if candidate != factor and plausible.contains(converted) and is_new:
            distances[unit] = abs(math.log10(converted / plausible.typical))
    closest = min(distances.values(), default=0.0)
    units = [unit for unit, distance in distances.items() if distance <= closest + CLOSENESS_TOLERANCE]
    return tuple(sorted(units, key=lambda unit: distances[unit]))


def format_value(value: float, unit: str, factor: float) -> str:
    """Return ``value`` (SI) in ``unit`` with three digits."""
    return f"{round_digits(value / factor):g} {unit}"


def format_range(values: Array, unit: str, factor: float) -> str:
    """Return the smallest and the largest of ``values`` (SI) in ``unit``, such as ``3 to 12 mm``."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    if low == high:
        return format_value(low, unit, factor)
    return f"{round_digits(low / factor):g} to {format_value(high, unit, factor)}"


def round_digits(number: float) -> float:
    """Return ``number`` rounded to three digits."""
    return float(f"{number:.3g}")
