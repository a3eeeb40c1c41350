"""Tests of the bench environment: agreement with the tester, and rewards of both tasks."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import seeding
from gymnasium.utils.env_checker import check_env

from klute_sim import bench
from klute_sim.device.device import load_device, parse_device
from klute_sim.device.dynamics import DeviceState
from klute_sim.envs.ankle_bench import AnkleBenchEnv
from klute_sim.envs.tasks.bench_task import BENCH_TASKS, OBSERVATIONS
from klute_sim.envs.tasks.bench_trajectory import (
    MAX_FORCE_FRACTION,
    MAX_LENGTH_RATIO,
    MIN_FORCE_FRACTION,
    MIN_LENGTH_RATIO,
)
from klute_sim.errors import InputError

NAME = "klute_sim/AnkleBench-v0"


def make_action(value: float) -> np.ndarray:
    return np.array([value], dtype=np.float32)


@pytest.mark.parametrize("task", list(BENCH_TASKS))
@pytest.mark.parametrize("device", ["klute-1-1-4-pair", "klute-1-1-4-pair-valve", "klute-3-4"])
def test_environment_passes_gymnasium_checker(task: str, device: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(NAME, task=task, device=device).unwrapped, skip_render_check=True)


def test_documented_tables_match_code() -> None:
    text = AnkleBenchEnv.__doc__ or ""
    for number, (name, unit, low, high) in enumerate(OBSERVATIONS):
        assert f"| {number} | {name} | {unit} | {low:g} | {high:g} |" in text
    for name, meaning in BENCH_TASKS.items():
        assert f"| ``{name}`` | {meaning} |" in text
    for number in (MIN_LENGTH_RATIO, MAX_LENGTH_RATIO, MIN_FORCE_FRACTION, MAX_FORCE_FRACTION):
        assert f" {number:g} " in text


@pytest.mark.parametrize("device", ["klute-1-1-4-pair", "klute-3-4"])
def test_episode_equals_tester_simulation(device: str) -> None:
    env = AnkleBenchEnv(device=device, duration=2.0)
    env.reset(seed=2)
    unit_length = env._task.trajectory_generator.sample(seeding.np_random(2)[0]).unit_length
    actuator, parameters = env._task.actuator, env._task.actuator.parameters
    initial_state: DeviceState = actuator.get_state(env.data)
    rng = np.random.default_rng(0)
    pressures, observations, infos = [], [], []
    for k in range(200):
        value = np.float32(rng.uniform(-1, 1) if k % 10 == 0 else value)  # noqa: F821, held from the last iteration
        pressures += [0.5 * (float(value) + 1.0) * parameters.supply.max_pressure] * 20
        observation, _, terminated, _, info = env.step(make_action(value))
        assert not terminated
        observations.append(observation)
        infos.append(info)
    recording = bench.simulate_tester(
        load_device(device), unit_length, [*pressures, pressures[-1]], 5e-4, initial_state=initial_state
    )
    samples, observed_array = slice(19, None, 20), np.array(observations)
    assert np.abs(np.array([info["force_n"] for info in infos]) - recording["load_cell"][samples]).max() < 1e-6
    assert (
        np.abs(
            10.0 * observed_array[:, 0]
            + 1e3 * env._task.trajectory_generator.mean_length
            - recording["length"][samples]
        ).max()
        < 1e-3
    )
    assert np.abs(1e3 * observed_array[:, 2] - recording["load_cell"][samples]).max() < 0.01
    assert np.abs(recording["length"][samples] - 1e3 * unit_length[19::20]).max() < 0.1
    work = sum(info["work_delivered_j"] for info in infos)
    assert work == pytest.approx(float(-np.trapezoid(recording["force"], 1e-3 * recording["length"])), abs=0.2)
    air = sum(info["air_g"] for info in infos)
    air_drawn = 1e3 * np.maximum(np.diff(recording["air_mass"]), 0.0).sum()
    assert air == pytest.approx(air_drawn, rel=0.01)  # the recording has no sample before its first step


def test_force_task_rewards_target_force() -> None:
    env = AnkleBenchEnv(duration=2.0)
    observation, info = env.reset(seed=1)
    assert info == {}
    totals = []
    for gain in (0.0, 1.0):  # without and with force feedback
        observation, _ = env.reset(seed=1)
        value, total = 0.0, 0.0
        for _ in range(200):
            target, measured = 1e3 * float(observation[4]), 1e3 * float(observation[2])
            value = float(np.clip(value + gain * 2e-4 * (target - measured), -1.0, 1.0))
            observation, reward, _, truncated, info = env.step(make_action(value))
            error = (info["force_n"] - 1e3 * observation[4]) / (0.05 * env._task.trajectory_generator.max_force)
            assert info["reward_force"] == pytest.approx(np.exp(-0.5 * error * error), abs=1e-3)
            assert reward == pytest.approx(info["reward_force"] + info["reward_smoothness"])
            total += reward
        assert truncated
        totals.append(total)
    assert totals[1] > 1.2 * totals[0] > 0.0


def test_work_task_rewards_work_per_air_at_cycle_end() -> None:
    totals = {}
    for name, sign in (("with the motion", 1.0), ("against it", -1.0)):
        env = AnkleBenchEnv(task="work", duration=3.0, cycle_duration=1.0)
        observation, _ = env.reset(seed=1)
        work = air = total = 0.0
        for k in range(300):
            observation, reward, _, _, info = env.step(make_action(0.5 if sign * observation[1] < 0 else -1.0))
            total, work, air = total + reward, work + info["work_delivered_j"], air + info["air_g"]
            assert ("cycle_work_j" in info) == ((k + 1) % 100 == 0)
            if "cycle_work_j" in info:
                assert info["cycle_work_j"] == pytest.approx(work)
                assert info["cycle_air_g"] == pytest.approx(air)
                assert info["reward_work"] == pytest.approx(0.1 * work / (air + 0.1))
                work = air = 0.0
            else:
                assert info["reward_work"] == 0.0
        totals[name] = total
    assert totals["with the motion"] > 1.0
    assert totals["against it"] < -1.0


def test_trajectories_stay_within_limits() -> None:
    env = AnkleBenchEnv()
    parameters = env._task.actuator.parameters
    low, high = (
        parameters.tendon.slack_length + ratio * parameters.muscle.resting_length
        for ratio in (MIN_LENGTH_RATIO, MAX_LENGTH_RATIO)
    )
    observations = []
    for seed in range(20):
        trajectory = env._task.trajectory_generator.sample(seeding.np_random(seed)[0])
        assert trajectory.unit_length.min() >= low - 1e-9
        assert trajectory.unit_length.max() <= high + 1e-9
        force_fraction = trajectory.target_force / env._task.trajectory_generator.max_force
        assert MIN_FORCE_FRACTION - 1e-9 <= force_fraction.min() <= force_fraction.max() <= MAX_FORCE_FRACTION + 1e-9
        assert np.abs(np.diff(trajectory.target_force)).max() < 0.05 * env._task.trajectory_generator.max_force
        observations.append(trajectory.unit_length[0])
    assert len(np.unique(observations)) == 20


def test_dead_time_and_openings_are_supported() -> None:
    delayed_device = parse_device(
        load_device("klute-1-1-4-pair").content + b"\n[effects.pressure_delay]\ndelay_s = 0.0125\n", "late"
    )
    env = AnkleBenchEnv(device=delayed_device)
    env.reset(seed=0)
    initial_state = env.data.act[env._task.actuator.act_address]
    env.step(make_action(1.0))
    assert env.data.act[env._task.actuator.act_address] == pytest.approx(initial_state, abs=1e-9)
    env.step(make_action(1.0))
    assert env.data.act[env._task.actuator.act_address] == pytest.approx(initial_state + 50.0 * 0.0075, abs=1e-6)
    text = load_device("klute-1-1-4-pair-valve").content.decode()
    text = text.replace('command = "pressure"\ngain_per_bar = 5.0\n', 'command = "opening"\n')
    env = AnkleBenchEnv(device=parse_device(text.replace('"valve.gain_per_bar" =', "#").encode(), "opens"))
    env.reset(seed=0)
    assert env.data.act[env._task.actuator.act_address] == 0.0
    assert env.step(make_action(0.5))[4]["valve_command"] == 0.5
    assert env.data.act[env._task.actuator.act_address] > 0.1


def test_backends_are_bit_identical() -> None:
    observations = []
    for backend in ("compiled", "python"):
        env = AnkleBenchEnv(backend=backend, duration=1.0, task="work")
        env.reset(seed=4)
        observations.append(np.array([env.step(make_action(k % 7 / 3.5 - 1.0))[0] for k in range(30)]))
    assert np.array_equal(*observations)


@pytest.mark.parametrize("backend", ["compiled", "python"])
def test_failed_device_ends_episode(backend: str) -> None:
    env = AnkleBenchEnv(backend=backend)
    env.reset(seed=0)
    env.data.act[env._task.actuator.act_address] = np.nan
    observation, reward, terminated, truncated, _ = env.step(make_action(0.0))
    assert terminated
    assert not truncated
    assert reward == 0.0
    assert observation in env.observation_space
    env.reset()
    assert not env.step(make_action(0.0))[2]


def test_environment_runs_in_worker_processes() -> None:
    sync_envs, async_envs = (
        gymnasium.make_vec(NAME, 2, mode, duration=1.0, time_step=1e-3) for mode in ("sync", "async")
    )
    assert np.array_equal(sync_envs.reset(seed=2)[0], async_envs.reset(seed=2)[0])
    for k in range(20):
        actions = np.full((2, 1), k / 20, dtype=np.float32)
        assert np.array_equal(sync_envs.step(actions)[0], async_envs.step(actions)[0])
    async_envs.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"task": "speed"}, "task is 'speed'; allowed: force, work"),
        ({"time_step": 3e-4}, "time_step is 0.3 ms; allowed: divisors of 10 ms"),
        ({"time_step": 0.0}, "time_step is 0 ms"),
        ({"cycle_duration": 0.05}, "cycle_duration is 50 ms; allowed: multiples of 10 ms from 100 ms"),
        ({"cycle_duration": np.nan}, "cycle_duration is nan"),
        ({"duration": 0.5}, "duration is 0.5 s; allowed: a cycle"),
        ({"duration": 1e4}, "duration is 10000"),
        ({"backend": "fast"}, "backend is 'fast'"),
    ],
)
def test_invalid_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        AnkleBenchEnv(**options)


def test_nan_action_is_refused() -> None:
    env = AnkleBenchEnv()
    env.reset(seed=0)
    with pytest.raises(InputError, match="contains nan"):
        env.step(make_action(np.nan))
