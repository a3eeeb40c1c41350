"""``klute_sim/AntagonistJoint-v0``: tables of the documentation, physics of the joint, and the PID baseline."""

import re

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import klute_sim  # noqa: F401  (registers)
from klute_sim.device.device import load_device
from klute_sim.envs.antagonist_joint import AntagonistJointEnv
from klute_sim.envs.joint_pid import PidController
from klute_sim.envs.tasks.joint_task import OBSERVATIONS
from klute_sim.errors import InputError

NAME = "klute_sim/AntagonistJoint-v0"


def run_episode(env: AntagonistJointEnv, controller: PidController | None, seed: int = 0) -> tuple[float, float]:
    """Return the mean reward and the root mean square error of the angle [deg]."""
    observation, _ = env.reset(seed=seed)
    rewards, errors, ended = [], [], False
    while not ended:
        action = np.zeros(2, dtype=np.float32) if controller is None else controller.act(observation)
        observation, reward, terminated, truncated, info = env.step(action)
        rewards.append(reward)
        errors.append(info["angle_error_deg"])
        ended = terminated or truncated
    return float(np.mean(rewards)), float(np.sqrt(np.mean(np.square(errors))))


def test_environment_passes_the_checks_of_gymnasium() -> None:
    check_env(gymnasium.make(NAME, duration=0.5).unwrapped, skip_render_check=True)


def test_documented_observations_are_those_of_the_space() -> None:
    rows = re.findall(r"\| (\d) \| (.*?) \| (.*?) \| (.*?) \| (.*?) \|", AntagonistJointEnv.__doc__ or "")
    documented = [(name, unit, float(low), float(high)) for _, name, unit, low, high in rows]
    assert documented == list(OBSERVATIONS)


def test_flexor_pressure_flexes_and_extensor_pressure_extends() -> None:
    env = AntagonistJointEnv(duration=2.0)
    angles = []
    for action in ([1.0, -1.0], [-1.0, 1.0]):
        env.reset(seed=1)
        for _ in range(150):
            observation, *_ = env.step(np.array(action, dtype=np.float32))
        angles.append(observation[0])
        assert observation[4:] == pytest.approx([5.0, 0.0] if action[0] > 0.0 else [0.0, 5.0], abs=1e-6)
    assert angles[0] > angles[1] + 1.0


def test_episode_starts_at_rest_on_its_target() -> None:
    env = AntagonistJointEnv()
    observation, _ = env.reset(seed=3)
    assert observation[1] == 0.0
    assert observation[2] == pytest.approx(observation[0], abs=1e-6)


def test_pid_follows_the_target_and_co_contraction_alone_does_not() -> None:
    env = AntagonistJointEnv(time_step=1e-3)
    resting_reward, resting_error = run_episode(env, None)
    reward, error = run_episode(env, PidController())
    assert error < 2.5
    assert resting_error > 10.0
    assert reward > resting_reward + 0.4


def test_pid_works_on_many_environments_at_once() -> None:
    env = AntagonistJointEnv(duration=0.5)
    observation, _ = env.reset(seed=0)
    single, many = PidController(), PidController()
    for _ in range(5):
        action = single.act(observation)
        assert np.array_equal(many.act(np.stack([observation, observation])), [action, action])
        observation, *_ = env.step(action)
    single.reset()
    assert np.array_equal(single.act(observation), PidController().act(observation))


def test_tendons_may_have_different_devices() -> None:
    weak = load_device("klute-1-2")
    env = AntagonistJointEnv(device={"flexor": "klute-3-4-pair", "extensor": weak}, duration=1.0)
    env.reset(seed=1)
    for _ in range(50):
        *_, info = env.step(np.zeros(2, dtype=np.float32))
    assert info["force_flexor_n"] > info["force_extensor_n"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"duration": 0.0}, "duration is 0 s"),
        ({"time_step": 0.003}, "divisors of 10 ms"),
        ({"device": {"flexor": "klute-3-4"}}, "'extensor' has no device"),
        ({"device": {"flexor": "klute-3-4", "biceps": "klute-3-4"}}, "'biceps' has no device or does not exist"),
        ({"render_mode": "ansi"}, "render_mode is 'ansi'"),
    ],
)
def test_invalid_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        AntagonistJointEnv(**options)  # type: ignore[arg-type]
