"""A reference that is a folder, as ``klute-sim import`` makes them: its curves and, beside them, whose they are."""

import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from klute_sim.errors import InputError

FORMAT = "klute-sim-reference/1"
METADATA_FILE = "reference.toml"
CURVES_FILE = "reference.csv"
ALLOWED_RANGES = {
    "mass_kg": (20.0, 250.0),
    "stature_m": (1.0, 2.4),
    "stride_time_s": (0.5, 3.0),
    "speed_m_per_s": (0.05, 5.0),
}
"""Numbers the folder may state -> what is allowed: who can walk on the rig."""
REQUIRED_KEYS = ("mass_kg", "stride_time_s")


@dataclass(frozen=True)
class ReferenceMetadata:
    """What a folder says of its walker."""

    stride_time: float
    """[s]"""
    mass: float
    """[kg]; the curves are per kg of it."""
    stature: float | None
    """[m]"""
    speed: float | None
    """[m/s]"""


def read_reference_folder(folder: Path) -> tuple[Path, ReferenceMetadata]:
    """The file of curves in ``folder`` and what is stated beside it; raises InputError with what is wrong."""
    where = folder / METADATA_FILE
    try:
        keys: dict[str, Any] = tomllib.loads(where.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise InputError(
            f"reference folder {folder}: {METADATA_FILE} cannot be read: {error.strerror}; klute-sim import makes such folders"
        ) from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{where} is not valid TOML: {error}") from None
    if keys.get("format") != FORMAT:
        raise InputError(f"{where}: 'format' is {keys.get('format')!r}; allowed: '{FORMAT}'")
    numbers = {key: _parse_number(keys, key, where) for key in ALLOWED_RANGES}
    stride_time, mass = numbers["stride_time_s"], numbers["mass_kg"]
    if stride_time is None or mass is None:
        missing = next(key for key in REQUIRED_KEYS if numbers[key] is None)
        raise InputError(f"{where}: key '{missing}' is missing")
    return folder / CURVES_FILE, ReferenceMetadata(stride_time, mass, numbers["stature_m"], numbers["speed_m_per_s"])


def _parse_number(keys: dict[str, Any], key: str, path: Path) -> float | None:
    value, (low, high) = keys.get(key), ALLOWED_RANGES[key]
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not is_number or not low <= value <= high:
        raise InputError(f"{path}: '{key}' = {value!r} is refused; allowed: {low:g} to {high:g}")
    return float(value)
