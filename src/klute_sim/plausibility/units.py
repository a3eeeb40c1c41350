"""The unit that numbers seem to have, where the unit in the heading makes them implausible."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from klute_sim.types import Array

_POUND_FORCE = 4.4482216152605
_PSI = 6894.757293168

UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "s": {"s": 1.0, "ms": 1e-3, "min": 60.0, "us": 1e-6, "h": 3600.0, "ns": 1e-9},
        "m": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "um": 1e-6, "ft": 0.3048},
        "N": {"N": 1.0, "kN": 1e3, "lbf": _POUND_FORCE, "kgf": 9.80665, "mN": 1e-3, "gf": 9.80665e-3, "daN": 10.0},
        "Pa": {"bar": 1e5, "kPa": 1e3, "MPa": 1e6, "psi": _PSI, "Pa": 1.0, "mbar": 100.0, "atm": 101325.0},
        "rad": {"deg": math.pi / 180.0, "rad": 1.0, "mrad": 1e-3},
        "N*m": {"N*m": 1.0, "mN*m": 1e-3, "N*cm": 0.01, "kN*m": 1e3, "lbf*in": 0.1129848290276, "lbf*ft": 1.3558179483},
    }
)
"""SI unit of a dimension -> units that people write or export, the common ones first -> factor to SI."""


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


def guess_unit(value: float, factor: float, si_unit: str, plausible: Range) -> str:
    """Return the unit that makes a positive ``value`` plausible; '' if none does, or the unit as written does.

    ``value`` is in SI units as read with ``factor``, that of the unit in the heading. Of several units, the one that
    brings the value closest to the typical one (in ratio) is returned; a unit that comes later in :data:`UNITS` must be
    clearly closer, by a third of an order of magnitude.
    """
    if not value > 0.0 or plausible.contains(value):
        return ""
    best, smallest_distance = "", math.inf
    for unit, candidate in UNITS[si_unit].items():
        converted = value / factor * candidate
        if candidate != factor and plausible.contains(converted):
            distance = abs(math.log10(converted / plausible.typical))
            if distance < smallest_distance - 1.0 / 3.0 or not best:
                best, smallest_distance = unit, distance
    return best


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
