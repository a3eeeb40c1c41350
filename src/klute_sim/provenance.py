"""What software made a result."""

import platform

import mujoco
import numpy as np
import scipy

from klute_sim import __version__


def collect_versions() -> dict[str, str]:
    """Name -> version of everything that can change a number."""
    return {
        "klute-sim": __version__,
        "mujoco": mujoco.__version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
    }
