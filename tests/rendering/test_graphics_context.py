"""Tests of pictures without a display: choice of the library, pictures of every library, sentences on failure."""

import importlib.util
import os
import subprocess
import sys

import pytest

from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.errors import MissingExtraError
from klute_sim.rendering import graphics_context
from klute_sim.rendering.graphics_context import RenderingError

LIBRARIES = {"mujoco.egl": graphics_context.has_egl_device(), "mujoco.osmesa": graphics_context.has_osmesa()}
needs_library = pytest.mark.skipif(not any(LIBRARIES.values()), reason="neither EGL nor OSMesa is installed")

PICTURE = """
import mujoco  # before klute_sim, so that MuJoCo has already made its choice
import gymnasium, klute_sim, numpy as np
options = {"strides": 1, "time_step": 1e-3, "width": 64, "height": 48}
env = gymnasium.make("klute_sim/AnkleGait-v2", render_mode="rgb_array", **options)
env.reset(seed=0)
env.step(np.zeros(1, dtype=np.float32))
picture = env.render()
env.close()
print(picture.shape, picture.dtype, len(np.unique(picture)) > 50)
"""
CHECK = """
import warnings
warnings.simplefilter("error")
import gymnasium, klute_sim
from gymnasium.utils.env_checker import check_env
for name in ("klute_sim/AnkleGait-v2", "klute_sim/AnkleBench-v0", "klute_sim/AntagonistJoint-v0"):
    options = {"strides": 1, "time_step": 1e-3} if "Gait" in name else {"duration": 1.0}
    check_env(gymnasium.make(name, width=64, height=64, **options).unwrapped)
print("passed")
"""


def run_without_display(code: str, **variables: str) -> str:
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM")
    environment = {name: value for name, value in os.environ.items() if name not in hidden} | variables
    completed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    return (completed.stdout + completed.stderr).strip()


@pytest.mark.slow
@needs_library
def test_environments_pass_gymnasium_checker_in_all_render_modes() -> None:
    assert run_without_display(CHECK) == "passed"


@pytest.mark.slow
@needs_library
def test_every_installed_library_draws() -> None:
    for module, is_installed in LIBRARIES.items():
        if is_installed:
            choice = "from klute_sim.rendering import renderer; renderer.find_context_module = "
            choice += f"lambda feature: {module!r}"
            assert run_without_display(choice + PICTURE) == "(48, 64, 3) uint8 True", module


@pytest.mark.slow
@needs_library
def test_choice_of_the_user_and_unusable_displays() -> None:
    choice = next(module for module, is_installed in LIBRARIES.items() if is_installed).removeprefix("mujoco.")
    assert run_without_display(PICTURE, MUJOCO_GL=choice) == "(48, 64, 3) uint8 True"
    assert run_without_display(PICTURE, DISPLAY=":4711") == "(48, 64, 3) uint8 True"


@pytest.fixture
def without_display(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    for variable in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    return monkeypatch


def test_egl_is_preferred_to_osmesa(without_display: pytest.MonkeyPatch) -> None:
    without_display.setattr(graphics_context, "has_osmesa", lambda: True)
    for has_egl, module in ((True, "mujoco.egl"), (False, "mujoco.osmesa")):
        without_display.setattr(graphics_context, "has_egl_device", lambda has_egl=has_egl: has_egl)
        assert graphics_context.find_context_module("a picture") == module
    without_display.setenv("MUJOCO_GL", "osmesa")
    assert graphics_context.find_context_module("a picture") == ""


def test_missing_library_is_one_sentence_with_the_packages(without_display: pytest.MonkeyPatch) -> None:
    for name in ("has_egl_device", "has_osmesa"):
        without_display.setattr(graphics_context, name, lambda: False)
    with pytest.raises(RenderingError, match="install the Debian packages libegl1 and libgl1-mesa-dri, or"):
        AnkleGaitEnv(render_mode="rgb_array")


def test_missing_extra_is_one_sentence(without_display: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec
    without_display.setattr(importlib.util, "find_spec", lambda name: None if name == "OpenGL" else found(name))
    with pytest.raises(MissingExtraError, match="render_mode 'rgb_array' needs the optional extra 'rendering'"):
        AnkleGaitEnv(render_mode="rgb_array")


@pytest.mark.slow
def test_unusable_choice_of_the_user_is_one_sentence() -> None:
    last_line = run_without_display(PICTURE, MUJOCO_GL="glfw").splitlines()[-1]
    assert "RenderingError: MuJoCo cannot draw pictures" in last_line
    assert last_line.endswith("unset it, or " + graphics_context.ADVICE)


def test_window_without_a_display_is_one_sentence(without_display: pytest.MonkeyPatch) -> None:
    with pytest.raises(RenderingError, match="render_mode 'human' opens a window"):
        AnkleGaitEnv(render_mode="human")
