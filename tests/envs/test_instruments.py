"""Sensors that are noisy and late, and what is told from them."""

import gymnasium
import numpy as np
import pytest

from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.tasks.instruments import N_MEASURED, OBSERVATIONS
from klute_sim.errors import InputError

TYPICAL = np.array([row[4] for row in OBSERVATIONS[:N_MEASURED]])


def walk(count: int = 330, **options: object) -> np.ndarray:
    env = AnkleGaitEnv(action="residual", strides=3, **options)
    seen = [env.reset(seed=5)[0]]
    for _ in range(count):
        seen.append(env.step(np.zeros(1, dtype=np.float32))[0])
    return np.array(seen)


@pytest.fixture(scope="module")
def perfect() -> np.ndarray:
    return walk()


def test_noise_has_the_size_that_is_documented(perfect: np.ndarray) -> None:
    base = gymnasium.make("klute_sim/AnkleGait-v1", strides=3).unwrapped
    noisy = gymnasium.make("klute_sim/AnkleGait-v1", strides=3, sensor_noise=2.0).unwrapped
    apart = [noisy.reset(seed=5)[0] - base.reset(seed=5)[0]]
    for _ in range(329):  # pressures do not depend on the senses: the same walk
        apart.append(noisy.step(np.full(1, -0.7))[0] - base.step(np.full(1, -0.7))[0])
    noise = np.array(apart)[:, :N_MEASURED]
    assert noise.std(axis=0) == pytest.approx(2.0 * TYPICAL, rel=0.15)
    assert np.abs(noise.mean(axis=0)).max() < 0.5
    assert np.abs(np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]) < 0.2


def test_the_noise_is_the_seed_s() -> None:
    assert np.array_equal(walk(20, sensor_noise=1.0), walk(20, sensor_noise=1.0))


def test_delay_is_by_whole_intervals() -> None:
    prompt, late = (gymnasium.make("klute_sim/AnkleGait-v1", strides=2, sensor_delay=k).unwrapped for k in (0, 3))
    seen = []
    for env in (prompt, late):
        own = [env.reset(seed=5)[0]]
        own += [env.step(np.full(1, -0.7))[0] for _ in range(200)]
        seen.append(np.array(own)[:, :N_MEASURED])
    assert np.array_equal(seen[1][3:], seen[0][:-3])
    assert np.array_equal(seen[1][:3], np.repeat(seen[0][:1], 3, axis=0))


def test_the_phase_knows_of_a_strike_only_when_the_sensor_does() -> None:
    strikes = []
    for delay in (0, 4):
        env = gymnasium.make("klute_sim/AnkleGait-v1", strides=2, sensor_delay=delay).unwrapped
        env.reset(seed=5)
        sine = np.array([env.step(np.full(1, -0.7))[0][6] for _ in range(150)])
        back = np.flatnonzero((sine[80:-1] < -0.01) & (sine[81:] >= -0.01))
        strikes.append(80 + back[0])
    assert strikes[1] - strikes[0] in (3, 4, 5)


def test_the_phase_is_found_in_typical_noise(perfect: np.ndarray) -> None:
    noisy = walk(sensor_noise=1.0)
    turn = [np.unwrap(np.arctan2(o[:, 6], o[:, 7])) for o in (perfect, noisy)]
    assert np.abs(turn[0] - turn[1]).max() < 0.06 * 2 * np.pi


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"sensor_noise": -1.0}, "sensor_noise is -1; allowed: 0 to 100"),
        ({"sensor_noise": np.nan}, "sensor_noise is nan"),
        ({"sensor_delay": 1.5}, "sensor_delay is 1.5; allowed: 0 to 20 whole intervals"),
        ({"sensor_delay": -1}, "sensor_delay is -1"),
    ],
)
def test_what_cannot_be_is_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        AnkleGaitEnv(**options)
