"""Frames of an environment in Gymnasium's render modes: a window, images or distances."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.errors import InputError, suggest
from klute_sim.rendering.graphics_context import find_context_module
from klute_sim.rendering.renderer import SceneRenderer
from klute_sim.rendering.window import ViewerWindow, check_window

Frame = NDArray[np.uint8] | NDArray[np.float32]
"""Image (height, width, 3), uint8, or distances [m] (height, width), float32."""
RENDER_MODES = ("human", "rgb_array", "depth_array")
"""Render modes of a single environment."""
VECTOR_RENDER_MODES = ("rgb_array", "depth_array")
"""Render modes of a vector environment, and of a single one without a display."""
DEFAULT_CAMERA = "side"
"""Camera of all models of the package."""
MAX_PIXELS = 4096
"""Largest width and height of an image [pixels]."""


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """What an environment draws; validated when made."""

    render_mode: str | None = None
    """human, rgb_array or depth_array; None: nothing."""
    width: int = 480
    """Width of an image [pixels]."""
    height: int = 480
    """Height of an image [pixels]."""
    camera: str = DEFAULT_CAMERA
    """Name of a camera of the model."""
    allowed_modes: Sequence[str] = RENDER_MODES
    """Modes that the environment has."""

    def __post_init__(self) -> None:
        """Raise InputError when an option is invalid, and an error when the system cannot draw in this mode."""
        if self.render_mode not in (None, *self.allowed_modes):
            raise InputError(f"render_mode is {self.render_mode!r}; allowed: None, {', '.join(self.allowed_modes)}")
        if not (0 < self.width <= MAX_PIXELS and 0 < self.height <= MAX_PIXELS):
            raise InputError(
                f"the image size is {self.width} x {self.height}; allowed: 1 to {MAX_PIXELS} pixels in each direction"
            )
        if self.render_mode == "human":
            check_window(self.feature, "draw images instead: render_mode 'rgb_array'")
        elif self.render_mode is not None:
            find_context_module(self.feature)  # a system that cannot draw is refused now, not at the first picture

    @property
    def feature(self) -> str:
        """What needs a graphics context."""
        return f"render_mode '{self.render_mode}'"

    def check_camera(self, model: mujoco.MjModel) -> None:
        """Raise InputError when ``model`` lacks the camera."""
        names = [model.camera(index).name for index in range(model.ncam)]
        if self.camera not in names:
            raise InputError(
                f"the model has no camera {self.camera!r}; {suggest(str(self.camera), names, ', '.join(names))}"
            )


class FrameSource:
    """Draws simulations; window and graphics context open at the first frame of a model.

    A copy (copy.deepcopy or pickle) has the same options and opens its own.
    """

    def __init__(self, options: RenderOptions) -> None:
        """Set up a source with ``options``."""
        self.options = options
        self._renderer: SceneRenderer | None = None
        self._window: ViewerWindow | None = None
        self._model: mujoco.MjModel | None = None

    def draw(self, model: mujoco.MjModel, data: mujoco.MjData) -> Frame | None:
        """Return the frame of ``data``, a simulation of ``model``; None without a mode, and for a window."""
        options = self.options
        if options.render_mode is None:
            return None
        if model is not self._model:
            self.close()
            options.check_camera(model)
            self._model = model
        if options.render_mode == "human":
            if self._window is None:
                self._window = ViewerWindow(model, data, options.camera, options.feature)
            self._window.show()
            return None
        if self._renderer is None:
            self._renderer = SceneRenderer(model, options.height, options.width, options.feature)
        draw = self._renderer.draw if options.render_mode == "rgb_array" else self._renderer.draw_depth
        return draw(data, options.camera)

    def close(self) -> None:
        """Close window and graphics context."""
        for resource in (self._renderer, self._window):
            if resource is not None:
                resource.close()
        self._renderer = self._window = self._model = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how to create a copy."""
        return FrameSource, (self.options,)
