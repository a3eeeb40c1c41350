"""The batch of environments is the single environment, many times: spaces, bits, resets."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv

import klute_sim  # noqa: F401  (registers)
from klute_sim.device.device import load_device
from klute_sim.errors import InputError

NAME = "klute_sim/AnkleGait-v1"
SHORT = {"strides": 1, "step": 1e-3}


def make(mode: str, autoreset: AutoresetMode, count: int = 3, **options: object) -> VectorEnv:
    if mode == "sync":
        return gymnasium.make_vec(NAME, count, "sync", vector_kwargs={"autoreset_mode": autoreset}, **SHORT, **options)
    return gymnasium.make_vec(NAME, count, "vector_entry_point", autoreset_mode=autoreset, **SHORT, **options)


def same(a: object, b: object) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, np.ndarray) and a.dtype == object:
        return all(same(x, y) for x, y in zip(a, b, strict=True))
    return a is b if a is None else np.array_equal(a, b)


@pytest.mark.parametrize("autoreset", list(AutoresetMode))
def test_the_batch_is_the_same_as_environments_in_turn_bit_for_bit(autoreset: AutoresetMode) -> None:
    turn, batch = make("sync", autoreset), make("batch", autoreset, threads=2)
    assert turn.single_observation_space == batch.single_observation_space
    assert turn.action_space == batch.action_space
    assert batch.metadata["autoreset_mode"] == autoreset
    first, second = turn.reset(seed=5), batch.reset(seed=5)
    assert same(first[0], second[0])
    random = np.random.default_rng(0)
    ended = 0
    for _ in range(240):
        actions = random.uniform(-1.2, 1.2, (3, 1)).astype(np.float32)
        first, second = turn.step(actions), batch.step(actions)
        for one, other in zip(first, second, strict=True):
            assert same(one, other)
        done = first[2] | first[3]
        ended += done.sum()
        if autoreset == AutoresetMode.DISABLED and done.any():
            assert same(turn.reset(options={"reset_mask": done})[0], batch.reset(options={"reset_mask": done})[0])
    assert ended == 6
    turn.close()
    batch.close()


def test_the_number_of_threads_changes_no_bit() -> None:
    seen = []
    for threads in (1, 2, 3):
        batch = make("batch", AutoresetMode.NEXT_STEP, 5, threads=threads)
        batch.reset(seed=1)
        for k in range(60):
            observed = batch.step(np.full((5, 1), np.sin(k / 9), dtype=np.float32) * np.arange(5)[:, None] / 5)[0]
        seen.append(observed)
    assert np.array_equal(seen[0], seen[1])
    assert np.array_equal(seen[0], seen[2])
    assert len(np.unique(seen[0][:, 0])) == 5


def test_bad_input_is_refused_in_one_sentence() -> None:
    batch = make("batch", AutoresetMode.DISABLED, 2)
    with pytest.raises(InputError, match="reset the environments"):
        batch.unwrapped.step(np.zeros((2, 1)))
    batch.reset(seed=1)
    for actions, words in ((np.zeros((3, 1)), "shape"), (np.array([[0.0], [np.nan]]), "not a number")):
        with pytest.raises(InputError, match=words):
            batch.unwrapped.step(actions)
    with pytest.raises(InputError, match="reset_mask has shape"):
        batch.reset(options={"reset_mask": np.ones(3, dtype=bool)})
    with pytest.raises(InputError, match="at least one to reset"):
        batch.reset(options={"reset_mask": np.zeros(2, dtype=bool)})
    with pytest.raises(InputError, match="3 seeds for 2 environments"):
        batch.reset(seed=[1, 2, 3])
    with pytest.raises(InputError, match="0 simulations"):
        gymnasium.make_vec(NAME, 0, "vector_entry_point")
    with pytest.raises(InputError, match="-1 threads"):
        gymnasium.make_vec(NAME, 2, "vector_entry_point", threads=-1)
    with pytest.raises(InputError, match="divides 10 ms"):
        gymnasium.make_vec(NAME, 2, "vector_entry_point", step=3e-4)


def test_what_is_said_to_an_environment_that_is_reset_does_not_count() -> None:
    batch = make("batch", AutoresetMode.NEXT_STEP, 2).unwrapped
    batch.reset(seed=1)
    for _ in range(110):
        ended = batch.step(np.zeros((2, 1), dtype=np.float32))
    assert ended[3].all()
    assert np.isfinite(batch.step(np.full((2, 1), np.nan, dtype=np.float32))[0]).all()
    with pytest.raises(InputError, match="not a number"):
        batch.step(np.full((2, 1), np.nan, dtype=np.float32))


def test_a_simulation_without_a_finite_state_ends_its_episode_alone() -> None:
    batch = make("batch", AutoresetMode.NEXT_STEP, 3).unwrapped
    batch.reset(seed=1)
    batch.step(np.zeros((3, 1), dtype=np.float32))
    batch._batch.bind("act")[1, -2] = np.nan
    _, reward, terminated, truncated, _ = batch.step(np.zeros((3, 1), dtype=np.float32))
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert np.isfinite(reward).all()
    observed = batch.step(np.zeros((3, 1), dtype=np.float32))[0]
    assert np.isfinite(observed).all()
    assert batch._task.steps.tolist() == [3, 0, 3]


def test_another_device_walks_too() -> None:
    batch = gymnasium.make_vec(
        NAME, 2, "vector_entry_point", device=load_device("klute-3-4-pair"), mass=50.0, stature=1.9
    )
    batch.reset(seed=0)
    assert np.isfinite(batch.step(np.zeros((2, 1), dtype=np.float32))[0]).all()
