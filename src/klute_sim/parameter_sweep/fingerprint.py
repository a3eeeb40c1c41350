"""What a walk's numbers depend on besides its inputs."""

import hashlib
from functools import cache
from pathlib import Path

from klute_sim.effects import catalogue
from klute_sim.plant import models
from klute_sim.provenance import collect_versions

FINGERPRINTED_PATHS = ("laws", "effects", "device", "plant", "controllers", "gait", "parameter_sweep/evaluate.py")
"""Code and tables that can change a walk's outcomes."""


@cache
def fingerprint_software() -> dict[str, str]:
    """Name -> version of every package that can change a number; and a digest of our own code.

    Neither Python nor the machine: a cluster may be of many kinds, and its walks still belong in one table.
    """
    known = {name: version for name, version in collect_versions().items() if name not in ("python", "machine")}
    return {**known, "code": _hash_source()}


def _hash_source() -> str:
    """Where the package is worked on, its version stays and its code does not."""
    home = Path(__file__).parents[1]
    found = [
        file
        for part in FINGERPRINTED_PATHS
        for file in ((home / part).rglob("*") if (home / part).is_dir() else [home / part])
    ]
    files = sorted(file for file in found if file.suffix in (".py", ".csv", ".toml"))
    files += sorted(models.get_models_folder().glob("*.xml"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files) + catalogue.read_user_source()).hexdigest()
