"""Frames of the environments: images and distances, single and vector, cameras, sizes, copies and refusals."""

import pickle
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

from klute_sim.envs.ankle_bench import AnkleBenchEnv
from klute_sim.envs.ankle_bench_vector import AnkleBenchVectorEnv
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.ankle_gait_vector import AnkleGaitVectorEnv
from klute_sim.envs.ankle_walk import AnkleWalkEnv
from klute_sim.envs.ankle_walk_vector import AnkleWalkVectorEnv
from klute_sim.envs.antagonist_joint import AntagonistJointEnv
from klute_sim.envs.antagonist_joint_vector import AntagonistJointVectorEnv
from klute_sim.errors import InputError
from klute_sim.rendering import frames, graphics_context

pytestmark = pytest.mark.skipif(
    not (graphics_context.has_egl_device() or graphics_context.has_osmesa()), reason="neither EGL nor OSMesa"
)

GAIT = {"strides": 1, "time_step": 1e-3}
SINGLE: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "gait": (AnkleGaitEnv, GAIT),
    "bench": (AnkleBenchEnv, {"duration": 1.0}),
    "joint": (AntagonistJointEnv, {"duration": 1.0}),
    "walk": (AnkleWalkEnv, {"duration": 1.0}),
}
VECTOR: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "gait": (AnkleGaitVectorEnv, GAIT),
    "bench": (AnkleBenchVectorEnv, {"duration": 1.0}),
    "joint": (AntagonistJointVectorEnv, {"duration": 1.0}),
    "walk": (AnkleWalkVectorEnv, {"duration": 1.0}),
}


def make(table: dict[str, Any], name: str, **options: Any) -> Any:
    create, given = table[name]
    return create(**given, width=64, height=48, **options)


def advance(env: Any, level: float, count: int) -> None:
    for _ in range(count):
        env.step(np.full(env.action_space.shape, level, dtype=np.float32))


@pytest.mark.slow
@pytest.mark.parametrize("name", SINGLE)
def test_images_show_the_pressure_and_distances_the_shapes(name: str) -> None:
    env = make(SINGLE, name, render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    advance(env, 1.0, 20)
    after = env.render()
    assert before.shape == after.shape == (48, 64, 3)
    assert before.dtype == np.uint8

    def count_green(image: Any) -> int:
        red, green, blue = (image[..., k].astype(int) for k in range(3))
        return int(((green > red + 60) & (green > blue + 60)).sum())

    assert count_green(after) > count_green(before)
    assert np.array_equal(after, env.render())
    env.close()
    env = make(SINGLE, name, render_mode="depth_array")
    env.reset(seed=0)
    distance = env.render()
    assert distance.shape == (48, 64)
    assert distance.dtype == np.float32
    assert 0.3 < distance.min() < 3.0 < distance.max()
    env.close()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in ("gait", "walk") else []) for name in VECTOR]
)
def test_a_vector_environment_draws_what_single_ones_draw(name: str) -> None:
    envs = make(VECTOR, name, num_envs=2, render_mode="rgb_array", n_jobs=1)
    envs.reset(seed=3)
    advance(envs, 0.5, 5)
    images = envs.render()
    assert len(images) == 2
    for index, image in enumerate(images):
        env = make(SINGLE, name, render_mode="rgb_array")
        env.reset(seed=3 + index)
        advance(env, 0.5, 5)
        # A single simulation keeps the kinematics of the beginning of its last time step.
        assert np.abs(image.astype(int) - env.render().astype(int)).mean() < 2.0
        env.close()
    envs.close()


@pytest.mark.slow
def test_randomised_simulations_are_drawn_with_their_own_model() -> None:
    ranges = {"device": {"muscle.resting_length_mm": 0.02}, "speed_m_per_s": (0.8, 1.5), "slope_deg": (-5.0, 5.0)}
    envs = make(VECTOR, "gait", num_envs=2, render_mode="rgb_array", domain_randomization=ranges, n_jobs=1)
    envs.reset(seed=0)
    first, second = envs.render()
    assert not np.array_equal(first, second)
    envs.close()


@pytest.mark.slow
def test_cameras_and_sizes() -> None:
    images = []
    for camera in ("side", "corner", "prosthesis_close"):
        env = make(SINGLE, "gait", render_mode="rgb_array", camera=camera)
        env.reset(seed=0)
        images.append(env.render())
        env.close()
    assert not np.array_equal(images[0], images[1])
    assert not np.array_equal(images[1], images[2])


@pytest.mark.slow
def test_a_copy_draws_the_same() -> None:
    env = make(SINGLE, "bench", render_mode="rgb_array")
    env.reset(seed=0)
    advance(env, 1.0, 3)
    image = env.render()
    other = pickle.loads(pickle.dumps(env))
    assert np.array_equal(other.render(), image)
    envs = make(VECTOR, "bench", num_envs=1, render_mode="rgb_array", n_jobs=1)
    envs.reset(seed=0)
    (picture,) = envs.render()
    assert np.array_equal(pickle.loads(pickle.dumps(envs)).render()[0], picture)


def test_drawing_changes_no_bit_of_an_episode() -> None:
    rewards = []
    for mode in (None, "rgb_array"):
        env = make(SINGLE, "bench", render_mode=mode)
        env.reset(seed=1)
        total = []
        for _ in range(5):
            total.append(env.step(np.ones(1, dtype=np.float32))[1])
            assert (env.render() is None) == (mode is None)
        rewards.append(total)
        env.close()
    assert rewards[0] == rewards[1]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"render_mode": "ansi"}, "render_mode is 'ansi'; allowed: None, human, rgb_array, depth_array"),
        ({"camera": "sid"}, "the model has no camera 'sid'; did you mean 'side'?"),
        ({"width": 0}, "the image size is 0 x 48; allowed: 1 to 4096 pixels"),
    ],
)
def test_invalid_options_are_refused(options: dict[str, Any], sentence: str) -> None:
    def draw(create: Callable[..., Any], given: dict[str, Any]) -> None:
        env = create(**{**given, "width": 64, "height": 48, "render_mode": "rgb_array", **options})
        env.reset(seed=0)
        env.render()

    for create, given in SINGLE.values():
        with pytest.raises(InputError, match=sentence):  # the model of a person exists from the first reset on
            draw(create, given)


def test_a_batch_has_no_window() -> None:
    with pytest.raises(InputError, match="render_mode is 'human'; allowed: None, rgb_array, depth_array"):
        make(VECTOR, "bench", num_envs=1, render_mode="human")
    assert AnkleBenchVectorEnv.metadata["render_modes"] == list(frames.VECTOR_RENDER_MODES)


def test_vector_environments_of_gymnasium_draw() -> None:
    options = {"duration": 1.0, "render_mode": "rgb_array", "width": 32, "height": 32}
    envs = gymnasium.make_vec("klute_sim/AnkleBench-v0", 2, "vector_entry_point", **options)
    envs.reset(seed=0)
    assert [image.shape for image in envs.render()] == [(32, 32, 3)] * 2
    envs.close()
