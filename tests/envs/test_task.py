"""What the environment judges by, checked against MuJoCo's own book-keeping and against a first episode."""

import gymnasium
import mujoco
import numpy as np
import pytest

from klute_sim.device.device import load_device, parse_device
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.errors import InputError
from klute_sim.gait.rig.setup import MAX_PATH_DEVIATION, reset_gait_rig
from klute_sim.laws import mckibben, pneumatics


def fresh(**options: object) -> AnkleGaitEnv:
    env = AnkleGaitEnv(**options)
    env.reset(seed=0)
    return env


def act(value: float) -> np.ndarray:
    return np.array([value], dtype=np.float32)


def limit_moment(env: AnkleGaitEnv, dof: int, joint: int) -> float:
    """Moment of the ankle's end stop [N.m], from MuJoCo's constraints."""
    d = env.data
    force = np.where((d.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT) & (d.efc_id == joint), d.efc_force, 0.0)
    out = np.zeros(env.model.nv)
    mujoco.mj_mulJacTVec(env.model, d, out, force)
    return float(out[dof])


@pytest.mark.parametrize("side", ["dorsiflexion", "plantarflexion"])
def test_the_net_moment_holds_the_end_stop_with_its_sign(side: str) -> None:
    env = fresh()
    ankle = env.model.joint("prosthesis_ankle")
    at, dof = ankle.qposadr[0], ankle.dofadr[0]
    env.data.qpos[1] += 0.3  # off the floor
    sign = -1.0 if side == "dorsiflexion" else 1.0
    env.data.qpos[at], env.data.qvel[dof] = sign * (ankle.range[1] + 0.05), 60.0 * sign
    mujoco.mj_forward(env.model, env.data)
    stop = limit_moment(env, dof, ankle.id)
    assert -sign * stop > 10.0
    wanted = env.data.qfrc_actuator[dof] + env.data.qfrc_passive[dof] + stop
    assert env._task._net_moment(env._read_states())[0] == pytest.approx(wanted, rel=1e-9)


def air_now(env: AnkleGaitEnv) -> float:
    """Air in the muscles [kg]."""
    p = env._gait_rig.actuator.parameters
    state = env._gait_rig.actuator.get_state(env.data)
    return pneumatics.air_mass(state.pressure, mckibben.volume(p.muscle, state.length), p.supply.temperature)


def test_filling_draws_air_and_venting_draws_none() -> None:
    env = fresh()
    for _ in range(4):
        before = air_now(env)
        info = env.step(act(1.0))[4]
        drawn = 1e3 * (air_now(env) - before)
        assert drawn > 0.01
        assert info["air_g"] == pytest.approx(drawn)
        assert info["reward_air"] == pytest.approx(-0.1 * drawn * 10)
    for _ in range(3):
        before = air_now(env)
        info = env.step(act(-1.0))[4]
        assert air_now(env) < before
        assert info["air_g"] == info["reward_air"] == 0.0


def test_a_change_of_action_costs_from_the_first_step_on() -> None:
    env = fresh()
    begin = 2.0 * env.data.act[env._gait_rig.actuator.act_address] / 5.0 - 1.0
    assert env.data.ctrl[env._gait_rig.actuator.ctrl_address] == pytest.approx(
        env.data.act[env._gait_rig.actuator.act_address]
    )
    terms = [env.step(act(value))[4]["reward_smoothness"] for value in (0.5, 0.5, -0.5)]
    assert terms == pytest.approx([-0.05 * (0.5 - begin) ** 2, 0.0, -0.05], abs=1e-6)


def test_a_second_episode_is_like_a_first() -> None:
    random = np.random.default_rng(1)
    actions = random.uniform(-1, 1, (110, 1)).astype(np.float32)

    def episode(env: AnkleGaitEnv) -> list[tuple]:
        first = env.reset(seed=9)[0]
        return [(first, 0.0, {})] + [(o, r, i) for o, r, *_, i in (env.step(a) for a in actions)]

    used = fresh()
    for _ in range(163):
        used.step(act(0.7))
    for (a, x, i), (b, y, j) in zip(episode(fresh()), episode(used), strict=True):
        assert np.array_equal(a, b)
        assert x == y
        assert i == j


@pytest.mark.parametrize("offset", [0.1, -0.1])
def test_an_ankle_offset_is_dorsiflexion_where_positive(offset: float) -> None:
    env = fresh()
    angles = []
    for each in (0.0, offset):
        reset_gait_rig(env._gait_rig, env.data, 1e5, each)
        angles.append(float(-env.data.qpos[env.model.joint("prosthesis_ankle").qposadr[0]]))
    assert angles[1] - angles[0] == pytest.approx(offset, abs=1e-6)


def test_the_path_that_must_not_be_left_is_the_one_of_now() -> None:
    env = fresh()
    rig, count = env._gait_rig, env._gait_rig.commands_per_stride
    highest, lowest = int(rig.carriage_height.argmax()), int(rig.carriage_height.argmin())
    rise = rig.carriage_height[highest] - rig.carriage_height[lowest]
    assert rise > 0.02
    above = rig.carriage_height[lowest] + MAX_PATH_DEVIATION + 0.5 * rise
    commands, walks = np.array([lowest, highest, lowest + count, highest + 3 * count]), env._task._stride_tables
    first = np.zeros(4, dtype=np.int64)
    assert walks.is_off_path(np.full(4, above), first, commands).tolist() == [True, False, True, False]
    assert walks.is_off_path(np.array([np.nan]), first[:1], commands[:1]).tolist() == [True]


def test_the_reference_power_of_a_slower_walker_is_slower() -> None:
    peaks = []
    for speed in (0.9, None):
        env = fresh(speed=speed)
        reference = env._gait_rig.options.reference
        slower = reference.stride_time / env._gait_rig.trajectory.stride_time
        peaks.append(env._task._stride_tables.reference_ankle[0, :, 2].max())
        assert peaks[-1] == pytest.approx(slower * reference("ankle_power_w_per_kg", env._gait_rig.phase).max())
    assert peaks[0] < 0.85 * peaks[1]


@pytest.mark.parametrize(("most", "error"), [(-0.4, 12.0), (1.0, 50.0)])
def test_the_phase_estimate_stays_one_under_any_policy(most: float, error: float) -> None:
    env = fresh(reset_noise=0.0)
    usual, random = env._gait_rig.trajectory.stride_time, np.random.default_rng(3)
    errors = []
    for _ in range(550):
        observed, _, terminated, _, info = env.step(random.uniform(-1, most, 1).astype(np.float32))
        assert not terminated
        assert 0.6 * usual <= env._task._sensors._stride_time[0] <= 1.6 * usual
        estimate = np.arctan2(observed[6], observed[7]) / (2 * np.pi) * 100
        errors.append((estimate - info["gait_pct"] + 50) % 100 - 50)
        assert np.hypot(observed[6], observed[7]) == pytest.approx(1.0, abs=1e-6)
    # Jerked through the whole range of pressure, the foot stubs in swing, and no load cell can tell.
    assert np.abs(errors[115:]).max() <= error


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"reset_noise": -0.1}, "reset_noise is -0.1; allowed: 0 to 0.3 rad"),
        ({"reset_noise": np.nan}, "reset_noise is nan"),
        ({"reset_noise": 0.31}, "reset_noise is 0.31"),
        ({"width": 0}, "pictures are 0 x 480"),
        ({"height": 5000}, "pictures are 480 x 5000; allowed: 1 to 4096"),
        ({"strides": 2.5}, "strides is 2.5; allowed: a whole number"),
        ({"strides": 0}, "strides is 0; allowed: 1 to 200"),
    ],
)
def test_options_that_cannot_be_are_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        AnkleGaitEnv(**options)


def test_a_dead_time_delays_the_command_by_steps() -> None:
    text = load_device("klute-1-1-4-pair").content + b"\n[effects.pressure_delay]\ndelay_s = 0.0125\n"
    late, prompt = fresh(device=parse_device(text, "late"), strides=1), fresh(strides=1)
    reached = []
    for env in (late, prompt):
        for value in (-0.6, -0.6, 0.5):
            env.step(act(value))
        reached.append(env.data.act[env._gait_rig.actuator.act_address])
    # 50 bar/s: the prompt one rises by half a bar in the interval, the late one has not been told yet.
    assert reached[0] == pytest.approx(1.0, abs=1e-6)
    assert reached[1] == pytest.approx(1.5, abs=1e-6)
    assert [steps for steps, _ in late._task.schedule_commands(np.array([3.0]), late._single_mask)] == [5, 15]
    assert [steps for steps, _ in prompt._task.schedule_commands(np.array([3.0]), prompt._single_mask)] == [20]


def test_with_a_dead_time_the_batch_is_still_the_single_environment() -> None:
    device = parse_device(
        load_device("klute-1-1-4-pair").content + b"\n[effects.pressure_delay]\ndelay_s = 0.027\n", "late"
    )
    single = fresh(device=device, strides=1)
    batch = gymnasium.make_vec("klute_sim/AnkleGait-v1", 2, "vector_entry_point", device=device, strides=1)
    single.reset(seed=4)
    batch.reset(seed=[4, 5])
    for k in range(60):
        value = np.sin(k / 5)
        one, many = single.step(act(value))[0], batch.step(np.full((2, 1), value, dtype=np.float32))[0]
        assert np.array_equal(one, many[0])
    seen = single.data.act[single._gait_rig.actuator.act_address]
    plain = fresh(strides=1)
    plain.reset(seed=4)
    for k in range(60):
        plain.step(act(np.sin(k / 5)))
    assert seen != pytest.approx(plain.data.act[plain._gait_rig.actuator.act_address], abs=1e-3)
