"""Fingerprint of the software that determines the metrics of a gait simulation."""

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from klute_sim.effects import catalogue
from klute_sim.plant import models
from klute_sim.provenance import collect_versions

FINGERPRINTED_PATHS = (
    "laws",
    "effects",
    "device",
    "plant",
    "controllers",
    "gait",
    "constants.py",
    "units.py",
    "parameter_sweep/evaluate.py",
)
"""Code and tables of the package that can change the metrics of a simulation."""


@cache
def fingerprint_software() -> dict[str, str]:
    """Return the version of every package that can change a number, and a digest of the package's own code.

    Python and the machine are left out: the machines of a cluster differ, and their results belong in one table.
    """
    versions = {name: version for name, version in collect_versions().items() if name not in ("python", "machine")}
    return {**versions, "code": _hash_source()}


def describe_difference(found: Mapping[str, str], expected: Mapping[str, str]) -> str:
    """Return what differs between two fingerprints, for the user; an empty string: nothing."""
    different = [name for name in (*expected, *found) if found.get(name) != expected.get(name)]
    return ", ".join(
        f"{name} {_shorten(found.get(name))} instead of {_shorten(expected.get(name))}"
        for name in dict.fromkeys(different)
    )


def _shorten(version: str | None) -> str:
    """Return a version as it is, and a digest by its first letters."""
    return "(none)" if version is None else version[:8] if len(version) == hashlib.sha256().digest_size * 2 else version


def _hash_source() -> str:
    """Return the SHA-256 of the code: during development the code changes while the version does not."""
    package = Path(__file__).parents[1]
    paths = [package / part for part in FINGERPRINTED_PATHS]
    files = [file for path in paths for file in (path.rglob("*") if path.is_dir() else [path])]
    hashed = sorted(file for file in files if file.suffix in (".py", ".csv", ".toml"))
    hashed += sorted(models.get_models_folder().glob("*.xml"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in hashed) + catalogue.read_user_source()).hexdigest()
