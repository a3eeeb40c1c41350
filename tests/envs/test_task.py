"""Tests of the gait task against MuJoCo's constraint forces and against a first episode."""

import gymnasium
import mujoco
import numpy as np
import pytest

from klute_sim.device.device import load_device, parse_device
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.base.single import SINGLE_MASK
from klute_sim.errors import InputError
from klute_sim.gait.rig.setup import MAX_PATH_DEVIATION, reset_gait_rig
from klute_sim.laws import mckibben, pneumatics


def make_env(**options: object) -> AnkleGaitEnv:
    env = AnkleGaitEnv(**options)
    env.reset(seed=0)
    return env


def make_action(value: float) -> np.ndarray:
    return np.array([value], dtype=np.float32)


def limit_moment(env: AnkleGaitEnv, dof: int, joint: int) -> float:
    """Return the moment of the ankle's end stop [N*m] from MuJoCo's constraints."""
    d = env.data
    force = np.where((d.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT) & (d.efc_id == joint), d.efc_force, 0.0)
    out = np.zeros(env.model.nv)
    mujoco.mj_mulJacTVec(env.model, d, out, force)
    return float(out[dof])


@pytest.mark.parametrize("side", ["dorsiflexion", "plantarflexion"])
def test_net_moment_includes_end_stop(side: str) -> None:
    env = make_env()
    ankle = env.model.joint("prosthesis_ankle")
    angle_index, dof = ankle.qposadr[0], ankle.dofadr[0]
    env.data.qpos[1] += 0.3  # off the floor
    sign = -1.0 if side == "dorsiflexion" else 1.0
    # At 100 rad/s the return spring and the damping alone brake the foot too little.
    env.data.qpos[angle_index], env.data.qvel[dof] = sign * (ankle.range[1] + 0.05), 100.0 * sign
    mujoco.mj_forward(env.model, env.data)
    stop = limit_moment(env, dof, ankle.id)
    assert -sign * stop > 10.0
    expected = env.data.qfrc_actuator[dof] + env.data.qfrc_passive[dof] + stop
    assert env._task._net_moment(env._read_states())[0] == pytest.approx(expected, rel=1e-9)


def compute_air_mass(env: AnkleGaitEnv) -> float:
    """Return the air mass in the muscles [kg]."""
    p = env._gait_rig.actuator.parameters
    state = env._gait_rig.actuator.get_state(env.data)
    volume = mckibben.gas_volume(p.muscle, state.length) + p.supply.dead_volume
    return pneumatics.air_mass(state.pressure, volume, p.supply.temperature)


def test_filling_draws_air_and_venting_draws_none() -> None:
    env = make_env()
    for _ in range(4):
        before = compute_air_mass(env)
        info = env.step(make_action(1.0))[4]
        air_drawn = 1e3 * (compute_air_mass(env) - before)
        assert air_drawn > 0.01
        assert info["air_g"] == pytest.approx(air_drawn)
        assert info["reward_air"] == pytest.approx(-0.1 * air_drawn * 10)
    for _ in range(3):
        before = compute_air_mass(env)
        info = env.step(make_action(-1.0))[4]
        assert compute_air_mass(env) < before
        assert info["air_g"] == info["reward_air"] == 0.0


def test_action_change_is_penalized_from_first_step() -> None:
    env = make_env()
    initial_action = 2.0 * env.data.act[env._gait_rig.actuator.act_address] / 5.0 - 1.0
    assert env.data.ctrl[env._gait_rig.actuator.ctrl_address] == pytest.approx(
        env.data.act[env._gait_rig.actuator.act_address]
    )
    terms = [env.step(make_action(value))[4]["reward_smoothness"] for value in (0.5, 0.5, -0.5)]
    assert terms == pytest.approx([-0.05 * (0.5 - initial_action) ** 2, 0.0, -0.05], abs=1e-6)


def test_second_episode_equals_first() -> None:
    rng = np.random.default_rng(1)
    actions = rng.uniform(-1, 1, (110, 1)).astype(np.float32)

    def episode(env: AnkleGaitEnv) -> list[tuple]:
        first = env.reset(seed=9)[0]
        return [(first, 0.0, {})] + [(o, r, i) for o, r, *_, i in (env.step(a) for a in actions)]

    used_env = make_env()
    for _ in range(163):
        used_env.step(make_action(0.7))
    for (a, x, i), (b, y, j) in zip(episode(make_env()), episode(used_env), strict=True):
        assert np.array_equal(a, b)
        assert x == y
        assert i == j


@pytest.mark.parametrize("offset", [0.1, -0.1])
def test_positive_ankle_offset_is_dorsiflexion(offset: float) -> None:
    env = make_env()
    angles = []
    for reset_offset in (0.0, offset):
        reset_gait_rig(env._gait_rig, env.data, 1e5, reset_offset)
        angles.append(float(-env.data.qpos[env.model.joint("prosthesis_ankle").qposadr[0]]))
    assert angles[1] - angles[0] == pytest.approx(offset, abs=1e-6)


def test_path_deviation_uses_current_command() -> None:
    env = make_env()
    rig, count = env._gait_rig, env._gait_rig.commands_per_stride
    highest_index, lowest_index = int(rig.carriage_height.argmax()), int(rig.carriage_height.argmin())
    rise = rig.carriage_height[highest_index] - rig.carriage_height[lowest_index]
    assert rise > 0.02
    above = rig.carriage_height[lowest_index] + MAX_PATH_DEVIATION + 0.5 * rise
    commands, tables = (
        np.array([lowest_index, highest_index, lowest_index + count, highest_index + 3 * count]),
        env._task._stride_tables,
    )
    first = np.zeros(4, dtype=np.int64)
    assert tables.is_off_path(np.full(4, above), first, commands).tolist() == [True, False, True, False]
    assert tables.is_off_path(np.array([np.nan]), first[:1], commands[:1]).tolist() == [True]


@pytest.mark.slow
def test_reference_power_scales_with_stride_time() -> None:
    peaks = []
    for speed in (0.9, None):
        env = make_env(speed=speed)
        reference = env._gait_rig.options.reference
        slower = reference.stride_time / env._gait_rig.trajectory.stride_time
        peaks.append(env._task._stride_tables.reference_ankle[0, :, 2].max())
        assert peaks[-1] == pytest.approx(slower * reference("ankle_power_w_per_kg", env._gait_rig.phase).max())
    assert peaks[0] < 0.85 * peaks[1]


@pytest.mark.parametrize(("max_action", "error"), [(-0.4, 12.0), (1.0, 50.0)])
def test_phase_estimate_is_bounded_under_any_policy(max_action: float, error: float) -> None:
    env = make_env(reset_noise=0.0)
    nominal_stride_time, rng = env._gait_rig.trajectory.stride_time, np.random.default_rng(3)
    errors = []
    for _ in range(550):
        observed, _, terminated, _, info = env.step(rng.uniform(-1, max_action, 1).astype(np.float32))
        assert not terminated
        assert 0.6 * nominal_stride_time <= env._task._sensors._stride_time[0] <= 1.6 * nominal_stride_time
        estimate = np.arctan2(observed[6], observed[7]) / (2 * np.pi) * 100
        errors.append((estimate - info["gait_pct"] + 50) % 100 - 50)
        assert np.hypot(observed[6], observed[7]) == pytest.approx(1.0, abs=1e-6)
    # Random pressure over the full range makes the foot stub in swing, which the load cell cannot distinguish.
    assert np.abs(errors[115:]).max() <= error


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"reset_noise": -0.1}, "reset_noise is -0.1; allowed: 0 to 0.3 rad"),
        ({"reset_noise": np.nan}, "reset_noise is nan"),
        ({"reset_noise": 0.31}, "reset_noise is 0.31"),
        ({"width": 0}, "the image size is 0 x 480"),
        ({"height": 5000}, "the image size is 480 x 5000; allowed: 1 to 4096"),
        ({"strides": 2.5}, "strides is 2.5; allowed: a whole number"),
        ({"strides": 0}, "strides is 0; allowed: 1 to 200"),
    ],
)
def test_invalid_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        AnkleGaitEnv(**options)


def test_dead_time_delays_command_by_steps() -> None:
    text = load_device("klute-1-1-4-pair").content + b"\n[effects.pressure_delay]\ndelay_s = 0.0125\n"
    delayed_env, prompt_env = make_env(device=parse_device(text, "late"), strides=1), make_env(strides=1)
    reached = []
    for env in (delayed_env, prompt_env):
        for value in (-0.6, -0.6, 0.5):
            env.step(make_action(value))
        reached.append(env.data.act[env._gait_rig.actuator.act_address])
    # At 50 bar/s the prompt device rises by 0.5 bar in the interval; the delayed one has not received the command.
    assert reached[0] == pytest.approx(1.0, abs=1e-6)
    assert reached[1] == pytest.approx(1.5, abs=1e-6)
    assert [steps for steps, _ in delayed_env._task.schedule_commands(np.array([3.0]), SINGLE_MASK)] == [
        5,
        15,
    ]
    assert [steps for steps, _ in prompt_env._task.schedule_commands(np.array([3.0]), SINGLE_MASK)] == [20]


def test_batch_equals_single_environment_with_dead_time() -> None:
    device = parse_device(
        load_device("klute-1-1-4-pair").content + b"\n[effects.pressure_delay]\ndelay_s = 0.027\n", "late"
    )
    single = make_env(device=device, strides=1)
    batch = gymnasium.make_vec("klute_sim/AnkleGait-v2", 2, "vector_entry_point", device=device, strides=1)
    single.reset(seed=4)
    batch.reset(seed=[4, 5])
    for k in range(60):
        value = np.sin(k / 5)
        single_observation, batch_observations = (
            single.step(make_action(value))[0],
            batch.step(np.full((2, 1), value, dtype=np.float32))[0],
        )
        assert np.array_equal(single_observation, batch_observations[0])
    delayed_pressure = single.data.act[single._gait_rig.actuator.act_address]
    undelayed_env = make_env(strides=1)
    undelayed_env.reset(seed=4)
    for k in range(60):
        undelayed_env.step(make_action(np.sin(k / 5)))
    assert delayed_pressure != pytest.approx(
        undelayed_env.data.act[undelayed_env._gait_rig.actuator.act_address], abs=1e-3
    )
