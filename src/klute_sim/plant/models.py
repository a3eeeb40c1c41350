"""Where the MJCF files are."""

from importlib import resources
from pathlib import Path

import mujoco


def folder() -> Path:
    """Folder of the MJCF files: inside an installed package, or beside ``src`` in a checkout."""
    inside = Path(str(resources.files("klute_sim"))) / "models"
    return inside if inside.is_dir() else Path(__file__).parents[3] / "models"


def spec(name: str) -> mujoco.MjSpec:
    """The editable model ``name`` (``ankle``, ``bench`` or ``gait_rig``)."""
    return mujoco.MjSpec.from_file(str(folder() / f"{name}.xml"))
