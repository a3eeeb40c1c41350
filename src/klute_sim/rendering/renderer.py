"""Offscreen renderer of one model, with its devices."""

import os
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.errors import KluteSimError
from klute_sim.rendering.device_shapes import add_devices, make_scene_option
from klute_sim.rendering.graphics_context import ADVICE, RenderingError, create_mujoco_renderer, find_context_module


class SceneRenderer:
    """Renderer of one model to images of one size."""

    def __init__(self, model: mujoco.MjModel, height: int, width: int, feature: str = "a picture") -> None:
        """Create the renderer; ``feature`` names what needs it in errors.

        Raises MissingExtraError or RenderingError when the system cannot draw.
        """
        self._model, self._option = model, make_scene_option()
        model.vis.global_.offwidth = max(width, model.vis.global_.offwidth)
        model.vis.global_.offheight = max(height, model.vis.global_.offheight)
        try:
            self._renderer: Any = create_mujoco_renderer(model, height, width, find_context_module(feature))
        except KluteSimError:
            raise
        except Exception as error:  # OpenGL libraries raise many types
            choice = os.environ.get("MUJOCO_GL", "").strip()
            advice = f"MUJOCO_GL is '{choice}': unset it, or {ADVICE}" if choice else ADVICE
            raise RenderingError(f"MuJoCo cannot draw pictures ({error}); {advice}") from None

    def draw(self, data: mujoco.MjData, camera: mujoco.MjvCamera | str) -> NDArray[np.uint8]:
        """Return the image, shape (height, width, 3), of ``data`` from ``camera``, which may be a name."""
        self._update(data, camera)
        return np.array(self._renderer.render(), dtype=np.uint8)

    def draw_depth(self, data: mujoco.MjData, camera: mujoco.MjvCamera | str) -> NDArray[np.float32]:
        """Return the distances [m] from the plane of the camera, shape (height, width), float32."""
        self._update(data, camera)
        self._renderer.enable_depth_rendering()
        try:
            return np.array(self._renderer.render(), dtype=np.float32)
        finally:
            self._renderer.disable_depth_rendering()

    def close(self) -> None:
        """Release the graphics context."""
        self._renderer.close()

    def _update(self, data: mujoco.MjData, camera: mujoco.MjvCamera | str) -> None:
        self._renderer.update_scene(data, camera, self._option)
        add_devices(self._renderer.scene, self._model, data)
