"""Tests of Gymnasium's rules in all environments: order of calls, options, copies, threads, specification."""

import copy
import pickle
import threading
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

import klute_sim  # noqa: F401  (registers)
from klute_sim.device.device import Device, load_device, parse_device
from klute_sim.envs.base.errors import ConcurrentUseError
from klute_sim.envs.registration import ENVIRONMENTS
from klute_sim.errors import InputError, KluteSimError

GAIT, BENCH = "klute_sim/AnkleGait-v2", "klute_sim/AnkleBench-v0"
JOINT, WALK = "klute_sim/AntagonistJoint-v0", "klute_sim/AnkleWalk-v0"
SHORT: dict[str, dict[str, Any]] = {
    GAIT: {"strides": 1, "time_step": 1e-3},
    BENCH: {"duration": 1.0, "time_step": 1e-3},
    JOINT: {"duration": 1.0, "time_step": 1e-3},
    WALK: {"duration": 1.0},
}
EFFECTS = b"""
[effects.pressure_delay]
delay_s = 0.0125
[effects.tendon_hysteresis]
form = "maxwell"
stiffness_n_per_mm = 10
time_constant_s = 0.2
"""


def make_single(name: str, **options: Any) -> gymnasium.Env:
    return gymnasium.make(name, **SHORT[name], **options).unwrapped


def make_vector(name: str, count: int = 2, **options: Any) -> gymnasium.vector.VectorEnv:
    return gymnasium.make_vec(name, count, "vector_entry_point", **SHORT[name], **options).unwrapped


def make_action(env: Any) -> np.ndarray:
    return np.zeros(env.action_space.shape, dtype=np.float32)


def make_complicated_device(name: str) -> Device:
    preset = "klute-1-1-4-pair" if name == WALK else "klute-1-1-4-pair-valve"
    return parse_device(load_device(preset).content + EFFECTS, "complicated")


@pytest.fixture(params=list(ENVIRONMENTS))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_calls_without_an_episode_ask_for_a_reset(name: str) -> None:
    env = make_single(name)
    for call in (lambda: env.step(make_action(env)), env.render):
        with pytest.raises(gymnasium.error.ResetNeeded, match="no episode yet: call reset"):
            call()
    env.reset(seed=1)
    steps = 1
    while not any(env.step(make_action(env))[2:4]):
        steps += 1
    assert steps == env.max_episode_steps
    env.render()  # wrappers of Gymnasium draw the last picture after the end
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"the episode has ended: call reset\(\) before step"):
        env.step(make_action(env))
    env.reset()
    env.step(make_action(env))


def test_vector_calls_without_an_episode_ask_for_a_reset(name: str) -> None:
    envs = make_vector(name, autoreset_mode=AutoresetMode.DISABLED)
    actions = make_action(envs)
    for call in (lambda: envs.step(actions), envs.render):
        with pytest.raises(gymnasium.error.ResetNeeded, match="no episodes yet: call reset"):
            call()
    with pytest.raises(gymnasium.error.ResetNeeded, match="without reset_mask"):
        envs.reset(options={"reset_mask": np.array([True, False])})
    envs.reset(seed=1)
    while not envs.step(actions)[3].any():
        pass
    with pytest.raises(gymnasium.error.ResetNeeded, match="an episode has ended"):
        envs.step(actions)


def test_closed_environments_are_refused(name: str) -> None:
    for env in (make_single(name), make_vector(name)):
        action = make_action(env)
        env.reset(seed=1)
        env.close()
        env.close()
        for call in (env.reset, lambda env=env, action=action: env.step(action), env.render):
            with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="closed; make"):
                call()


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([np.inf], "action contains inf"),
        ([-np.inf], "action contains -inf"),
        ([np.nan], "action contains nan"),
        ([0.0, 0.0], r"action has shape \(2,\); allowed: \(1,\)"),
        (0.0, r"action has shape \(\)"),
        ([[0.0], [0.0, 1.0]], "action has type"),
        (["a"], "action has type"),
        ([1j], "action has type complex128"),
        ([True], "action has type bool"),
        (None, "action has type NoneType"),
    ],
)
def test_invalid_action_changes_nothing(name: str, action: object, message: str) -> None:
    env = make_single(name)
    if name == JOINT and isinstance(action, list) and len(action) == 1:
        action = action * 2
    if name == JOINT and action == [0.0, 0.0]:
        action, message = [0.0], r"action has shape \(1,\); allowed: \(2,\)"
    env.reset(seed=1)
    state = env.data.qpos.copy()
    with pytest.raises(gymnasium.error.InvalidAction, match=message):
        env.step(action)
    assert np.array_equal(env.data.qpos, state)
    env.step(make_action(env))


def test_invalid_reset_is_refused(name: str) -> None:
    env, envs = make_single(name), make_vector(name)
    with pytest.raises(InputError, match="reset has no option 'mass'; it takes none"):
        env.reset(options={"mass": 60.0})
    with pytest.raises(InputError, match=r"no option 'reset_mas'; did you mean 'reset_mask'\? Allowed: reset_mask"):
        envs.reset(options={"reset_mas": np.ones(2, dtype=bool)})
    for each in (env, envs):
        with pytest.raises(InputError, match="options of reset is of type list"):
            each.reset(options=["mass"])
        for seed, message in ((-1, "negative"), (1.5, "of type float"), ("a", "of type str"), (True, "of type bool")):
            with pytest.raises(gymnasium.error.Error, match=f"seed is {message}"):
                each.reset(seed=seed)
        each.reset(seed=np.int64(3), options={})
    assert env.np_random_seed == 3
    assert envs.np_random_seed == (3, 4)
    options = {"reset_mask": np.array([False, True])}
    envs.reset(seed=[7, 8], options=options)
    assert list(options) == ["reset_mask"]
    assert envs.np_random_seed == (3, 8)


@pytest.mark.parametrize(
    "copy_environment",
    [
        copy.deepcopy,
        pytest.param(copy.copy, marks=pytest.mark.slow),
        pytest.param(lambda env: pickle.loads(pickle.dumps(env)), marks=pytest.mark.slow),
    ],
)
def test_copy_in_mid_episode_continues_exactly(name: str, copy_environment: Any) -> None:
    options: dict[str, Any] = {"device": make_complicated_device(name)}
    if name == GAIT:
        ranges = {"mass_fraction": 0.1, "device": {"muscle.c10_kpa": 0.1}}
        options |= {"sensor_noise": 1.0, "sensor_delay": 3, "domain_randomization": ranges}
    elif name == BENCH:
        options["task"] = "work"
    elif name == WALK:
        noise = {"sensor_noise": 1.0, "sensor_delay": 3, "gain_noise": 0.03}
        options |= {"action": "residual", "unevenness": 0.005, **noise}
    rng = np.random.default_rng(0)
    for original in (make_single(name, **options), make_vector(name, **options)):
        shape = original.action_space.shape
        original.reset(seed=5)
        original.action_space.seed(5)
        for _ in range(37):
            original.step(rng.uniform(-1, 1, shape).astype(np.float32))
        duplicate = copy_environment(original)
        for _ in range(80):  # past the end of the episode
            assert np.array_equal(original.action_space.sample(), duplicate.action_space.sample())
            action = rng.uniform(-1, 1, shape).astype(np.float32)
            first, second = original.step(action), duplicate.step(action)
            assert_equal(first, second)
            if len(shape) == 1 and (first[2] or first[3]):
                assert_equal(original.reset(), duplicate.reset())
        assert not np.array_equal(original.step(action)[0], original.step(action)[0])


def assert_equal(first: Any, second: Any) -> None:
    """Compare every bit."""
    assert data_equivalence(first, second, exact=True)


def test_second_thread_is_refused_while_the_first_steps(name: str) -> None:
    env = make_single(name)
    env.reset(seed=1)
    errors: list[Exception] = []

    def step() -> None:
        for _ in range(30):
            try:
                env.step(make_action(env))
            except KluteSimError as error:
                errors.append(error)

    threads = [threading.Thread(target=step) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(isinstance(error, ConcurrentUseError) for error in errors)
    with env._thread_guard, pytest.raises(ConcurrentUseError, match="two threads at the same time; give each"):
        env.step(make_action(env))
    with env._thread_guard, pytest.raises(ConcurrentUseError):
        pickle.dumps(env)
    env.step(make_action(env))


@pytest.mark.parametrize(
    "backends",
    [
        *(pytest.param((name, name), marks=pytest.mark.slow) for name in ("compiled", "python")),
        ("python", "compiled"),
    ],
)
def test_environments_in_two_threads_equal_one_after_the_other(name: str, backends: tuple[str, str]) -> None:
    def run(backend: str, seed: int) -> list[np.ndarray]:
        env = make_single(name, backend=backend)  # compiles a model while the other steps
        env.reset(seed=seed)
        return [env.step(np.full(env.action_space.shape, np.sin(k)))[0] for k in range(10)]

    results: dict[int, list[np.ndarray]] = {}
    threads = [
        threading.Thread(target=lambda k=k, backend=backend: results.update({k: run(backend, k)}))
        for k, backend in enumerate(backends)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for k, backend in enumerate(backends):
        assert np.array_equal(results[k], run(backend, k))


def test_specification_has_the_length_and_makes_the_same_environment(name: str) -> None:
    env = gymnasium.make(name)
    assert env.spec is not None
    assert env.spec.max_episode_steps == {GAIT: 550, BENCH: 500, JOINT: 500, WALK: 2000}[name]
    assert gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json()) == env.spec
    again = env.spec.make()
    assert again.spec == env.spec
    assert name in gymnasium.pprint_registry(disable_print=True)
    assert gymnasium.make(name, **SHORT[name]).spec.max_episode_steps in (100, 110)
    assert env.metadata["render_fps"] == 100


def test_round_trip_of_specification_truncates_once(name: str) -> None:
    first = gymnasium.make(name, **SHORT[name])
    second = first.spec.make()
    for env in (first, second, gymnasium.make(name, max_episode_steps=20, **SHORT[name])):
        env.reset(seed=0)
        steps = 1
        while not (ended := env.step(make_action(env)))[3]:
            assert not ended[2]
            steps += 1
        assert steps == env.spec.max_episode_steps
    envs = gymnasium.make_vec(name, 2, max_episode_steps=20, **SHORT[name])
    again = gymnasium.make_vec(envs.spec)
    assert again.spec.max_episode_steps == envs.spec.max_episode_steps == 20
    again.reset(seed=0)
    truncated = [again.step(make_action(again))[3].all() for _ in range(20)]
    assert truncated == [False] * 19 + [True]


def test_invalid_vector_options_are_refused(name: str) -> None:
    for options, message in (
        ({"num_envs": 0}, "num_envs is 0; allowed: a whole number from 1"),
        ({"num_envs": 2.5}, "num_envs is 2.5"),
        ({"n_jobs": -1}, "n_jobs is -1"),
        ({"autoreset_mode": "never"}, "autoreset_mode is 'never'; allowed: NextStep, SameStep, Disabled"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0"),
        ({"render_mode": "ansi"}, "render_mode is 'ansi'; allowed: None"),
    ):
        with pytest.raises(InputError, match=message):
            gymnasium.make_vec(name, vectorization_mode="vector_entry_point", **options)


@pytest.mark.parametrize(
    "slot",
    [
        "act_dyn",
        *(pytest.param(slot, marks=pytest.mark.slow) for slot in ("act_gain", "act_bias", "passive", "sensor")),
        "control",
        "contactfilter",
    ],
)
def test_callbacks_of_a_user_are_neither_called_nor_lost(name: str, slot: str) -> None:
    def fail(*arguments: object) -> float:
        raise AssertionError(slot)

    expected = [run_three_steps(make_single(name)), run_three_steps(make_vector(name))]
    getattr(mujoco, f"set_mjcb_{slot}")(fail)
    try:
        observed = [run_three_steps(make_single(name)), run_three_steps(make_vector(name))]
        assert getattr(mujoco, f"get_mjcb_{slot}")() is fail
    finally:
        getattr(mujoco, f"set_mjcb_{slot}")(None)
    assert all(np.array_equal(*pair) for pair in zip(expected, observed, strict=True))


def run_three_steps(env: Any) -> np.ndarray:
    env.reset(seed=1)
    for _ in range(3):
        observation = env.step(np.zeros(env.action_space.shape))[0]
    return np.asarray(observation)
