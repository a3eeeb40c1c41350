"""Fingerprint of the software that determines the metrics of a gait simulation."""

import hashlib
from collections.abc import Mapping
from functools import cache

from klute_sim.gait.code_digest import compute_code_digest
from klute_sim.provenance import collect_versions


@cache
def fingerprint_software() -> dict[str, str]:
    """Return the version of every package that can change a number, and a digest of the package's own code.

    Python and the machine are left out: the machines of a cluster differ, and their results belong in one table.
    """
    versions = {name: version for name, version in collect_versions().items() if name not in ("python", "machine")}
    return {**versions, "code": compute_code_digest("parameter_sweep/evaluate.py")}


@cache
def fingerprint_walk_software() -> dict[str, str]:
    """Return the fingerprint for predicted walks, which also depend on the walker."""
    paths = ("walker", "parameter_sweep/walk_plan.py", "parameter_sweep/walk_metrics.py")
    return {**fingerprint_software(), "code": compute_code_digest(*paths)}


@cache
def fingerprint_joint_software() -> dict[str, str]:
    """Return the fingerprint for the controlled joint, which also depends on its environment."""
    paths = ("mechanism", "envs", "parameter_sweep/joint_plan.py", "parameter_sweep/joint_metrics.py")
    return {**fingerprint_software(), "code": compute_code_digest(*paths)}


def describe_difference(actual: Mapping[str, str], expected: Mapping[str, str]) -> str:
    """Return what differs between two fingerprints, for the user; an empty string: nothing."""
    different = [name for name in (*expected, *actual) if actual.get(name) != expected.get(name)]
    return ", ".join(
        f"{name} {_shorten(actual.get(name))} instead of {_shorten(expected.get(name))}"
        for name in dict.fromkeys(different)
    )


def _shorten(version: str | None) -> str:
    """Return a version as it is, and a digest by its first letters."""
    return "(none)" if version is None else version[:8] if len(version) == hashlib.sha256().digest_size * 2 else version
