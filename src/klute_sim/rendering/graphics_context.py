"""Graphics context for pictures with or without a display.

MuJoCo opens a window system (GLFW) unless the environment variable ``MUJOCO_GL`` names another way before its import.
On Linux without a display, this module therefore hands MuJoCo a context of EGL or OSMesa itself. A choice of the user
in ``MUJOCO_GL`` is never changed.
"""

import ctypes
import importlib
import importlib.util
import os
import sys
import threading
import warnings
from typing import Any

import mujoco

from klute_sim.errors import KluteSimError, MissingExtraError

REQUIRED_MODULES = ("OpenGL", "glfw")
"""Modules of the optional extra 'rendering'."""
OSMESA_LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
"""Names of the library of OSMesa."""
ADVICE = "install the Debian packages libegl1 and libgl1-mesa-dri, or libosmesa6"
"""What makes pictures without a display possible."""

_MAX_EGL_DEVICES = 16
_EGL_PLATFORM_DEVICE = 0x313F
_creation_lock = threading.Lock()


class RenderingError(KluteSimError):
    """The system cannot draw pictures."""


def find_context_module(feature: str) -> str:
    """Return the module of the graphics context for this system; '' leaves the choice to MuJoCo.

    ``feature`` names what needs it in errors. Raises MissingExtraError without the optional extra, and RenderingError
    when nothing can draw.
    """
    check_rendering_extra(feature)
    if os.environ.get("MUJOCO_GL", "").strip() or not sys.platform.startswith("linux"):
        return ""
    # MuJoCo and PyOpenGL load one platform in a process, so that a second try is impossible: look before trying.
    platform = os.environ.get("PYOPENGL_PLATFORM", "").lower()
    if has_display():
        return ""
    if platform in ("", "egl") and has_egl_device():
        return "mujoco.egl"
    if platform in ("", "osmesa") and has_osmesa():
        return "mujoco.osmesa"
    raise RenderingError(f"pictures without a display need EGL or OSMesa, and this system has neither: {ADVICE}")


def check_rendering_extra(feature: str) -> None:
    """Raise MissingExtraError when the optional extra is missing, which ``feature`` needs."""
    if not hasattr(mujoco, "Renderer") or any(importlib.util.find_spec(name) is None for name in REQUIRED_MODULES):
        raise MissingExtraError(feature, "rendering")


def has_display() -> bool:
    """Return whether there is a display on which GLFW, if it is installed, can open a window."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return False
    try:
        import glfw
    except ImportError:
        return False

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GLFW warns before it fails
        return bool(glfw.init())


def has_egl_device() -> bool:
    """Return whether EGL is installed and can draw on a device without a display."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
        egl.eglGetProcAddress.restype, egl.eglGetProcAddress.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
        egl.eglInitialize.argtypes = [ctypes.c_void_p] * 3
        query_address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
        display_address = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    except (OSError, AttributeError):
        return False
    if not query_address or not display_address:
        return False
    devices, count = (ctypes.c_void_p * _MAX_EGL_DEVICES)(), ctypes.c_int(0)
    query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(query_address)
    get_display = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p)(display_address)
    if not query(_MAX_EGL_DEVICES, ctypes.addressof(devices), ctypes.addressof(count)):
        return False
    displays = (get_display(_EGL_PLATFORM_DEVICE, devices[k], None) for k in range(count.value))
    return any(display and egl.eglInitialize(display, None, None) for display in displays)


def has_osmesa() -> bool:
    """Return whether OSMesa is installed."""
    for name in OSMESA_LIBRARIES:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


def create_mujoco_renderer(model: mujoco.MjModel, height: int, width: int, module: str) -> Any:
    """Return MuJoCo's renderer with the graphics context of ``module``; '' leaves the choice to MuJoCo."""
    with _creation_lock, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GLFW warns before it fails
        if not module:
            return mujoco.Renderer(model, height, width)
        # MuJoCo has chosen at its import, which may be long ago; it reads its choice when it creates a renderer.
        from mujoco.rendering.classic import gl_context

        chosen = getattr(gl_context, "GLContext", None)
        gl_context.GLContext = importlib.import_module(module).GLContext
        try:
            return mujoco.Renderer(model, height, width)
        finally:
            gl_context.GLContext = chosen
