"""The device files that come with the package."""

from functools import cache
from importlib import resources


@cache
def read_presets() -> dict[str, bytes]:
    """Return the name of each preset, in alphabetical order, with the content of its device file."""
    folder = resources.files("klute_sim.device") / "presets"
    files = [file for file in folder.iterdir() if file.name.endswith(".toml")]
    return dict(sorted((file.name.removesuffix(".toml"), file.read_bytes()) for file in files))
