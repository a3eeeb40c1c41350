"""Tests of noise and delay of the sensors, and of the phase estimated from them."""

import gymnasium
import numpy as np
import pytest

from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.tasks.instruments import N_MEASURED, OBSERVATIONS
from klute_sim.errors import InputError

TYPICAL = np.array([row[4] for row in OBSERVATIONS[:N_MEASURED]])


def record_observations(count: int = 330, **options: object) -> np.ndarray:
    env = AnkleGaitEnv(action="residual", strides=3, **options)
    observations = [env.reset(seed=5)[0]]
    for _ in range(count):
        observations.append(env.step(np.zeros(1, dtype=np.float32))[0])
    return np.array(observations)


@pytest.fixture(scope="module")
def ideal_observations() -> np.ndarray:
    return record_observations()


def test_noise_has_documented_deviation(ideal_observations: np.ndarray) -> None:
    base = gymnasium.make("klute_sim/AnkleGait-v2", strides=3).unwrapped
    noisy = gymnasium.make("klute_sim/AnkleGait-v2", strides=3, sensor_noise=2.0).unwrapped
    differences = [noisy.reset(seed=5)[0] - base.reset(seed=5)[0]]
    for _ in range(329):  # pressures do not depend on the sensors, so the motion is equal
        differences.append(noisy.step(np.full(1, -0.7))[0] - base.step(np.full(1, -0.7))[0])
    noise = np.array(differences)[:, :N_MEASURED]
    assert noise.std(axis=0) == pytest.approx(2.0 * TYPICAL, rel=0.15)
    assert np.abs(noise.mean(axis=0)).max() < 0.5
    assert np.abs(np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]) < 0.2


def test_noise_is_determined_by_seed() -> None:
    assert np.array_equal(record_observations(20, sensor_noise=1.0), record_observations(20, sensor_noise=1.0))


def test_delay_is_in_whole_intervals() -> None:
    prompt_env, delayed_env = (
        gymnasium.make("klute_sim/AnkleGait-v2", strides=2, sensor_delay=k).unwrapped for k in (0, 3)
    )
    observations = []
    for env in (prompt_env, delayed_env):
        episode = [env.reset(seed=5)[0]]
        episode += [env.step(np.full(1, -0.7))[0] for _ in range(200)]
        observations.append(np.array(episode)[:, :N_MEASURED])
    assert np.array_equal(observations[1][3:], observations[0][:-3])
    assert np.array_equal(observations[1][:3], np.repeat(observations[0][:1], 3, axis=0))


def test_sensor_delay_delays_phase_estimate() -> None:
    strikes = []
    for delay in (0, 4):
        env = gymnasium.make("klute_sim/AnkleGait-v2", strides=2, sensor_delay=delay).unwrapped
        env.reset(seed=5)
        sine = np.array([env.step(np.full(1, -0.7))[0][6] for _ in range(150)])
        crossings = np.flatnonzero((sine[80:-1] < -0.01) & (sine[81:] >= -0.01))
        strikes.append(80 + crossings[0])
    assert strikes[1] - strikes[0] in (3, 4, 5)


def test_phase_estimate_tolerates_typical_noise(ideal_observations: np.ndarray) -> None:
    noisy = record_observations(sensor_noise=1.0)
    phases = [np.unwrap(np.arctan2(o[:, 6], o[:, 7])) for o in (ideal_observations, noisy)]
    assert np.abs(phases[0] - phases[1]).max() < 0.06 * 2 * np.pi


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sensor_noise": -1.0}, "sensor_noise is -1; allowed: 0 to 100"),
        ({"sensor_noise": np.nan}, "sensor_noise is nan"),
        ({"sensor_delay": 1.5}, "sensor_delay is 1.5; allowed: 0 to 20 whole intervals"),
        ({"sensor_delay": -1}, "sensor_delay is -1"),
    ],
)
def test_invalid_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        AnkleGaitEnv(**options)
