"""Digest of the code that determines a simulated gait: laws, effects, device, rig, its model, device files, reference.

During development the code changes while the version does not.
"""

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from klute_sim.controllers.learned import WALK_ENVIRONMENT
from klute_sim.effects import catalogue
from klute_sim.plant import models

DIGESTED_PATHS = ("laws", "effects", "device", "plant", "controllers", "gait", "constants.py", "units.py")
"""Code and tables of the package that can change a simulated gait."""
PATH_OF_ENVIRONMENT = {WALK_ENVIRONMENT: "walker", "klute_sim/AntagonistJoint": "mechanism"}
"""Beginning of the Gymnasium name of an environment -> code of the package that it simulates as well."""
POLICY_KEY = "code_sha256"
"""Key of the digest in the metadata of a policy."""


@cache
def compute_code_digest(*more_paths: str) -> str:
    """Return the SHA-256 of :data:`DIGESTED_PATHS` and ``more_paths`` of the package, and of MuJoCo's models."""
    package = Path(__file__).parents[1]
    paths = [package / part for part in (*DIGESTED_PATHS, *more_paths)]
    files = [file for path in paths for file in (path.rglob("*") if path.is_dir() else [path])]
    hashed = sorted(file for file in files if file.suffix in (".py", ".csv", ".toml"))
    hashed += sorted(models.get_models_folder().glob("*.xml"))
    # The line ends of a checkout are no difference.
    content = b"".join(file.read_bytes().replace(b"\r\n", b"\n") for file in hashed)
    return hashlib.sha256(content + catalogue.read_user_source()).hexdigest()


def compute_policy_digest(environment: str) -> str:
    """Return the digest of the code of an ``environment`` (its Gymnasium name) in which a policy was trained."""
    more_paths = [path for beginning, path in PATH_OF_ENVIRONMENT.items() if environment.startswith(beginning)]
    return compute_code_digest(*more_paths)


def describe_policy_code(metadata: Mapping[str, Any]) -> str:
    """Return a sentence if a policy with this ``metadata`` was not trained in the installed simulation; else ''."""
    trained, installed = metadata.get(POLICY_KEY), compute_policy_digest(str(metadata.get("environment", "")))
    if trained is None:
        return (
            "The policy does not record the code of the simulation it was trained in (not recorded): laws, device and "
            "rig may have changed since."
        )
    if trained != installed:
        return (
            f"The policy was trained in a simulation with other code (digest {str(trained)[:8]}) than the installed "
            f"one ({installed[:8]}): laws, device or rig have changed since, so its results may differ from those of "
            "its training."
        )
    return ""
