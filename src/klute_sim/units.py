"""Units of file keys and channel names; inside the program all values are in SI units."""

import math
from functools import cache

BAR = 1.0e5
"""One bar in pascals."""

KEY_UNITS: dict[str, tuple[str, float]] = {
    "_mm": ("mm", 1e-3),
    "_n_per_mm": ("N/mm", 1e3),
    "_n_per_mm2": ("N/mm²", 1e6),
    "_per_bar": ("1/bar", 1.0 / BAR),
    "_kpa": ("kPa", 1e3),
    "_bar": ("bar", BAR),
    "_bar_per_s": ("bar/s", BAR),
    "_n_per_bar": ("N/bar", 1.0 / BAR),
    "_mm_per_bar": ("mm/bar", 1e-3 / BAR),
    "_deg_per_bar": ("deg/bar", math.pi / 180.0 / BAR),
    "_deg_per_s": ("deg/s", math.pi / 180.0),
    "_dm3_per_s_bar": ("dm³/(s·bar)", 1e-3 / BAR),
    "_s_bar_per_dm3": ("s·bar/dm³", 1e3 * BAR),
    "_cm3": ("cm³", 1e-6),
    "_l": ("l", 1e-3),
    "_per_l": ("1/l", 1e3),
    "_kg_m3": ("kg/m³", 1.0),
    "_kg_cm2": ("kg·cm²", 1e-4),
    "_per_m": ("1/m", 1.0),
    "_m": ("m", 1.0),
    "_n": ("N", 1.0),
    "_n_s_per_m": ("N·s/m", 1.0),
    "_n_s_per_mm": ("N·s/mm", 1e3),
    "_mm_per_s": ("mm/s", 1e-3),
    "_s": ("s", 1.0),
    "_m_per_s2": ("m/s²", 1.0),
    "_hz": ("Hz", 1.0),
    "_deg": ("deg", math.pi / 180.0),
    "_n_m": ("N·m", 1.0),
    "_n_m_s": ("N·m·s/rad", 1.0),
    "_n_m_per_deg": ("N·m/deg", 180.0 / math.pi),
    "_deg_per_n_m": ("deg/(N·m)", math.pi / 180.0),
    "_mm_per_kn": ("mm/kN", 1e-6),
    "_j": ("J", 1.0),
    "_pct": ("%", 0.01),
    "_c": ("°C", 1.0),
}
"""Suffix of a key -> written unit, and factor that converts a value into SI units."""


def split_unit(key: str) -> tuple[str, str]:
    """Return ``key`` without its unit, and the written unit; '' if the key has none."""
    suffix = _find_unit_suffix(key)
    return (key.removesuffix(suffix), KEY_UNITS[suffix][0]) if suffix else (key, "")


def to_si(key: str, value: float) -> float:
    """Return ``value`` in SI units, by the unit at the end of ``key`` (the longest suffix applies)."""
    suffix = _find_unit_suffix(key)
    return value * KEY_UNITS[suffix][1] if suffix else value


@cache
def _find_unit_suffix(key: str) -> str:
    return next((suffix for suffix in sorted(KEY_UNITS, key=len, reverse=True) if key.endswith(suffix)), "")
