"""``klute_sim/AnkleWalk-v0``: equality with simulated walks, reward, randomisation, sensors and refusals."""

import copy
import re

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import klute_sim  # noqa: F401  (registers)
from klute_sim.controllers.parse import parse_controller
from klute_sim.device.device import DEFAULT_DEVICE, Device, load_device
from klute_sim.envs.ankle_walk import AnkleWalkEnv
from klute_sim.envs.tasks.instruments import N_MEASURED, NOISE_DEVIATION, OBSERVATIONS
from klute_sim.envs.tasks.walk.person import WholeBodyState
from klute_sim.envs.tasks.walk.reward import DEFAULT_WEIGHTS, REWARD_TERMS
from klute_sim.errors import InputError
from klute_sim.types import Array
from klute_sim.units import BAR
from klute_sim.walker.outcomes import compute_outcomes
from klute_sim.walker.person.build import Prosthesis
from klute_sim.walker.reflexes.walker_file import load_walker
from klute_sim.walker.simulation.simulate import WalkOptions, simulate_walk
from tests.envs.test_actions import make_opening_device

NAME = "klute_sim/AnkleWalk-v0"
DEVICE = load_device(DEFAULT_DEVICE)
ZERO = np.zeros(1, dtype=np.float32)
Infos = dict[str, Array]


def run_episode(env: AnkleWalkEnv, action: float = 0.0, n_steps: int = 10_000, seed: int = 0) -> tuple[Array, Infos]:
    """Return the observations and the ``info`` of all steps with a constant ``action``."""
    observations, infos = [env.reset(seed=seed)[0]], []
    for _ in range(n_steps):
        observation, reward, terminated, truncated, info = env.step(np.full(1, action, dtype=np.float32))
        observations.append(observation)
        infos.append({**info, "reward": reward, "terminated": terminated, "hip_x_m": env.data.qpos[0]})
        if terminated or truncated:
            break
    return np.array(observations), {name: np.array([info[name] for info in infos]) for name in infos[0]}


def test_environment_passes_the_checks_of_gymnasium() -> None:
    check_env(gymnasium.make(NAME, duration=0.5).unwrapped, skip_render_check=True)


def test_documented_observations_are_those_of_the_prosthesis() -> None:
    rows = re.findall(r"\| (\d) \| (.*?) \| (.*?) \| (.*?) \| (.*?) \| (.*?) \|", AnkleWalkEnv.__doc__ or "")
    documented = [(name, unit, float(low), float(high), float(noise)) for _, name, unit, low, high, noise in rows]
    assert documented == list(OBSERVATIONS)


def test_documented_weights_are_the_defaults() -> None:
    rows = re.findall(r"\| ``reward_(\w+)`` \| (-?[\d.]+)", AnkleWalkEnv.__doc__ or "")
    assert {name: float(weight) for name, weight in rows} == dict(DEFAULT_WEIGHTS)


@pytest.mark.parametrize("device", [DEVICE, DEVICE.with_effect("pressure_delay", delay_s=0.0125)], ids=["", "delay"])
def test_zero_residual_is_the_walk_with_the_base_controller_to_the_bit(device: Device) -> None:
    machine, seconds = parse_controller("machine"), 3.0
    recording = simulate_walk(
        load_walker("machine-1"), Prosthesis(device=device), machine, WalkOptions(seconds=seconds)
    )
    env = AnkleWalkEnv(device=device, action="residual", walkers=["machine-1"], duration=seconds)
    _, infos = run_episode(env)
    every = round(0.01 / 1e-3)
    np.testing.assert_array_equal(infos["hip_x_m"][:-1], recording["hip_x"][every::every])
    np.testing.assert_array_equal(infos["pressure_command_bar"], recording["pressure_command"][every - 1 :: every])


def test_a_pressure_action_is_a_constant_pressure() -> None:
    direct = AnkleWalkEnv(duration=1.0)
    residual = AnkleWalkEnv(action="residual", base="constant:2.0", duration=1.0)
    observations = [run_episode(env, action)[0] for env, action in ((direct, 2.0 * 2.0 / 5.0 - 1.0), (residual, 0.0))]
    np.testing.assert_allclose(*observations, atol=1e-6)


def test_residual_changes_the_pressure_of_the_base_within_the_supply() -> None:
    for base, action, expected in (("constant:2", -1.0, 1.5), ("constant:2", 0.5, 2.25), ("constant:4.9", 1.0, 5.0)):
        env = AnkleWalkEnv(action="residual", base=base, residual_bar=0.5)
        env.reset(seed=0)
        assert env.step(np.full(1, action))[4]["pressure_command_bar"] == pytest.approx(expected)


def test_profile_follows_the_estimated_phase() -> None:
    env = AnkleWalkEnv(action="residual", base="profile")
    observation, _ = env.reset(seed=0)
    profile = parse_controller("profile")
    for _ in range(60):
        phase = np.arctan2(observation[6], observation[7]) / (2.0 * np.pi) % 1.0
        expected = profile.pressure_at(float(phase)) / BAR  # type: ignore[union-attr]
        observation, *_, info = env.step(ZERO)
        assert info["pressure_command_bar"] == pytest.approx(expected, abs=1e-4)


def test_a_fall_ends_the_episode_and_costs_ten() -> None:
    env = AnkleWalkEnv(walkers=["machine-1"])
    observations, infos = run_episode(env, action=1.0)
    assert infos["terminated"][-1]
    assert not infos["terminated"][:-1].any()
    assert len(infos["reward"]) < 1500
    assert infos["hip_height_m"][-1] < 0.65 or abs(infos["trunk_lean_rad"][-1]) > 1.0
    assert infos["reward"][-1] == infos["reward_fall"][-1] == -10.0
    assert (infos["reward_fall"][:-1] == 0.0).all()
    assert np.isfinite(observations).all()


def test_standing_counts_as_a_fall() -> None:
    """A person who has come less than a metre in two seconds stands."""
    env = AnkleWalkEnv(action="residual")
    run_episode(env, n_steps=100)
    env._person._positions.extend([env.data.qpos[0] - 0.9] * 200)
    _, reward, terminated, _, info = env.step(ZERO)
    assert (reward, terminated) == (-10.0, True)
    assert info["hip_height_m"] > 0.8


def test_a_state_that_is_not_finite_ends_the_episode() -> None:
    env = AnkleWalkEnv()
    env.reset(seed=0)
    env.step(ZERO)
    env.data.act[:] = np.nan
    observation, reward, terminated, truncated, _ = env.step(ZERO)
    assert (reward, terminated, truncated) == (-10.0, True, False)
    assert np.isfinite(observation).all()


def test_reward_is_the_sum_of_its_terms_and_tells_what_the_outcomes_tell() -> None:
    env = AnkleWalkEnv(action="residual", walkers=["machine-1"], duration=12.0)
    _, infos = run_episode(env)
    np.testing.assert_allclose(infos["reward"], sum(infos[name] for name in REWARD_TERMS), atol=1e-12)
    recording = simulate_walk(
        load_walker("machine-1"),
        Prosthesis(device=DEVICE),
        parse_controller("machine"),
        WalkOptions(seconds=12.0),
    )
    outcomes = compute_outcomes(recording)
    late = slice(300, None)
    speed = float(infos["speed_m_per_s"][late].mean())
    cost = float(infos["metabolic_cost_j_per_kg_m"][late].mean()) * 1.25 / speed
    laws = outcomes.cost_minetti_j_per_kg_m, outcomes.cost_bhargava_j_per_kg_m
    assert speed == pytest.approx(outcomes.speed_m_per_s, rel=0.005)
    assert cost == pytest.approx(0.5 * sum(law for law in laws if law is not None), rel=0.01)
    assert float(infos["step_asymmetry"][late].mean()) == pytest.approx(outcomes.step_asymmetry, abs=0.02)
    assert float(infos["load_left_bw"][late].mean() + infos["load_right_bw"][late].mean()) == pytest.approx(
        1.0, abs=0.02
    )
    np.testing.assert_allclose(infos["reward_effort"], -0.1 * infos["metabolic_cost_j_per_kg_m"])
    np.testing.assert_allclose(
        infos["reward_speed"], -3.0 * np.minimum(np.abs(infos["speed_m_per_s"] - 1.25), 0.4) ** 2, atol=1e-12
    )
    np.testing.assert_allclose(
        infos["reward_symmetry"], -3.0 * np.minimum(np.abs(infos["step_asymmetry"]), 0.3) ** 2, atol=1e-12
    )


def test_weights_of_the_reward_can_be_replaced() -> None:
    plain, changed = (
        run_episode(AnkleWalkEnv(action="residual", duration=0.5, reward=reward))[1]
        for reward in (None, {"effort": -0.2, "survival": 0.0})
    )
    np.testing.assert_allclose(changed["reward_effort"], 2.0 * plain["reward_effort"])
    assert (changed["reward_survival"] == 0.0).all()
    np.testing.assert_array_equal(changed["reward_speed"], plain["reward_speed"])


def test_info_holds_what_a_prosthesis_does_not_sense() -> None:
    env = AnkleWalkEnv(duration=0.5)
    _, infos = run_episode(env)
    assert set(WholeBodyState._fields) < set(infos)
    q = env.data.qpos
    assert infos["hip_height_m"][-1] == q[1]
    assert [infos[f"{name}_rad"][-1] for name in ("hip_left", "knee_left", "ankle_left")] == q[3:6].tolist()


def test_walkers_gains_and_ground_follow_from_the_seed() -> None:
    options = {"gain_noise": 0.03, "unevenness": 0.01, "action": "residual", "duration": 1.5}
    env, again = AnkleWalkEnv(**options), AnkleWalkEnv(**options)
    infos = [env.reset(seed=seed)[1] for seed in range(6)]
    assert len({info["ground_seed"] for info in infos}) > 3
    first, second = run_episode(env, seed=3)[0], run_episode(again, seed=3)[0]
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, run_episode(env, seed=4)[0])


def test_walkers_are_those_that_have_adapted_to_the_device_with_the_machine() -> None:
    env = AnkleWalkEnv(duration=1.0)
    for walker in env._task.walkers:
        assert walker.condition["prosthesis"] == "device"
        assert '"kind": "machine"' in walker.condition["controller"]
    indices = {env.reset(seed=seed)[1]["walker_index"] for seed in range(40)}
    assert 1 < len(indices) <= len(env._task.walkers)
    assert max(indices) < len(env._task.walkers)


def test_batch_on_uneven_ground_equals_single_environments() -> None:
    options = {"unevenness": 0.02, "duration": 2.0, "action": "residual"}
    envs = gymnasium.make_vec(NAME, 2, "vector_entry_point", n_jobs=2, **options)
    singles = [AnkleWalkEnv(**options) for _ in range(2)]
    observations, infos = envs.reset(seed=3)
    for i, env in enumerate(singles):
        observation, info = env.reset(seed=3 + i)
        np.testing.assert_array_equal(observation, observations[i])
        assert info["ground_seed"] == infos["ground_seed"][i]
    for _ in range(170):
        observations, *_ = envs.step(np.zeros((2, 1), dtype=np.float32))
        expected = [env.step(ZERO)[0] for env in singles]
        np.testing.assert_array_equal(observations, expected)
    envs.close()


def test_blocks_lift_the_feet() -> None:
    level, uneven = (
        run_episode(AnkleWalkEnv(action="residual", walkers=["machine-1"], unevenness=height, duration=4.0))[1]
        for height in (0.0, 0.02)
    )
    begin = np.flatnonzero(uneven["hip_x_m"] > 1.5)[0] - 40  # the foot is ahead of the hip
    np.testing.assert_array_equal(level["hip_x_m"][:begin], uneven["hip_x_m"][:begin])
    assert uneven["hip_height_m"][-100:].max() > level["hip_height_m"][-100:].max() + 0.002


def test_noise_and_delay_reach_the_observations() -> None:
    ideal, noisy, late = (
        run_episode(AnkleWalkEnv(duration=3.0, **options), action=-0.2)[0]
        for options in ({}, {"sensor_noise": 2.0}, {"sensor_delay": 3})
    )
    noise = (noisy - ideal)[:, :N_MEASURED]
    assert noise.std(axis=0) == pytest.approx(2.0 * NOISE_DEVIATION, rel=0.2)
    np.testing.assert_array_equal(noisy[:, N_MEASURED:], ideal[:, N_MEASURED:])
    np.testing.assert_array_equal(late[3:], ideal[:-3])


def test_base_controller_sees_late_sensors() -> None:
    changes = []
    for delay in (0, 2):
        env = AnkleWalkEnv(action="residual", walkers=["machine-1"], sensor_delay=delay, duration=1.0)
        command = run_episode(env)[1]["pressure_command_bar"]
        changes.append(np.flatnonzero(np.abs(np.diff(command)) > 0.5)[0])
    assert changes[1] - changes[0] in (2, 3)


def test_a_spring_foot_ignores_actions() -> None:
    env = AnkleWalkEnv(spring_foot=8.0, duration=2.0)
    runs = [run_episode(env, action)[0] for action in (-1.0, 1.0)]
    np.testing.assert_array_equal(*runs)
    assert {walker.condition["prosthesis"] for walker in env._task.walkers} == {"spring-foot"}


def test_a_controller_of_a_user_keeps_its_state() -> None:
    machine = parse_controller("machine")
    before = copy.deepcopy(machine)
    run_episode(AnkleWalkEnv(action="residual", base=machine, duration=0.5))
    assert machine == before


def test_backends_walk_alike_to_the_bit() -> None:
    observations = [
        run_episode(AnkleWalkEnv(action="residual", duration=0.2, backend=backend))[0]
        for backend in ("compiled", "python")
    ]
    np.testing.assert_array_equal(*observations)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"action": "valve"}, "action is 'valve'; allowed: pressure, residual"),
        ({"device": make_opening_device()}, "commands pressures, but the commands of"),
        ({"residual_bar": 0.0}, "residual_bar is 0"),
        ({"walkers": []}, "walkers is empty"),
        ({"walkers": "machine-1"}, "walkers is empty or one name"),
        ({"walkers": ["machine-99"]}, "there is no walker 'machine-99'"),
        ({"walkers": ["intact-1"]}, "walker intact-1 walks with two legs of flesh"),
        ({"gain_noise": -0.1}, "gain_noise is -0.1; allowed: 0 to 0.2"),
        ({"unevenness": 0.2}, "unevenness is 0.2; allowed: 0 to 0.05 m"),
        ({"speed": 0.0}, "speed is 0; allowed: 0.4 to 2.5"),
        ({"duration": np.nan}, "duration is nan"),
        ({"time_step": 2e-3}, "time_step is 2 ms"),
        ({"time_step": 3e-4}, "divisors of 10 ms up to 1 ms"),
        ({"sensor_delay": 21}, "sensor_delay is 21"),
        ({"reward": {"joy": 1.0}}, "reward has no term 'joy'; allowed: survival, effort"),
        ({"render_mode": "ansi"}, "render_mode is 'ansi'; allowed: None, human, rgb_array"),
        ({"width": 0}, "image size is 0 x 480"),
    ],
)
def test_invalid_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        AnkleWalkEnv(**options)  # type: ignore[arg-type]


def test_a_base_with_another_interval_is_refused() -> None:
    machine = parse_controller("machine")
    machine.interval = 0.02  # type: ignore[union-attr]
    with pytest.raises(InputError, match="base controller commands every 20 ms; allowed: 10 ms"):
        AnkleWalkEnv(base=machine)
