"""The bench environment: the tester's own numbers, and tasks that reward what they say."""

import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from klute_sim import bench
from klute_sim.device.device import load_device, parse_device
from klute_sim.device.dynamics import DeviceState
from klute_sim.envs.ankle_bench import AnkleBenchEnv
from klute_sim.envs.tasks.bench_task import (
    BENCH_TASKS,
    MAX_FORCE_FRACTION,
    MAX_LENGTH_RATIO,
    MIN_FORCE_FRACTION,
    MIN_LENGTH_RATIO,
    OBSERVATIONS,
)
from klute_sim.errors import InputError

NAME = "klute_sim/AnkleBench-v0"


def act(value: float) -> np.ndarray:
    return np.array([value], dtype=np.float32)


@pytest.mark.parametrize("task", list(BENCH_TASKS))
@pytest.mark.parametrize("device", ["klute-1-1-4-pair", "klute-1-1-4-pair-valve", "klute-3-4"])
def test_gymnasiums_checker_says_nothing(task: str, device: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(NAME, task=task, device=device).unwrapped, skip_render_check=True)


def test_the_documented_tables_are_what_there_is() -> None:
    text = AnkleBenchEnv.__doc__ or ""
    for number, (name, unit, low, high) in enumerate(OBSERVATIONS):
        assert f"| {number} | {name} | {unit} | {low:g} | {high:g} |" in text
    for name, what in BENCH_TASKS.items():
        assert f"| ``{name}`` | {what} |" in text
    for number in (MIN_LENGTH_RATIO, MAX_LENGTH_RATIO, MIN_FORCE_FRACTION, MAX_FORCE_FRACTION):
        assert f" {number:g} " in text


@pytest.mark.parametrize("device", ["klute-1-1-4-pair", "klute-3-4"])
def test_an_episode_is_a_pull_of_the_tester(device: str) -> None:
    env = AnkleBenchEnv(device=device, duration=2.0)
    env.reset(seed=2)
    actuator, p = env._actuator, env._actuator.parameters
    begin: DeviceState = actuator.get_state(env.data)
    random = np.random.default_rng(0)
    asked, seen, told = [], [], []
    for k in range(200):
        value = np.float32(random.uniform(-1, 1) if k % 10 == 0 else value)  # noqa: F821, of the round before
        asked += [0.5 * (float(value) + 1.0) * p.supply.max_pressure] * 20
        observed, _, terminated, _, info = env.step(act(value))
        assert not terminated
        seen.append(observed)
        told.append(info)
    found = bench.simulate_tester(
        load_device(device), env._trajectory.unit_length, [*asked, asked[-1]], 5e-4, initial_state=begin
    )
    at, seen_ = slice(19, None, 20), np.array(seen)
    assert np.abs(np.array([info["force_n"] for info in told]) - found["load_cell"][at]).max() < 1e-6
    assert np.abs(10.0 * seen_[:, 0] + 1e3 * env._trajectory_generator.mean_length - found["length"][at]).max() < 1e-3
    assert np.abs(1e3 * seen_[:, 2] - found["load_cell"][at]).max() < 0.01
    assert np.abs(found["length"][at] - 1e3 * env._trajectory.unit_length[19::20]).max() < 0.1
    work = sum(info["work_delivered_j"] for info in told)
    assert work == pytest.approx(float(-np.trapezoid(found["force"], 1e-3 * found["length"])), abs=0.2)
    air = sum(info["air_g"] for info in told)
    drawn = 1e3 * np.maximum(np.diff(found["air_mass"]), 0.0).sum()
    assert air == pytest.approx(drawn, rel=0.05)


def test_force_rewards_the_force_that_is_wanted() -> None:
    env = AnkleBenchEnv(duration=2.0)
    observed, info = env.reset(seed=1)
    assert info == {}
    totals = []
    for gain in (0.0, 1.0):  # without and with a look at the force
        observed, _ = env.reset(seed=1)
        value, total = 0.0, 0.0
        for _ in range(200):
            wanted, pulled = 1e3 * float(observed[4]), 1e3 * float(observed[2])
            value = float(np.clip(value + gain * 2e-4 * (wanted - pulled), -1.0, 1.0))
            observed, reward, _, truncated, info = env.step(act(value))
            off = (info["force_n"] - 1e3 * observed[4]) / (0.05 * env._trajectory_generator.max_force)
            assert info["reward_force"] == pytest.approx(np.exp(-0.5 * off * off), abs=1e-3)
            assert reward == pytest.approx(info["reward_force"] + info["reward_smoothness"])
            total += reward
        assert truncated
        totals.append(total)
    assert totals[1] > 1.2 * totals[0] > 0.0


def test_work_rewards_work_per_air_at_the_end_of_each_cycle() -> None:
    totals = {}
    for name, sign in (("with the motion", 1.0), ("against it", -1.0)):
        env = AnkleBenchEnv(task="work", duration=3.0, cycle_duration=1.0)
        observed, _ = env.reset(seed=1)
        work = air = total = 0.0
        for k in range(300):
            observed, reward, _, _, info = env.step(act(0.5 if sign * observed[1] < 0 else -1.0))
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


def test_courses_stay_where_they_should() -> None:
    env = AnkleBenchEnv()
    p = env._actuator.parameters
    low, high = (
        p.tendon.slack_length + ratio * p.muscle.resting_length for ratio in (MIN_LENGTH_RATIO, MAX_LENGTH_RATIO)
    )
    seen = []
    for seed in range(20):
        env.reset(seed=seed)
        course = env._trajectory
        assert course.unit_length.min() >= low - 1e-9
        assert course.unit_length.max() <= high + 1e-9
        share = course.target_force / env._trajectory_generator.max_force
        assert MIN_FORCE_FRACTION - 1e-9 <= share.min() <= share.max() <= MAX_FORCE_FRACTION + 1e-9
        assert np.abs(np.diff(course.target_force)).max() < 0.05 * env._trajectory_generator.max_force
        seen.append(course.unit_length[0])
    assert len(np.unique(seen)) == 20


def test_a_dead_time_and_openings_are_known_here_too() -> None:
    late = parse_device(
        load_device("klute-1-1-4-pair").content + b"\n[effects.pressure_delay]\ndelay_s = 0.0125\n", "late"
    )
    env = AnkleBenchEnv(device=late)
    env.reset(seed=0)
    begin = env.data.act[env._actuator.act_address]
    env.step(act(1.0))
    assert env.data.act[env._actuator.act_address] == pytest.approx(begin, abs=1e-9)
    env.step(act(1.0))
    assert env.data.act[env._actuator.act_address] == pytest.approx(begin + 50.0 * 0.0075, abs=1e-6)
    text = load_device("klute-1-1-4-pair-valve").content.decode()
    text = text.replace('takes = "pressure"\ngain_per_bar = 5.0\n', 'takes = "opening"\n')
    env = AnkleBenchEnv(device=parse_device(text.replace('"valve.gain_per_bar" =', "#").encode(), "opens"))
    env.reset(seed=0)
    assert env.data.act[env._actuator.act_address] == 0.0
    assert env.step(act(0.5))[4]["valve_command"] == 0.5
    assert env.data.act[env._actuator.act_address] > 0.1


def test_both_laws_give_the_same_bits() -> None:
    seen = []
    for law in ("compiled", "python"):
        env = AnkleBenchEnv(backend=law, duration=1.0, task="work")
        env.reset(seed=4)
        seen.append(np.array([env.step(act(k % 7 / 3.5 - 1.0))[0] for k in range(30)]))
    assert np.array_equal(*seen)


@pytest.mark.parametrize("law", ["compiled", "python"])
def test_a_device_that_fails_ends_the_episode(law: str) -> None:
    env = AnkleBenchEnv(backend=law)
    env.reset(seed=0)
    env.data.act[env._actuator.act_address] = np.nan
    observed, reward, terminated, truncated, _ = env.step(act(0.0))
    assert terminated
    assert not truncated
    assert reward == 0.0
    assert observed in env.observation_space
    env.reset()
    assert not env.step(act(0.0))[2]


def test_it_runs_side_by_side_and_survives_a_pickle() -> None:
    turn, workers = (gymnasium.make_vec(NAME, 2, mode, seconds=1.0, step=1e-3) for mode in ("sync", "async"))
    assert np.array_equal(turn.reset(seed=2)[0], workers.reset(seed=2)[0])
    for k in range(20):
        actions = np.full((2, 1), k / 20, dtype=np.float32)
        assert np.array_equal(turn.step(actions)[0], workers.step(actions)[0])
    workers.close()
    env = pickle.loads(pickle.dumps(AnkleBenchEnv(task="work", cycle_duration=0.5)))
    assert (env._task, env._cycle) == ("work", 50)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"task": "speed"}, "task is 'speed'; allowed: force, work"),
        ({"step": 3e-4}, "step is 0.3 ms; allowed: what divides 10 ms evenly"),
        ({"step": 0.0}, "step is 0 ms"),
        ({"cycle": 0.05}, "cycle is 50 ms; allowed: a whole number of 10 ms, 100 ms or more"),
        ({"cycle": np.nan}, "cycle is nan"),
        ({"seconds": 0.5}, "seconds is 0.5; allowed: a cycle"),
        ({"seconds": 1e4}, "seconds is 10000"),
        ({"law": "fast"}, "law is 'fast'"),
    ],
)
def test_what_cannot_be_is_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        AnkleBenchEnv(**options)


def test_an_action_that_is_no_number_is_refused() -> None:
    env = AnkleBenchEnv()
    env.reset(seed=0)
    with pytest.raises(InputError, match="not a number"):
        env.step(act(np.nan))
