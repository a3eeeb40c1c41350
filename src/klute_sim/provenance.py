"""Versions of the software that computes a result."""

import platform

import mujoco
import numpy as np
import scipy

from klute_sim import __version__


def collect_versions() -> dict[str, str]:
    """Return the version of everything that can change a number, by name."""
    return {
        "klute-sim": __version__,
        "mujoco": mujoco.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
    }
