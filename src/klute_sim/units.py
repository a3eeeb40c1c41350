"""Units at the edges: file keys and channel names carry them, the program inside is SI."""

BAR = 1.0e5
"""Pascals in a bar."""

KEY_UNITS: dict[str, float] = {
    "_mm": 1e-3,
    "_n_per_mm": 1e3,
    "_kpa": 1e3,
    "_bar": BAR,
    "_bar_per_s": BAR,
    "_n_per_bar": 1.0 / BAR,
    "_kg_m3": 1.0,
    "_per_m": 1.0,
    "_n": 1.0,
    "_n_s_per_m": 1.0,
    "_mm_per_s": 1e-3,
    "_s": 1.0,
}
"""Suffix of a device-file key -> factor that turns its value into SI."""


def to_si(key: str, value: float) -> float:
    """``value`` of device-file ``key`` in SI, by the unit at the end of the key (longest suffix wins)."""
    for suffix in sorted(KEY_UNITS, key=len, reverse=True):
        if key.endswith(suffix):
            return value * KEY_UNITS[suffix]
    return value
