"""A folder with a gait reference, as ``klute-sim import`` creates it: the curves, and a file about the subject."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from klute_sim.errors import InputError
from klute_sim.files.limits import REFERENCE_METADATA
from klute_sim.files.reading import MissingFileError, read_bytes
from klute_sim.files.toml import parse_toml
from klute_sim.plausibility.gait.body import describe_other_unit

FORMAT = "klute-sim-reference/1"
"""Format of the metadata file."""
METADATA_FILE = "reference.toml"
"""Name of the file about the subject."""
CURVES_FILE = "reference.csv"
"""Name of the file with the curves."""
ALLOWED_RANGES = {
    "mass_kg": (20.0, 250.0),
    "stature_m": (1.0, 2.4),
    "stride_time_s": (0.5, 3.0),
    "speed_m_per_s": (0.05, 5.0),
}
"""Numbers of the metadata file and their allowed ranges."""
_QUANTITIES = {
    "mass_kg": "mass",
    "stature_m": "stature",
    "stride_time_s": "stride time",
    "speed_m_per_s": "speed",
}
REQUIRED_KEYS = ("mass_kg", "stride_time_s")
"""Numbers that the metadata file must hold."""


@dataclass(frozen=True)
class ReferenceMetadata:
    """Subject and speed of a reference."""

    stride_time: float
    """Stride time [s]."""
    mass: float
    """Body mass [kg]; the curves are per kg of it."""
    stature: float | None
    """Body height [m]; None: unknown."""
    speed: float | None
    """Walking speed [m/s]; None: unknown."""
    accepted: tuple[str, ...] = ()
    """Names of the findings that the user of the import accepted."""


def read_reference_folder(folder: Path) -> tuple[Path, ReferenceMetadata]:
    """Return the path of the curves in ``folder`` and the metadata in the same folder.

    Raises InputError when the metadata cannot be read or a number is missing or out of range.
    """
    path = folder / METADATA_FILE
    try:
        content = read_bytes(path, REFERENCE_METADATA)
    except MissingFileError:
        raise InputError(
            f"reference folder {folder}: {METADATA_FILE} cannot be read: No such file or directory; create such a "
            "folder with klute-sim import"
        ) from None
    keys = parse_toml(content, str(path))
    if keys.get("format") != FORMAT:
        raise InputError(f"{path}: 'format' is {keys.get('format')!r}; allowed: '{FORMAT}'")
    numbers = {key: _parse_number(keys, key, path) for key in ALLOWED_RANGES}
    stride_time, mass = numbers["stride_time_s"], numbers["mass_kg"]
    if stride_time is None or mass is None:
        missing = next(key for key in REQUIRED_KEYS if numbers[key] is None)
        raise InputError(f"{path}: key '{missing}' is missing")
    return folder / CURVES_FILE, ReferenceMetadata(
        stride_time, mass, numbers["stature_m"], numbers["speed_m_per_s"], _parse_accepted(keys, path)
    )


def _parse_accepted(keys: dict[str, Any], path: Path) -> tuple[str, ...]:
    value = keys.get("accepted", [])
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise InputError(f"{path}: 'accepted' = {value!r} is refused; allowed: a list of names of findings")
    return tuple(value)


def _parse_number(keys: dict[str, Any], key: str, path: Path) -> float | None:
    value, (lower, upper) = keys.get(key), ALLOWED_RANGES[key]
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not is_number or not lower <= value <= upper:
        hint = describe_other_unit(_QUANTITIES[key], float(value)) if is_number else ""
        raise InputError(f"{path}: '{key}' = {value!r} is refused; allowed: {lower:g} to {upper:g}{hint}")
    return float(value)
