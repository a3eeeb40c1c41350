"""Whether and how large an environment draws pictures."""

from dataclasses import dataclass

import mujoco

from klute_sim.envs.base.rendering import find_context_module
from klute_sim.errors import InputError

MAX_PIXELS = 4096
"""Largest width and height of a rendered image [pixels]."""


@dataclass(frozen=True)
class PictureOptions:
    """Render mode and size of the pictures, validated at construction."""

    render_mode: str | None
    """``rgb_array``, or None for no pictures."""
    width: int
    """Width [pixels]."""
    height: int
    """Height [pixels]."""

    def __post_init__(self) -> None:
        """Raise InputError when an option is invalid; a system that cannot draw is refused before the first picture."""
        if self.render_mode not in (None, "rgb_array"):
            raise InputError(f"render_mode is '{self.render_mode}'; allowed: None, rgb_array")
        if self.render_mode is not None:
            find_context_module()
        if not (0 < self.width <= MAX_PIXELS and 0 < self.height <= MAX_PIXELS):
            raise InputError(
                f"the image size is {self.width} x {self.height}; allowed: 1 to {MAX_PIXELS} pixels in each direction"
            )

    def prepare(self, model: mujoco.MjModel) -> tuple[int, int]:
        """Make room for the pictures of ``model``, and return their height and width."""
        model.vis.global_.offwidth = max(self.width, model.vis.global_.offwidth)
        model.vis.global_.offheight = max(self.height, model.vis.global_.offheight)
        return self.height, self.width
