"""Tests of the vector environment: equality with single environments in spaces, bits and resets."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv

import klute_sim  # noqa: F401  (registers)
from klute_sim.device.device import load_device
from klute_sim.errors import InputError

NAME, BENCH = "klute_sim/AnkleGait-v2", "klute_sim/AnkleBench-v0"
JOINT, WALK = "klute_sim/AntagonistJoint-v0", "klute_sim/AnkleWalk-v0"
SHORT = {"strides": 1, "time_step": 1e-3}
SHORT_BENCH = {"duration": 1.1, "cycle_duration": 0.3, "time_step": 1e-3}
SHORT_JOINT = {"duration": 1.1, "time_step": 1e-3}
SHORT_WALK = {"duration": 1.1, "gain_noise": 0.03, "sensor_noise": 1.0}


def make_envs(mode: str, autoreset: AutoresetMode, count: int = 3, name: str = NAME, **options: object) -> VectorEnv:
    options |= {NAME: SHORT, BENCH: SHORT_BENCH, JOINT: SHORT_JOINT, WALK: SHORT_WALK}[name]
    if mode == "sync":
        return gymnasium.make_vec(name, count, "sync", vector_kwargs={"autoreset_mode": autoreset}, **options)
    return gymnasium.make_vec(name, count, "vector_entry_point", autoreset_mode=autoreset, **options)


def are_equal(a: object, b: object) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(are_equal(a[k], b[k]) for k in a)
    if isinstance(a, np.ndarray) and a.dtype == object:
        return all(are_equal(x, y) for x, y in zip(a, b, strict=True))
    return a is b if a is None else np.array_equal(a, b)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        (NAME, {}),
        (BENCH, {"task": "force"}),
        (BENCH, {"task": "work", "device": "klute-1-1-4-pair-valve"}),
        (JOINT, {}),
        (WALK, {"action": "residual"}),
    ],
    ids=["gait", "force", "work", "joint", "walk"],
)
@pytest.mark.parametrize(
    "autoreset",
    [
        AutoresetMode.NEXT_STEP,
        *(pytest.param(mode, marks=pytest.mark.slow) for mode in (AutoresetMode.SAME_STEP, AutoresetMode.DISABLED)),
    ],
)
def test_batch_is_bit_identical_to_single_environments(
    autoreset: AutoresetMode, name: str, options: dict[str, object]
) -> None:
    sync_envs = make_envs("sync", autoreset, name=name, **options)
    batch = make_envs("batch", autoreset, name=name, n_jobs=2, **options)
    assert sync_envs.single_observation_space == batch.single_observation_space
    assert sync_envs.action_space == batch.action_space
    assert batch.metadata["autoreset_mode"] == autoreset
    first, second = sync_envs.reset(seed=5), batch.reset(seed=5)
    assert are_equal(first[0], second[0])
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(240):
        actions = rng.uniform(-1.2, 1.2, batch.action_space.shape).astype(np.float32)
        first, second = sync_envs.step(actions), batch.step(actions)
        for first_item, second_item in zip(first, second, strict=True):
            assert are_equal(first_item, second_item)
        done = first[2] | first[3]
        ended += done.sum()
        if autoreset == AutoresetMode.DISABLED and done.any():
            assert are_equal(
                sync_envs.reset(options={"reset_mask": done})[0], batch.reset(options={"reset_mask": done})[0]
            )
    assert ended == 6
    sync_envs.close()
    batch.close()


def test_number_of_threads_changes_no_bit() -> None:
    observations = []
    for n_jobs in (1, 2, 3):
        batch = make_envs("batch", AutoresetMode.NEXT_STEP, 5, n_jobs=n_jobs)
        batch.reset(seed=1)
        for k in range(60):
            observed = batch.step(np.full((5, 1), np.sin(k / 9), dtype=np.float32) * np.arange(5)[:, None] / 5)[0]
        observations.append(observed)
    assert np.array_equal(observations[0], observations[1])
    assert np.array_equal(observations[0], observations[2])
    assert len(np.unique(observations[0][:, 0])) == 5


def test_invalid_input_raises_one_sentence() -> None:
    batch = make_envs("batch", AutoresetMode.DISABLED, 2)
    with pytest.raises(InputError, match="no episodes yet"):
        batch.unwrapped.step(np.zeros((2, 1)))
    batch.reset(seed=1)
    for actions, message in ((np.zeros((3, 1)), "shape"), (np.array([[0.0], [np.nan]]), "contains nan")):
        with pytest.raises(InputError, match=message):
            batch.unwrapped.step(actions)
    with pytest.raises(InputError, match="reset_mask has shape"):
        batch.reset(options={"reset_mask": np.ones(3, dtype=bool)})
    with pytest.raises(InputError, match="at least one to reset"):
        batch.reset(options={"reset_mask": np.zeros(2, dtype=bool)})
    with pytest.raises(InputError, match="seed has 3 values; allowed: one value, or 2"):
        batch.reset(seed=[1, 2, 3])
    with pytest.raises(InputError, match="num_envs is 0"):
        gymnasium.make_vec(NAME, 0, "vector_entry_point")
    with pytest.raises(InputError, match="n_jobs is -1"):
        gymnasium.make_vec(NAME, 2, "vector_entry_point", n_jobs=-1)
    with pytest.raises(InputError, match="divisors of 10 ms"):
        gymnasium.make_vec(NAME, 2, "vector_entry_point", time_step=3e-4)


def test_action_of_environment_in_reset_is_ignored() -> None:
    batch = make_envs("batch", AutoresetMode.NEXT_STEP, 2).unwrapped
    batch.reset(seed=1)
    for _ in range(110):
        ended = batch.step(np.zeros((2, 1), dtype=np.float32))
    assert ended[3].all()
    assert np.isfinite(batch.step(np.full((2, 1), np.nan, dtype=np.float32))[0]).all()
    with pytest.raises(InputError, match="contains nan"):
        batch.step(np.full((2, 1), np.nan, dtype=np.float32))


def test_non_finite_state_ends_only_its_episode() -> None:
    batch = make_envs("batch", AutoresetMode.NEXT_STEP, 3).unwrapped
    batch.reset(seed=1)
    batch.step(np.zeros((3, 1), dtype=np.float32))
    batch._batch.bind("act")[1, -2] = np.nan
    _, reward, terminated, truncated, _ = batch.step(np.zeros((3, 1), dtype=np.float32))
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert np.isfinite(reward).all()
    observed = batch.step(np.zeros((3, 1), dtype=np.float32))[0]
    assert np.isfinite(observed).all()
    assert batch._task.elapsed_intervals.tolist() == [3, 0, 3]


def test_failure_in_the_last_interval_is_no_truncation() -> None:
    batch = gymnasium.make_vec(JOINT, 2, "vector_entry_point", duration=0.05).unwrapped
    batch.reset(seed=1)
    for _ in range(4):
        batch.step(np.zeros((2, 2), dtype=np.float32))
    batch._batch.bind("qpos")[1, 0] = np.nan
    _, _, terminated, truncated, _ = batch.step(np.zeros((2, 2), dtype=np.float32))
    assert terminated.tolist() == [False, True]
    assert truncated.tolist() == [True, False]


def test_another_device_is_supported() -> None:
    batch = gymnasium.make_vec(
        NAME, 2, "vector_entry_point", device=load_device("klute-3-4-pair"), mass=50.0, stature=1.9
    )
    batch.reset(seed=0)
    assert np.isfinite(batch.step(np.zeros((2, 1), dtype=np.float32))[0]).all()
