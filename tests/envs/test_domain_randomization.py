"""Episodes that differ: what was drawn is what is walked, and the batch draws what single environments draw."""

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from klute_sim.device.backend.packing import unpack_parameters
from klute_sim.device.device import load_device, parse_device
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.tasks.domain_randomization import GRID_SIZE, RandomisationRanges
from klute_sim.errors import InputError

NAME = "klute_sim/AnkleGait-v1"
EVERYTHING = {
    "mass_share": 0.2,
    "speed_m_per_s": (1.0, 1.4),
    "slope_deg": (-5.0, 5.0),
    "device": {"muscle.c10_kpa": 0.1, "tendon.stiffness_1_n_per_mm": 0.2, "supply.pressure_bar": 0.1},
    "effects": {
        "pressure_lag": {"time_constant_s": (0.0, 0.05)},
        "tendon_hysteresis": {"form": "maxwell", "stiffness_n_per_mm": (5.0, 20.0), "time_constant_s": (0.1, 0.3)},
        "pressure_delay": {"delay_s": (0.0, 0.03)},
    },
}
ALL = {
    "mass_kg",
    "speed_m_per_s",
    "slope_deg",
    "muscle.c10_kpa",
    "tendon.stiffness_1_n_per_mm",
    "supply.pressure_bar",
    "effects.pressure_lag.time_constant_s",
    "effects.tendon_hysteresis.stiffness_n_per_mm",
    "effects.tendon_hysteresis.time_constant_s",
    "effects.pressure_delay.delay_s",
}


def same(a: object, b: object) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, np.ndarray) and a.dtype == object:
        return all(same(x, y) for x, y in zip(a, b, strict=True))
    return a is b if a is None else np.array_equal(a, b)


def test_what_was_drawn_is_told_and_walked() -> None:
    env = AnkleGaitEnv(randomise=EVERYTHING, strides=1)
    masses, lags = set(), []
    for seed in range(12):
        info = env.reset(seed=seed)[1]
        assert set(info) == ALL
        masses.add(info["mass_kg"])
        lags.append(info["effects.pressure_lag.time_constant_s"])
        assert float(env.model.body_mass.sum()) == pytest.approx(info["mass_kg"])
        lean = np.arctan2(-env.model.opt.gravity[0], -env.model.opt.gravity[2])
        assert np.degrees(lean) == pytest.approx(info["slope_deg"], abs=1e-9)
        parameters = unpack_parameters(env.model.actuator_user[env._gait_rig.actuator.id].tolist())
        assert parameters.muscle.c10 == pytest.approx(1e3 * info["muscle.c10_kpa"])
        assert parameters.supply.max_pressure == pytest.approx(1e5 * info["supply.pressure_bar"])
        assert env._gait_rig.trajectory.speed == pytest.approx(info["speed_m_per_s"], rel=0.01)
        assert env._gait_rig.options.mass == info["mass_kg"]
        assert 106.57 < info["muscle.c10_kpa"] / 118.4 * 118.4 < 130.25
    assert len(masses) > 4
    assert all(60.0 <= mass <= 90.0 for mass in masses)
    assert len(np.unique(lags)) == 12
    assert max(lags) <= 0.05


def test_a_drawn_walk_is_that_of_a_rig_made_for_it() -> None:
    drawn = AnkleGaitEnv(randomise={"mass_share": 0.2, "speed_m_per_s": (1.1, 1.3), "slope_deg": (-4.0, 4.0)})
    info = drawn.reset(seed=4)[1]
    made = AnkleGaitEnv(mass=info["mass_kg"], speed=info["speed_m_per_s"], slope=np.radians(info["slope_deg"]))
    made.reset(seed=4)
    mujoco.mj_copyState(made.model, drawn.data, made.data, int(mujoco.mjtState.mjSTATE_INTEGRATION))
    made.data.ctrl[:] = drawn.data.ctrl
    mujoco.mj_forward(made.model, made.data)
    made._task.reset(made._single_mask, made._read_states(), [made.np_random])
    for k in range(150):
        one, other = (env.step(np.full(1, 0.5 * np.sin(k / 8) - 0.5)) for env in (drawn, made))
        assert one[0] == pytest.approx(other[0], abs=1e-4)
        assert one[1] == pytest.approx(other[1], abs=1e-4)


def test_a_drawn_device_is_that_device() -> None:
    text = load_device("klute-1-1-4-pair").content.decode()
    drawn = AnkleGaitEnv(randomise={"device": {"muscle.c10_kpa": 0.3}})
    c10 = drawn.reset(seed=4)[1]["muscle.c10_kpa"]
    made = AnkleGaitEnv(device=parse_device(text.replace("c10_kpa = 118.4", f"c10_kpa = {c10!r}").encode(), "made"))
    made.reset(seed=4)
    made.np_random.bit_generator.state = drawn.np_random.bit_generator.state
    usual = AnkleGaitEnv()
    usual.reset(seed=4)
    state = int(mujoco.mjtState.mjSTATE_INTEGRATION)
    for env in (made, usual):
        mujoco.mj_copyState(env.model, drawn.data, env.data, state)
        mujoco.mj_forward(env.model, env.data)
        env._task.reset(env._single_mask, env._read_states(), [env.np_random])
    apart = 0.0
    for k in range(100):
        action = np.full(1, 0.5 * np.sin(k / 8) - 0.5)
        one, other, third = (env.step(action) for env in (drawn, made, usual))
        assert one[0] == pytest.approx(other[0], abs=1e-5)
        assert one[4]["work_bladder_j"] == pytest.approx(other[4]["work_bladder_j"], abs=1e-9)
        apart = max(apart, abs(one[4]["work_bladder_j"] - third[4]["work_bladder_j"]))
    assert apart > 1e-3


@pytest.mark.parametrize("autoreset", list(AutoresetMode))
def test_the_batch_draws_and_walks_as_environments_in_turn_bit_for_bit(autoreset: AutoresetMode) -> None:
    asked = {"randomise": EVERYTHING, "sensor_noise": 1.0, "sensor_delay": 1, "action": "residual"}
    options = {"strides": 1, "step": 1e-3, **asked}
    turn = gymnasium.make_vec(NAME, 3, "sync", vector_kwargs={"autoreset_mode": autoreset}, **options)
    batch = gymnasium.make_vec(NAME, 3, "vector_entry_point", autoreset_mode=autoreset, threads=2, **options)
    first, second = turn.reset(seed=7), batch.reset(seed=7)
    assert same(first[0], second[0])
    assert same(first[1], second[1])
    assert len(np.unique(second[1]["muscle.c10_kpa"])) == 3
    random, ended = np.random.default_rng(0), 0
    for _ in range(150):
        actions = random.uniform(-1.2, 1.2, (3, 1)).astype(np.float32)
        first, second = turn.step(actions), batch.step(actions)
        for one, other in zip(first, second, strict=True):
            assert same(one, other)
        done = first[2] | first[3]
        ended += done.sum()
        if autoreset == AutoresetMode.DISABLED and done.any():
            one, other = (env.reset(options={"reset_mask": done}) for env in (turn, batch))
            assert same(one[0], other[0])
            assert same(one[1], other[1])
    assert ended == 3
    turn.close()
    batch.close()


def test_a_drawn_dead_time_is_by_how_much_commands_are_late() -> None:
    env = AnkleGaitEnv(randomise={"effects": {"pressure_delay": {"delay_s": (0.0, 0.03)}}})
    for seed in range(4):
        delay = env.reset(seed=seed)[1]["effects.pressure_delay.delay_s"]
        begin = env.data.act[env._gait_rig.actuator.act_address]
        for _ in range(4):
            env.step(np.ones(1))
        rise = 50.0 * (0.04 - round(delay / 5e-4) * 5e-4)  # the regulator gives 50 bar/s
        assert env.data.act[env._gait_rig.actuator.act_address] - begin == pytest.approx(rise, abs=1e-6)


def test_rigs_are_put_together_once() -> None:
    env = AnkleGaitEnv(randomise={"mass_share": 0.1}, strides=1)
    for seed in range(60):
        env.reset(seed=seed)
    assert len(env._task.randomiser.gait_rigs) == GRID_SIZE + 1
    assert len({id(rig.model) for rig in env._task.randomiser.gait_rigs}) == 1


def test_a_device_drawn_for_an_episode_is_gone_in_the_next() -> None:
    env = AnkleGaitEnv(randomise=EVERYTHING, strides=1)
    random = np.random.default_rng(1)
    actions = random.uniform(-1, 1, (40, 1)).astype(np.float32)
    seen = []
    for seed in (3, 9, 3):
        env.reset(seed=seed)
        seen.append([env.step(action) for action in actions])
    for one, other in zip(seen[0], seen[2], strict=True):
        assert np.array_equal(one[0], other[0])
        assert one[1] == other[1]
        assert one[4] == other[4]
    assert not np.array_equal(seen[0][-1][0], seen[1][-1][0])


@pytest.mark.parametrize(
    ("randomise", "words"),
    [
        ({"weight": 0.1}, "randomise has no 'weight'; allowed: mass_share, speed_m_per_s, slope_deg, device, effects"),
        ({"mass_share": 0.6}, "randomise varies mass_share by a share of 0.6; allowed: 0 to 0.5"),
        ({"mass_share": np.nan}, "share of nan"),
        ({"speed_m_per_s": (1.4, 1.0)}, "from 1.4 to 1; allowed: a finite range that rises"),
        ({"speed_m_per_s": 1.0}, "from 1.0; allowed: two numbers"),
        ({"speed_m_per_s": (1.0, 5.0)}, "speed is 5; allowed: 0.4 to 2.5 m/s"),
        ({"slope_deg": (-20.0, 0.0)}, "slope is -20"),
        (
            {"device": {"muscle.c11_kpa": 0.1}},
            "cannot vary 'muscle.c11_kpa' of 'klute-1-1-4-pair'; allowed: muscle.res",
        ),
        ({"device": {"muscle.count": 0.1}}, "cannot vary 'muscle.count'"),
        ({"device": {"mounting.neutral_muscle_ratio": 0.1}}, "cannot vary 'mounting.neutral_muscle_ratio'"),
        ({"device": {"muscle.turns_per_m": 0.3}}, "the two must agree within 5 %"),
        ({"effects": {"gravity": {"g": (0.0, 1.0)}}}, "there is no effect 'gravity'"),
        ({"effects": {"pressure_lag": {"time_constant_s": (-1.0, 1.0)}}}, "time_constant_s = -1.0 is refused"),
        ({"effects": {"pressure_lag": {"lag": (0.0, 1.0)}}}, "unknown key 'lag'"),
    ],
)
def test_ranges_that_cannot_be_are_refused(randomise: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        AnkleGaitEnv(randomise=randomise)


def test_ranges_may_be_given_as_a_mapping_or_an_object() -> None:
    told = [AnkleGaitEnv(randomise=each).reset(seed=1)[1] for each in (EVERYTHING, RandomisationRanges(**EVERYTHING))]
    assert told[0] == told[1]
