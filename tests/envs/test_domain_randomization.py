"""Tests of the domain randomisation: sampled values are simulated, and the batch samples as single environments do."""

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from klute_sim.device.backend.packing import unpack_parameters
from klute_sim.device.device import load_device, parse_device
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.tasks import domain_randomization
from klute_sim.envs.tasks.device_ranges import DeviceRanges, build_parameter_ranges, sample_device
from klute_sim.envs.tasks.domain_randomization import GRID_SIZE, RandomizationRanges
from klute_sim.errors import InputError

NAME = "klute_sim/AnkleGait-v2"
ALL_RANGES = {
    "mass_fraction": 0.2,
    "speed_m_per_s": (1.0, 1.4),
    "slope_deg": (-5.0, 5.0),
    "device": {"muscle.c10_kpa": 0.1, "tendon.stiffness_1_n_per_mm": 0.2, "supply.pressure_bar": 0.1},
    "effects": {
        "pressure_lag": {"time_constant_s": (0.0, 0.05)},
        "tendon_hysteresis": {"form": "maxwell", "stiffness_n_per_mm": (5.0, 20.0), "time_constant_s": (0.1, 0.3)},
        "pressure_delay": {"delay_s": (0.0, 0.03)},
    },
}
ALL_KEYS = {
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


def are_equal(a: object, b: object) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(are_equal(a[k], b[k]) for k in a)
    if isinstance(a, np.ndarray) and a.dtype == object:
        return all(are_equal(x, y) for x, y in zip(a, b, strict=True))
    return a is b if a is None else np.array_equal(a, b)


@pytest.mark.slow
def test_sampled_values_are_reported_and_simulated() -> None:
    env = AnkleGaitEnv(domain_randomization=ALL_RANGES, strides=1, time_step=1e-3)
    masses, time_constants = set(), []
    for seed in range(12):
        info = env.reset(seed=seed)[1]
        assert set(info) == ALL_KEYS
        masses.add(info["mass_kg"])
        time_constants.append(info["effects.pressure_lag.time_constant_s"])
        assert float(env.model.body_mass.sum()) == pytest.approx(info["mass_kg"])
        lean = np.arctan2(-env.model.opt.gravity[0], -env.model.opt.gravity[2])
        assert np.degrees(lean) == pytest.approx(info["slope_deg"], abs=1e-9)
        parameters = unpack_parameters(env.model.actuator_user[env._gait_rig.actuator.id].tolist())
        assert parameters.muscle.c10 == pytest.approx(1e3 * info["muscle.c10_kpa"])
        assert parameters.supply.max_pressure == pytest.approx(1e5 * info["supply.pressure_bar"])
        assert env._gait_rig.trajectory.speed == pytest.approx(info["speed_m_per_s"], rel=0.01)
        assert env._gait_rig.options.mass == info["mass_kg"]
        assert 106.57 < info["muscle.c10_kpa"] / 118.4 * 118.4 < 130.25
    assert len(masses) > 2
    assert all(60.0 <= mass <= 90.0 for mass in masses)
    assert len(np.unique(time_constants)) == 12
    assert max(time_constants) <= 0.05


def test_sampled_subject_equals_fixed_subject() -> None:
    content = load_device("klute-1-1-4-pair").content.replace(b"[mounting]\n", b"[mounting]\nalignment_deg = -3.0\n")
    options = {"device": parse_device(content, "aligned"), "time_step": 1e-3}  # a prosthesis keeps its alignment
    ranges = {"mass_fraction": 0.2, "speed_m_per_s": (1.1, 1.3), "slope_deg": (-4.0, 4.0)}
    sampled_env = AnkleGaitEnv(domain_randomization=ranges, **options)
    info = sampled_env.reset(seed=4)[1]
    subject = {"mass": info["mass_kg"], "speed": info["speed_m_per_s"], "slope": np.radians(info["slope_deg"])}
    fixed_env = AnkleGaitEnv(**subject, **options)
    fixed_env.reset(seed=4)
    mujoco.mj_copyState(fixed_env.model, sampled_env.data, fixed_env.data, int(mujoco.mjtState.mjSTATE_INTEGRATION))
    fixed_env.data.ctrl[:] = sampled_env.data.ctrl
    mujoco.mj_forward(fixed_env.model, fixed_env.data)
    fixed_env._task.reset(np.ones(1, dtype=np.bool_), fixed_env._read_states(), [fixed_env.np_random])
    for k in range(150):
        first, second = (env.step(np.full(1, 0.5 * np.sin(k / 8) - 0.5)) for env in (sampled_env, fixed_env))
        assert first[0] == pytest.approx(second[0], abs=1e-4)
        assert first[1] == pytest.approx(second[1], abs=1e-4)


def test_sampled_device_equals_fixed_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sampled device walks on the path that the nominal device learned; here the fixed one does so, too."""
    text = load_device("klute-1-1-4-pair").content.decode()
    nominal_env = AnkleGaitEnv()
    nominal_options = nominal_env._gait_rig.options
    monkeypatch.setattr(domain_randomization, "prepare_options", lambda *_: nominal_options)
    sampled_env = AnkleGaitEnv(domain_randomization={"device": {"muscle.c10_kpa": 0.3}})
    c10 = sampled_env.reset(seed=4)[1]["muscle.c10_kpa"]
    fixed_env = AnkleGaitEnv(
        device=parse_device(text.replace("c10_kpa = 118.4", f"c10_kpa = {c10!r}").encode(), "made")
    )
    fixed_env.reset(seed=4)
    fixed_env.np_random.bit_generator.state = sampled_env.np_random.bit_generator.state
    nominal_env.reset(seed=4)
    state = int(mujoco.mjtState.mjSTATE_INTEGRATION)
    for env in (fixed_env, nominal_env):
        mujoco.mj_copyState(env.model, sampled_env.data, env.data, state)
        mujoco.mj_forward(env.model, env.data)
        env._task.reset(np.ones(1, dtype=np.bool_), env._read_states(), [env.np_random])
    max_difference = 0.0
    for k in range(100):
        action = np.full(1, 0.5 * np.sin(k / 8) - 0.5)
        first, second, nominal_step = (env.step(action) for env in (sampled_env, fixed_env, nominal_env))
        assert first[0] == pytest.approx(second[0], abs=1e-5)
        assert first[4]["work_bladder_j"] == pytest.approx(second[4]["work_bladder_j"], abs=1e-9)
        max_difference = max(max_difference, abs(first[4]["work_bladder_j"] - nominal_step[4]["work_bladder_j"]))
    assert max_difference > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("autoreset", AutoresetMode)
def test_batch_is_bit_identical_to_single_environments(autoreset: AutoresetMode) -> None:
    task_options = {"domain_randomization": ALL_RANGES, "sensor_noise": 1.0, "sensor_delay": 1, "action": "residual"}
    options = {"strides": 1, "time_step": 1e-3, **task_options}
    sync_envs = gymnasium.make_vec(NAME, 3, "sync", vector_kwargs={"autoreset_mode": autoreset}, **options)
    vector_env = gymnasium.make_vec(NAME, 3, "vector_entry_point", autoreset_mode=autoreset, n_jobs=2, **options)
    first, second = sync_envs.reset(seed=7), vector_env.reset(seed=7)
    assert are_equal(first[0], second[0])
    assert are_equal(first[1], second[1])
    assert len(np.unique(second[1]["muscle.c10_kpa"])) == 3
    rng, ended = np.random.default_rng(0), 0
    for _ in range(150):
        actions = rng.uniform(-1.2, 1.2, (3, 1)).astype(np.float32)
        first, second = sync_envs.step(actions), vector_env.step(actions)
        for single, batched in zip(first, second, strict=True):
            assert are_equal(single, batched)
        done = first[2] | first[3]
        ended += done.sum()
        if autoreset == AutoresetMode.DISABLED and done.any():
            first, second = (env.reset(options={"reset_mask": done}) for env in (sync_envs, vector_env))
            assert are_equal(first[0], second[0])
            assert are_equal(first[1], second[1])
    assert ended == 3
    sync_envs.close()
    vector_env.close()


def test_sampled_dead_time_delays_commands() -> None:
    env = AnkleGaitEnv(domain_randomization={"effects": {"pressure_delay": {"delay_s": (0.0, 0.03)}}})
    for seed in range(4):
        delay = env.reset(seed=seed)[1]["effects.pressure_delay.delay_s"]
        initial_pressure = env.data.act[env._gait_rig.actuator.act_address]
        for _ in range(4):
            env.step(np.ones(1))
        rise = 50.0 * (0.04 - round(delay / 5e-4) * 5e-4)  # the regulator gives 50 bar/s
        assert env.data.act[env._gait_rig.actuator.act_address] - initial_pressure == pytest.approx(rise, abs=1e-6)


def test_documented_number_of_grid_values_is_that_of_the_code() -> None:
    assert f"each have {GRID_SIZE} evenly spaced values" in (AnkleGaitEnv.__doc__ or "")


def test_rigs_are_built_once() -> None:
    env = AnkleGaitEnv(domain_randomization={"mass_fraction": 0.1}, strides=1, time_step=1e-3)
    for seed in range(60):
        env.reset(seed=seed)
    assert len(env._task.randomizer.gait_rigs) == GRID_SIZE + 1
    assert len({id(rig.model) for rig in env._task.randomizer.gait_rigs}) == 1


def test_sampled_device_is_reset_in_next_episode() -> None:
    env = AnkleGaitEnv(domain_randomization=ALL_RANGES, strides=1, time_step=1e-3)
    rng = np.random.default_rng(1)
    actions = rng.uniform(-1, 1, (40, 1)).astype(np.float32)
    episodes = []
    for seed in (3, 9, 3):
        env.reset(seed=seed)
        episodes.append([env.step(action) for action in actions])
    for first, second in zip(episodes[0], episodes[2], strict=True):
        assert np.array_equal(first[0], second[0])
        assert first[1] == second[1]
        assert first[4] == second[4]
    assert not np.array_equal(episodes[0][-1][0], episodes[1][-1][0])


@pytest.mark.parametrize(
    ("domain_randomization", "message"),
    [
        (
            {"weight": 0.1},
            "no 'weight'; allowed: device, effects, mass_fraction, speed_m_per_s, speed_fraction, slope_deg",
        ),
        ({"mass_fraction": 0.6}, "domain_randomization has mass_fraction = 0.6; allowed: a fraction from 0 to 0.5"),
        ({"mass_fraction": np.nan}, "mass_fraction = nan"),
        ({"speed_m_per_s": (1.4, 1.0)}, r"speed_m_per_s = \(1.4, 1\); allowed: two finite numbers, lower limit first"),
        (
            {"speed_m_per_s": (1.0, 1.4), "speed_fraction": (0.8, 1.25)},
            "speed_m_per_s and speed_fraction, which exclude each other",
        ),
        ({"mass_fraction": (0.1, 0.2)}, r"mass_fraction = \(0.1, 0.2\); allowed: a fraction"),
        ({"slope_deg": "12"}, "slope_deg = '12'; allowed: two numbers"),
        ({"device": {"muscle": {"c10_kpa": 0.1}}}, "the table 'muscle'; allowed: whole keys .* \"muscle.c10_kpa\""),
        ({"device": ["muscle.c10_kpa"]}, "device = .*; allowed: numbers of the device file with fractions"),
        ({"effects": {"pressure_lag": 0.1}}, "effects.pressure_lag = 0.1; allowed: ranges by parameter"),
        (3, "domain_randomization is 3; allowed: ranges by name, device, effects, mass_fraction"),
        ({"speed_m_per_s": 1.0}, "speed_m_per_s = 1.0; allowed: two numbers, lower limit first"),
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
def test_invalid_ranges_are_refused(domain_randomization: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        AnkleGaitEnv(domain_randomization=domain_randomization)  # type: ignore[arg-type]


def test_numbers_that_do_not_go_together_are_drawn_again() -> None:
    """Turns and bladder radius may each vary by 2 %, but not both in the direction of a bladder beyond the braid."""
    device = load_device("klute-1-1-4-pair")
    ranges = DeviceRanges(device={"muscle.turns_per_m": 0.02, "muscle.bladder_radius_mm": 0.02})
    ends = build_parameter_ranges(device, ranges)
    with pytest.raises(InputError, match="the two must agree"):
        device.with_changes({key: low for key, (low, _) in ends.items()}, "test")
    rng = np.random.default_rng(0)
    for _ in range(50):
        parameters, numbers = sample_device(device, ends, rng)
        assert all(low <= numbers[key] <= high for key, (low, high) in ends.items())
        assert parameters == device.with_changes(numbers, "test").parameters
    with pytest.raises(InputError, match=r"no valid device in 100 draws .*the two must agree"):
        sample_device(device, {"muscle.turns_per_m": (3.0, 3.1)}, rng)


def test_ranges_are_a_mapping_or_an_object() -> None:
    sampled_values = [
        AnkleGaitEnv(domain_randomization=ranges, time_step=1e-3).reset(seed=1)[1]
        for ranges in (ALL_RANGES, RandomizationRanges(**ALL_RANGES))
    ]
    assert sampled_values[0] == sampled_values[1]


@pytest.mark.slow
def test_range_of_speed_fractions_follows_the_subject() -> None:
    options = {"strides": 1, "time_step": 1e-3, "domain_randomization": {"speed_fraction": (0.8, 1.25)}}
    for speed, expected in ((1.0, (0.8, 1.25)), (2.2, (1.76, 2.5))):  # 2.75 m/s is beyond the rig
        env = AnkleGaitEnv(speed=speed, **options)  # type: ignore[arg-type]
        grid = env._task.randomizer._option_grids["speed_m_per_s"]
        assert (grid[0], grid[-1]) == pytest.approx(expected, rel=1e-2)  # a stride has a whole number of intervals
        assert grid[0] <= env.reset(seed=1)[1]["speed_m_per_s"] <= grid[-1]
