"""``klute_sim/AntagonistJoint-v0``: tables of the documentation, physics of the joint, and the PID baseline."""

import copy
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


def test_rate_of_the_target_leads_to_the_next_target_up_to_the_end() -> None:
    env = AntagonistJointEnv(duration=0.4)
    observations, ended = [env.reset(seed=1)[0]], False
    while not ended:
        observation, _, terminated, truncated, _ = env.step(np.zeros(2, dtype=np.float32))
        observations.append(observation)
        ended = terminated or truncated
    target, rate = np.array(observations)[:, 2:4].T
    assert np.diff(target) / env.dt == pytest.approx(rate[:-1], abs=1e-3)
    assert rate[-1] == pytest.approx(2.0 * rate[-2] - rate[-3], abs=0.02)


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


RANGES = {
    "load_kg": (0.5, 2.0),
    "device": {"muscle.c10_kpa": 0.2, "tendon.stiffness_1_n_per_mm": 0.2},
    "effects": {"pressure_lag": {"time_constant_s": (0.0, 0.05)}},
}


def roll_out(env: gymnasium.Env, seed: int, n_steps: int = 20) -> tuple[dict[str, float], np.ndarray]:
    observation, info = env.reset(seed=seed)
    observations = [observation]
    for _ in range(n_steps):
        observation, *_ = env.step(np.array([0.3, -0.2], dtype=np.float32))
        observations.append(observation)
    return info, np.array(observations)


def test_each_episode_draws_load_and_both_devices() -> None:
    env = AntagonistJointEnv(duration=1.0, domain_randomization=RANGES)
    drawn = [roll_out(env, seed, 0)[0] for seed in range(12)]
    assert {info["load_kg"] for info in drawn} <= set(np.linspace(0.5, 2.0, 5))
    assert len({info["load_kg"] for info in drawn}) > 2
    for info in drawn:
        assert info["flexor/muscle.c10_kpa"] != info["extensor/muscle.c10_kpa"]
        assert 0.8 * 118.4 <= info["flexor/muscle.c10_kpa"] <= 1.2 * 118.4
        assert 0.0 <= info["extensor/effects.pressure_lag.time_constant_s"] <= 0.05


def test_drawn_load_equals_the_option() -> None:
    env = AntagonistJointEnv(duration=1.0, domain_randomization={"load_kg": (2.0, 2.0)})
    plain = AntagonistJointEnv(duration=1.0, load=2.0)
    assert env.reset(seed=4)[1] == {"load_kg": 2.0}
    plain.reset(seed=4)
    assert np.array_equal(env.model.body_mass, plain.model.body_mass)
    assert np.array_equal(env.model.body_inertia, plain.model.body_inertia)
    assert np.array_equal(env.model.dof_M0, plain.model.dof_M0)


def test_drawn_device_equals_a_device_with_these_numbers() -> None:
    env = AntagonistJointEnv(duration=1.0, domain_randomization={"device": {"muscle.c10_kpa": 0.3}})
    info, _ = roll_out(env, 2, 0)
    nominal = load_device("klute-3-4-pair")
    devices = {
        name: nominal.with_changes({"muscle.c10_kpa": info[f"{name}/muscle.c10_kpa"]})
        for name in ("flexor", "extensor")
    }
    changed = AntagonistJointEnv(duration=1.0, device=devices)
    changed.reset(seed=0)
    env.data.qpos[:], env.data.qvel[:] = changed.data.qpos, 0.0
    env.data.act[:], env.data.ctrl[:] = changed.data.act, changed.data.ctrl
    action = np.array([0.4, 0.1], dtype=np.float32)
    one, other = (each.step(action)[4]["force_flexor_n"] for each in (env, changed))
    assert one == pytest.approx(other, rel=1e-9)


def test_ranges_that_vary_nothing_change_no_bit() -> None:
    plain = roll_out(AntagonistJointEnv(duration=1.0), 5)[1]
    for ranges in ({}, {"load_kg": None}, {"device": {}, "effects": {}}):
        env = AntagonistJointEnv(duration=1.0, domain_randomization=ranges)
        assert np.array_equal(roll_out(env, 5)[1], plain)


def test_vector_environments_draw_as_single_ones_do() -> None:
    envs = gymnasium.make_vec(NAME, 3, "vector_entry_point", duration=1.0, domain_randomization=RANGES)
    observations, infos = envs.reset(seed=7)
    trajectories = [observations]
    for _ in range(20):
        observations, *_ = envs.step(np.tile(np.array([0.3, -0.2], dtype=np.float32), (3, 1)))
        trajectories.append(observations)
    for k in range(3):
        info, expected = roll_out(AntagonistJointEnv(duration=1.0, domain_randomization=RANGES), 7 + k)
        assert {name: infos[name][k] for name in info} == info
        assert np.array_equal(np.array(trajectories)[:, k], expected)


def test_copy_in_mid_episode_keeps_the_drawn_model() -> None:
    env = AntagonistJointEnv(duration=1.0, domain_randomization=RANGES)
    roll_out(env, 3, 5)
    twin = copy.deepcopy(env)
    action = np.array([0.5, -0.5], dtype=np.float32)
    for _ in range(5):
        assert np.array_equal(env.step(action)[0], twin.step(action)[0])
    assert np.array_equal(env.reset(seed=9)[0], twin.reset(seed=9)[0])


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"mass": 1.0}, "domain_randomization has no 'mass'; allowed: device, effects, load_kg"),
        ({"load_kg": (0.0, 1.0)}, "load_kg is 0 kg; allowed: 0.01 to 100 kg"),
        ({"load_kg": (2.0, 1.0)}, "lower limit first"),
        ({"device": {"muscle.count": 0.1}}, "cannot vary 'muscle.count'"),
        ({"device": {"muscle.c10_kpa": 0.9}}, "allowed: a fraction from 0 to 0.5"),
    ],
)
def test_impossible_ranges_are_refused(ranges: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        AntagonistJointEnv(domain_randomization=ranges)


def test_devices_on_rigid_tendons_cannot_vary() -> None:
    with pytest.raises(InputError, match="its damper is part of the model"):
        AntagonistJointEnv(device="klute-3-4", domain_randomization={"device": {"muscle.c10_kpa": 0.1}})
