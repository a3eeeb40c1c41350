"""Window of MuJoCo's passive viewer, with the devices of the model."""

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import mujoco

from klute_sim.rendering.device_shapes import add_devices, make_scene_option
from klute_sim.rendering.graphics_context import RenderingError, check_rendering_extra, has_display

MIN_PICTURE_INTERVAL = 1.0 / 60.0
"""Least real time between two pictures [s]: a slow graphics card must not slow the simulation down."""
MAX_LEAD = 0.2
"""Difference of simulated and real time at which the clock starts again [s]."""
CLOSING_TIME = 5.0
"""Longest time that a window may take to close [s]."""
KeyCallback = Callable[[int], None]
"""Function that receives the code of a pressed key, in the viewer's thread."""


class ViewerWindow:
    """Window that shows one simulation; it is as fast as the simulation, but not faster than real time."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        camera: str,
        feature: str,
        key_callback: KeyCallback | None = None,
    ) -> None:
        """Open the window on ``camera`` of ``model``; ``feature`` names what needs it in errors.

        Raises MissingExtraError without the optional extra, and RenderingError when the system has no display.
        """
        check_window(feature)
        import mujoco.viewer

        threads = set(threading.enumerate())
        try:
            self._handle: Any = mujoco.viewer.launch_passive(
                model, data, key_callback=key_callback, show_left_ui=False, show_right_ui=False
            )
        except RuntimeError as error:  # macOS without mjpython
            raise RenderingError(f"{feature} cannot open a window: {error}") from None
        self._threads = set(threading.enumerate()) - threads
        self._model, self._data, option = model, data, make_scene_option()
        with self._handle.lock():
            self._handle.cam.type = mujoco.mjtCamera.mjCAMERA_FIXED
            self._handle.cam.fixedcamid = model.camera(camera).id
            self._handle.opt.geomgroup[:] = option.geomgroup
            self._handle.opt.flags[:] = option.flags
        self._clock_start: tuple[float, float] | None = None
        self._picture_time = -math.inf

    @property
    def is_open(self) -> bool:
        """Whether the user has not closed the window."""
        return bool(self._handle.is_running())

    def show(self, text: str = "") -> None:
        """Show the simulation as it is, with ``text`` in a corner, after waiting until real time has reached it.

        Shortly after a picture there is no next one.
        """
        if not self.is_open:
            return
        self._wait()
        if time.monotonic() - self._picture_time < MIN_PICTURE_INTERVAL:
            return
        with self._handle.lock():
            self._handle.user_scn.ngeom = 0
            add_devices(self._handle.user_scn, self._model, self._data)
        if text:
            self._handle.set_texts((None, mujoco.mjtGridPos.mjGRID_TOPLEFT, text, ""))
        self._handle.sync()
        self._picture_time = time.monotonic()

    def close(self) -> None:
        """Close the window, and wait for its thread, which must not draw while the process ends."""
        self._handle.close()
        for thread in self._threads:
            thread.join(CLOSING_TIME)

    def _wait(self) -> None:
        """Wait until as much real time has passed as simulated time since the last reset or delay."""
        now, simulated = time.monotonic(), float(self._data.time)
        start = self._clock_start
        lead = math.inf if start is None else (simulated - start[1]) - (now - start[0])
        if start is None or simulated < start[1] or abs(lead) > MAX_LEAD:
            self._clock_start = now, simulated
        elif lead > 0.0:
            time.sleep(lead)


def check_window(feature: str, alternative: str = "") -> None:
    """Raise MissingExtraError without the optional extra, and RenderingError when the system has no display.

    ``alternative`` ends the sentence: what needs no display.
    """
    check_rendering_extra(feature)
    if not has_display():
        advice = f"; {alternative}" if alternative else ""
        raise RenderingError(f"{feature} opens a window, and this system has no display{advice}")
